/* Encoders that shift out a word: SSI, BiSS-C, AS5047, AMT22. All share one clock and one
 * chip select, and each has a data line of its own: one edge latches them all, and each
 * bit of all of them is read at once. */
#include "front_end.h"
#include "settings.h"

#if FRONT_END == SSI || FRONT_END == BISS || FRONT_END == AS5047 || FRONT_END == AMT22

#include "pins.h"
#include "words.h"

#if FRONT_END == SSI
#define CHANNEL_BITS WORD_BITS
#define SAMPLES (WORD_BITS + 2U) /* idle, the word, the pause after it */
#elif FRONT_END == BISS
#define CHANNEL_BITS WORD_BITS
#define SAMPLES (BISS_WAIT + 2U + WORD_BITS + BISS_TAIL)
#else
#define CHANNEL_BITS 14U
#define SAMPLES 16U
#endif
#define CLOCKS_AT_ONCE 8U /* without an interrupt: some 10 us */

static uint8_t samples[SAMPLES];

void front_end_init(void)
{
    /* An AS5047 reads ones as the command "read the angle", an AMT22 zeros as "position". */
    pins_init_shift(FRONT_END == SSI || FRONT_END == BISS, FRONT_END == AS5047);
}

struct lb_channel front_end_channel(uint8_t channel)
{
    (void)channel;
    return (struct lb_channel){.bits = CHANNEL_BITS, .modulus = 0U};
}

/* Strategy: interrupts stretch a pulse of the clock; SSI and BiSS-C encoders take a pause
 * of some 12 us for the end of the word. So they are let in between groups of bits only,
 * where they last less. */
static void shift(uint8_t first, uint8_t end)
{
    pins_state state = pins_lock();
    for (uint8_t i = first; i < end; i++) {
#if FRONT_END == SSI || FRONT_END == BISS
        /* The clock rests high; its first fall latches, each rise brings a bit. */
        pins_clock(false);
        pins_wait();
        pins_clock(true);
        pins_wait();
        samples[i] = pins_data();
#elif FRONT_END == AS5047
        /* SPI mode 1: a rise brings a bit, valid at the fall. */
        pins_clock(true);
        pins_wait();
        samples[i] = pins_data();
        pins_clock(false);
        pins_wait();
#else
        /* SPI mode 0: a bit is valid at the rise. */
        pins_wait();
        samples[i] = pins_data();
        pins_clock(true);
        pins_wait();
        pins_clock(false);
#endif
        if ((i + 1U - first) % CLOCKS_AT_ONCE == 0U) {
            pins_unlock(state);
            state = pins_lock();
        }
    }
    pins_unlock(state);
}

static void read_all(void)
{
#if FRONT_END == SSI
    samples[0] = pins_data();
    shift(1U, SAMPLES);
#elif FRONT_END == BISS
    shift(0U, SAMPLES);
#elif FRONT_END == AS5047
    /* The angle of the command's frame comes in the next one. */
    pins_select(false);
    shift(0U, SAMPLES);
    pins_select(true);
    pins_wait();
    pins_select(false);
    shift(0U, SAMPLES);
    pins_select(true);
#else
    pins_select(false);
    pins_wait_us(3);
    shift(0U, SAMPLES / 2U);
    pins_wait_us(3);
    shift(SAMPLES / 2U, SAMPLES);
    pins_wait_us(3);
    pins_select(true);
#endif
}

uint8_t front_end_latch(uint32_t *counts, uint8_t *healths)
{
    read_all();
    for (uint8_t i = 0U; i < CHANNELS; i++) {
#if FRONT_END == SSI
        healths[i] = (uint8_t)word_ssi(samples, i, WORD_BITS, GRAY_CODE != 0, &counts[i]);
#elif FRONT_END == BISS
        healths[i] = (uint8_t)word_biss(samples, i, WORD_BITS, &counts[i]);
#elif FRONT_END == AS5047
        healths[i] = (uint8_t)word_as5047(samples, i, &counts[i]);
#else
        healths[i] = (uint8_t)word_amt22(samples, i, &counts[i]);
#endif
    }
    return 0U;
}

void front_end_look(void)
{
}

#endif
