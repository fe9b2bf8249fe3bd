#include "quadrature.h"
#include "settings.h"

#if FRONT_END == QUADRATURE

#include <stdbool.h>

#include "front_end.h"
#include "pins.h"

#define INDEX_TOLERANCE 2 /* counts that an index is wide, entered from either side */

struct encoder {
    uint32_t count;   /* below counts_per_turn */
    uint32_t indexed; /* the count at the index, if known */
    bool index_known;
    bool steps_lost; /* the count is not valid; until the next index */
};

struct quadrature_lines quadrature;

static const uint32_t counts_per_turn[] = COUNTS_PER_TURN;
_Static_assert(sizeof counts_per_turn / sizeof counts_per_turn[0] >= CHANNELS,
               "COUNTS_PER_TURN lacks channels");

static struct encoder encoders[CHANNELS];

void front_end_init(void)
{
    pins_init_quadrature();
    quadrature.levels[0] = pins_bank(0U);
    quadrature.levels[1] = pins_bank(1U);
    quadrature.index = pins_index();
}

struct lb_channel front_end_channel(uint8_t channel)
{
    struct lb_channel described = {.bits = 1U, .modulus = counts_per_turn[channel]};
    while (described.bits < 32U && ((described.modulus - 1U) >> described.bits) != 0U) {
        described.bits++;
    }
    return described;
}

/* A count further on, and back where it passes the end of a turn. */
static uint32_t moved_by(uint32_t count, int16_t moved, uint32_t modulus)
{
    int32_t sum = (int32_t)count + moved;
    while (sum < 0) {
        sum += (int32_t)modulus;
    }
    while (sum >= (int32_t)modulus) {
        sum -= (int32_t)modulus;
    }
    return (uint32_t)sum;
}

/* The index came at a count. Its first time is kept; later ones show whether counts were
 * lost, and put them right. */
static void at_index(struct encoder *encoder, uint32_t count, uint32_t modulus)
{
    if (!encoder->index_known) {
        encoder->indexed = count;
        encoder->index_known = !encoder->steps_lost;
        return;
    }
    const uint32_t ahead = count >= encoder->indexed ? count - encoder->indexed
                                                     : count + modulus - encoder->indexed;
    const bool agrees = ahead <= INDEX_TOLERANCE || modulus - ahead <= INDEX_TOLERANCE;
    if (!agrees) {
        const uint32_t right = encoder->count + modulus - ahead;
        encoder->count = right >= modulus ? right - modulus : right;
    }
    /* Lost without a step that showed it: said until the next index. */
    encoder->steps_lost = !agrees && !encoder->steps_lost;
}

uint8_t front_end_latch(uint32_t *counts, uint8_t *healths)
{
    struct quadrature_lines taken;
    const pins_state state = pins_lock();
    taken = quadrature;
    for (uint8_t i = 0U; i < CHANNELS; i++) {
        quadrature.moved[i] = 0;
    }
    quadrature.skipped[0] = 0U;
    quadrature.skipped[1] = 0U;
    quadrature.indexed = 0U;
    pins_unlock(state);

    for (uint8_t i = 0U; i < CHANNELS; i++) {
        struct encoder *encoder = &encoders[i];
        const uint32_t modulus = counts_per_turn[i];
        const uint32_t before = encoder->count;
        encoder->count = moved_by(before, taken.moved[i], modulus);
        if (((unsigned)taken.skipped[i / 4U] >> (2U * (i % 4U)) & 1U) != 0U) {
            encoder->steps_lost = true;
        }
        if (INDEX_WIRED && ((unsigned)taken.indexed >> i & 1U) != 0U) {
            at_index(encoder, moved_by(before, taken.at_index[i], modulus), modulus);
        }
        counts[i] = encoder->count;
        healths[i] = encoder->steps_lost ? FAST : HEALTHY;
    }
    return 0U;
}

void front_end_look(void)
{
}

#endif
