/* Encoders that shift out a word on PA0 onwards, with a common clock (PG0) and chip select
 * (PG1): SSI, BiSS-C, AS5047, AMT22, from their data sheets. */
#include <stddef.h>

#include "devices.h"
#include "machine.h"

#define MONOFLOP_CYCLES (16U * 15U) /* SSI, BiSS-C: 15 us without a clock end the word */
#define BISS_ACKNOWLEDGE 3U         /* clocks until its start bit */

static struct {
    uint64_t clocked_at; /* the last change of the clock */
    bool is_running;     /* within a word */
    uint64_t answers[MOTIONS]; /* AS5047: what the last frame asked for */
} bus;

static uint64_t parity(uint64_t word)
{
    uint64_t bit = 0U;
    for (; word != 0U; word >>= 1) {
        bit ^= word & 1U;
    }
    return bit;
}

static void load(unsigned channel, uint64_t word, unsigned n_bits)
{
    devices[channel].word = word;
    devices[channel].n_left = n_bits;
}

/* Put the next bit on the line; after the last one, `then`. */
static void put_bit(unsigned channel, bool then)
{
    struct device *device = &devices[channel];
    if (device->n_left > 0U) {
        device->n_left--;
        device_set_data(channel, (device->word >> device->n_left & 1U) != 0U);
    } else {
        device_set_data(channel, then);
    }
}

/* ---- SSI and BiSS-C: the clock rests high ------------------------------------------------ */

static void load_ssi(unsigned channel)
{
    load(channel, device_latch(&devices[channel]), devices[channel].bits);
}

static void load_biss(unsigned channel)
{
    const struct device *device = &devices[channel];
    uint64_t word = device_latch(&devices[channel]);
    word = word << 2 | (device->fault == NO_MAGNET ? 0U : 2U) | (device->fault == WEAK ? 0U : 1U);
    uint64_t rest = word << 6; /* divided by x^6 + x + 1 */
    for (unsigned i = device->bits + 8U; i-- > 6U;) {
        if ((rest >> i & 1U) != 0U) {
            rest ^= UINT64_C(0x43) << (i - 6U);
        }
    }
    uint64_t sent = ~rest & 0x3FU;
    if (device->fault == BAD_CHECK) {
        sent ^= 1U;
    }
    /* Acknowledge: zeros; start: 1; CDS: 0. */
    word = (UINT64_C(2) << (device->bits + 8U)) | word << 6 | sent;
    load(channel, word, BISS_ACKNOWLEDGE + 2U + device->bits + 8U);
}

static void (*load_word)(unsigned channel);

static avr_cycle_count_t word_ends(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    (void)param;
    if (when - bus.clocked_at < MONOFLOP_CYCLES) {
        return bus.clocked_at + MONOFLOP_CYCLES;
    }
    bus.is_running = false;
    for (unsigned i = 0U; i < n_devices; i++) {
        device_set_data(i, true);
    }
    return 0;
}

static void clocked_resting_high(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (irq->value == value) {
        return;
    }
    bus.clocked_at = machine->cycle;
    if (value == 0U && !bus.is_running) {
        bus.is_running = true;
        for (unsigned i = 0U; i < n_devices; i++) {
            load_word(i);
        }
        avr_cycle_timer_register(machine, MONOFLOP_CYCLES, word_ends, NULL);
    } else if (value != 0U && bus.is_running) {
        for (unsigned i = 0U; i < n_devices; i++) {
            /* SSI holds the line low until the pause has ended. */
            put_bit(i, load_word == load_biss);
        }
    }
}

/* ---- SPI: chip select ---------------------------------------------------------------------- */

static void selected_as5047(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (irq->value == value) {
        return;
    }
    for (unsigned i = 0U; i < n_devices; i++) {
        if (value == 0U) {
            load(i, bus.answers[i], 16U);
        } else {
            /* The command has come: the angle is read, for the next frame. */
            uint64_t word = device_latch(&devices[i]) | (devices[i].fault == NO_MAGNET ? 0x4000U : 0U);
            word |= parity(word) << 15;
            bus.answers[i] = devices[i].fault == BAD_CHECK ? word ^ 1U : word;
        }
    }
}

static void clocked_mode_1(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (irq->value != value && value != 0U) {
        for (unsigned i = 0U; i < n_devices; i++) {
            put_bit(i, true);
        }
    }
}

static void selected_amt22(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (irq->value == value) {
        return;
    }
    for (unsigned i = 0U; i < n_devices; i++) {
        uint64_t word = device_latch(&devices[i]);
        word |= (1U ^ parity(word & 0x2AAAU)) << 15 | (1U ^ parity(word & 0x1555U)) << 14;
        load(i, devices[i].fault == BAD_CHECK ? word ^ 4U : word, 16U);
        put_bit(i, true); /* the first bit is there before the clock */
    }
}

static void clocked_mode_0(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (irq->value != value && value == 0U) {
        for (unsigned i = 0U; i < n_devices; i++) {
            put_bit(i, true);
        }
    }
}

void shift_restart(void)
{
}

void ssi_begin(void)
{
    load_word = load_ssi;
    machine_watch_line('G', 0U, clocked_resting_high);
}

void biss_begin(void)
{
    load_word = load_biss;
    machine_watch_line('G', 0U, clocked_resting_high);
}

void as5047_begin(void)
{
    machine_watch_line('G', 0U, clocked_mode_1);
    machine_watch_line('G', 1U, selected_as5047);
}

void amt22_begin(void)
{
    machine_watch_line('G', 0U, clocked_mode_0);
    machine_watch_line('G', 1U, selected_amt22);
}
