/* AMT21 encoders on an RS-485 bus at USART 1, addresses 54, 58 and so on (hexadecimal); PG1
 * enables the processor's driver. From their data sheet. */
#include <stddef.h>

#include "devices.h"
#include "machine.h"

#define FIRST_ADDRESS 0x54U
#define BYTE_CYCLES 80U       /* ten bits at 2 Mbit/s */
#define TURN_AROUND_CYCLES 48U /* 3 us until an encoder answers */

static bool is_driven;    /* by the processor */
static unsigned asked;    /* the channel that was asked */
static unsigned n_left;   /* bytes of its answer */
static uint16_t answer;

static uint64_t odd_parity(uint64_t bits)
{
    uint64_t parity = 1U;
    for (; bits != 0U; bits >>= 1) {
        parity ^= bits & 1U;
    }
    return parity;
}

/* An encoder begins to send a byte; where the processor drives the bus, nobody hears it. */
static avr_cycle_count_t answers(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    (void)param;
    if (!is_driven) {
        machine_bus_receive((uint8_t)answer);
    }
    answer >>= 8;
    n_left--;
    return n_left > 0U ? when + BYTE_CYCLES : 0U;
}

/* The address has come: the position is latched. */
static avr_cycle_count_t asked_whole(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    (void)param;
    struct device *device = &devices[asked];
    if (!is_driven || device->fault == ABSENT) {
        return 0U; /* the driver was switched off within the byte */
    }
    uint64_t word = device_latch(device);
    word |= odd_parity(word & 0x2AAAU) << 15 | odd_parity(word & 0x1555U) << 14;
    answer = (uint16_t)(device->fault == BAD_CHECK ? word ^ 4U : word);
    n_left = 2U;
    avr_cycle_timer_register(machine, TURN_AROUND_CYCLES, answers, NULL);
    (void)when;
    return 0U;
}

static void sent_on_bus(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    const unsigned place = (unsigned)(value - FIRST_ADDRESS) / 4U;
    if (is_driven && value >= FIRST_ADDRESS && value % 4U == 0U && place < n_devices) {
        asked = place;
        avr_cycle_timer_register(machine, BYTE_CYCLES - 1U, asked_whole, NULL);
    }
}

static void enabled(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    is_driven = value != 0U;
}

void amt21_begin(void)
{
    machine_on_bus_sent(sent_on_bus);
    machine_watch_line('G', 1U, enabled);
}

void amt21_restart(void)
{
}
