#include "thermometers.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include <simavr/avr_ioport.h>

#include "machine.h"

#define US (CYCLES_PER_S / 1000000U)
#define RESET_CYCLES (480U * US)
#define ANSWER_AFTER (30U * US)
#define ANSWER_LASTS (120U * US)
#define ONE_ENDS (15U * US)      /* low for less: a one is written */
#define ZERO_LASTS (30U * US)    /* a zero that is sent */
#define CONVERSION_CYCLES (750U * 1000U * US)
#define POWER_UP_RAW 0x0550

enum phase { SILENT, ADDRESSED, COMMANDED, SENDING };

struct wire {
    int hundredths_c;
    enum phase phase;
    bool master_low;
    bool pulled;
    uint64_t fell_at;
    unsigned n_bits; /* of the command, or of what is sent */
    unsigned command;
    uint8_t scratchpad[9];
    int raw;               /* in the scratchpad from `converted_at` on */
    uint64_t converted_at;
};

static struct wire wires[THERMOMETER_WIRES];

static void show(unsigned i)
{
    machine_set_line('F', i, !wires[i].master_low && !wires[i].pulled);
}

static avr_cycle_count_t release(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    (void)when;
    struct wire *wire = param;
    wire->pulled = false;
    show((unsigned)(wire - wires));
    return 0;
}

static avr_cycle_count_t answer(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    (void)when;
    struct wire *wire = param;
    wire->pulled = true;
    show((unsigned)(wire - wires));
    avr_cycle_timer_register(machine, ANSWER_LASTS, release, wire);
    return 0;
}

/* The remainder by x^8 + x^5 + x^4 + 1, bit by bit as they are sent. */
static uint8_t check(const uint8_t *bytes, unsigned n_bytes)
{
    unsigned rest = 0U;
    for (unsigned i = 0U; i < 8U * n_bytes; i++) {
        const unsigned bit = ((unsigned)bytes[i / 8U] >> (i % 8U) & 1U) ^ (rest & 1U);
        rest >>= 1;
        if (bit != 0U) {
            rest ^= 0x8CU;
        }
    }
    return (uint8_t)rest;
}

static void fill_scratchpad(struct wire *wire)
{
    const int raw = machine->cycle >= wire->converted_at ? wire->raw : POWER_UP_RAW;
    const uint8_t fixed[8] = {(uint8_t)raw, (uint8_t)(raw >> 8), 0x4BU, 0x46U,
                              0x7FU, 0xFFU, 0x0CU, 0x10U};
    memcpy(wire->scratchpad, fixed, sizeof fixed);
    wire->scratchpad[8] = check(fixed, sizeof fixed);
}

static void take_bit(struct wire *wire, bool bit)
{
    wire->command |= (bit ? 1U : 0U) << wire->n_bits;
    wire->n_bits++;
    if (wire->n_bits < 8U) {
        return;
    }
    const unsigned command = wire->command;
    wire->n_bits = 0U;
    wire->command = 0U;
    if (wire->phase == ADDRESSED) {
        wire->phase = command == 0xCCU ? COMMANDED : SILENT;
    } else if (command == 0xBEU) {
        wire->phase = SENDING;
        fill_scratchpad(wire);
    } else {
        wire->phase = SILENT;
        if (command == 0x44U) {
            wire->raw = (int)lround(wire->hundredths_c * 0.16);
            wire->converted_at = machine->cycle + CONVERSION_CYCLES;
        }
    }
}

static void fell(struct wire *wire)
{
    wire->fell_at = machine->cycle;
    if (wire->phase == SENDING && wire->n_bits < 72U) {
        const unsigned byte = wire->scratchpad[wire->n_bits / 8U];
        if ((byte >> (wire->n_bits % 8U) & 1U) == 0U) {
            wire->pulled = true;
            avr_cycle_timer_register(machine, ZERO_LASTS, release, wire);
        }
        wire->n_bits++;
    }
}

static void rose(struct wire *wire)
{
    const uint64_t low_cycles = machine->cycle - wire->fell_at;
    if (low_cycles >= RESET_CYCLES) {
        wire->phase = ADDRESSED;
        wire->n_bits = 0U;
        wire->command = 0U;
        avr_cycle_timer_register(machine, ANSWER_AFTER, answer, wire);
    } else if (wire->phase == ADDRESSED || wire->phase == COMMANDED) {
        take_bit(wire, low_cycles < ONE_ENDS);
    }
}

static void directions(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    for (unsigned i = 0U; i < THERMOMETER_WIRES; i++) {
        struct wire *wire = &wires[i];
        const bool low = (value >> i & 1U) != 0U;
        if (low != wire->master_low) {
            wire->master_low = low;
            if (wire->hundredths_c != THERMOMETER_ABSENT) {
                if (low) {
                    fell(wire);
                } else {
                    rose(wire);
                }
            }
            show(i);
        }
    }
}

void thermometers_restart(void)
{
    for (unsigned i = 0U; i < THERMOMETER_WIRES; i++) {
        wires[i] = (struct wire){.hundredths_c = wires[i].hundredths_c, .raw = POWER_UP_RAW};
        show(i);
    }
}

void thermometers_init(void)
{
    for (unsigned i = 0U; i < THERMOMETER_WIRES; i++) {
        wires[i].hundredths_c = 2000;
    }
    thermometers_restart();
    avr_irq_t *f = avr_io_getirq(machine, AVR_IOCTL_IOPORT_GETIRQ('F'), IOPORT_IRQ_DIRECTION_ALL);
    avr_irq_register_notify(f, directions, NULL);
}

void thermometers_set(unsigned wire, int hundredths_c)
{
    wires[wire].hundredths_c = hundredths_c;
}
