/* AMT21: encoders of 14 bits on one RS-485 bus, each with an address of its own. They are
 * read one after the other. */
#include "front_end.h"
#include "settings.h"

#if FRONT_END == AMT21

#include "bus.h"
#include "pins.h"
#include "words.h"

#define COUNT_BITS 14U
#define ANSWER_US 50U /* some 3 us until it answers, and two bytes of 5 us; with a margin */
#define ANSWER_BYTES 2U

static const uint8_t addresses[] = AMT21_ADDRESSES;
_Static_assert(sizeof addresses >= CHANNELS, "AMT21_ADDRESSES has fewer than CHANNELS");

void front_end_init(void)
{
    bus_init();
}

struct lb_channel front_end_channel(uint8_t channel)
{
    (void)channel;
    return (struct lb_channel){.bits = COUNT_BITS, .modulus = 0U};
}

/* Ask an encoder for its position; false where it does not answer. */
static bool exchange(uint8_t address, uint16_t *word)
{
    uint8_t bytes[ANSWER_BYTES];
    uint8_t n_bytes = 0U;
    uint8_t waited_us = 0U;
    bus_send(address);
    while (n_bytes < ANSWER_BYTES) {
        if (bus_take(&bytes[n_bytes])) {
            n_bytes++;
        } else if (waited_us < ANSWER_US) {
            pins_wait_us(1);
            waited_us++;
        } else {
            return false;
        }
    }
    *word = (uint16_t)((unsigned)bytes[1] << 8 | bytes[0]); /* the low byte comes first */
    return true;
}

uint8_t front_end_latch(uint32_t *counts, uint8_t *healths)
{
    for (uint8_t i = 0U; i < CHANNELS; i++) {
        uint16_t word = 0U;
        healths[i] = SILENT;
        if (exchange(addresses[i], &word)) {
            healths[i] = (uint8_t)word_check_amt(word);
        }
        counts[i] = word_position_14(word);
    }
    return (uint8_t)(PINS_DATA_MASK & 0xFEU);
}

void front_end_look(void)
{
}

#endif
