#include "inputs.h"

#include <stddef.h>

#include "sampler.h"

#define MICROSECONDS 1000000U

void lb_inputs_init(struct lb_inputs *inputs, const struct lb_identity *identity,
                    const struct lb_port *port)
{
    inputs->identity = identity;
    inputs->port = port;
    inputs->first = 0U;
    inputs->n_waiting = 0U;
    inputs->overflowed = false;
    inputs->levels = port->inputs(); /* what is held at power-up is no edge */
    inputs->reported = inputs->levels;
    for (uint8_t i = 0U; i < LB_MAX_INPUTS; i++) {
        inputs->bounces[i].active = false;
    }
}

void lb_inputs_debounce(struct lb_inputs *inputs, uint32_t debounce_us)
{
    inputs->debounce_ticks =
        ((uint64_t)debounce_us * inputs->identity->tick_rate_hz) / MICROSECONDS;
}

void lb_inputs_change(struct lb_inputs *inputs, uint32_t earliest, uint32_t tick,
                      uint8_t levels)
{
    if (inputs->n_waiting >= LB_CHANGE_QUEUE) {
        inputs->overflowed = true;
        return;
    }
    const uint8_t place = (uint8_t)(((unsigned)inputs->first + inputs->n_waiting) % LB_CHANGE_QUEUE);
    lb_latch_for(inputs->identity, inputs->port, earliest, &inputs->ring[place]);
    inputs->ring[place].ticks = tick;
    inputs->ring[place].inputs = levels;
    inputs->n_waiting++;
}

/* Note which inputs a change has moved; `at` is its tick, unwrapped. */
static void note(struct lb_inputs *inputs, const struct lb_latch *change, uint64_t at)
{
    const uint8_t moved = (uint8_t)(inputs->levels ^ change->inputs);
    for (uint8_t i = 0U; i < inputs->identity->n_inputs; i++) {
        struct lb_bounce *bounce = &inputs->bounces[i];
        if ((((unsigned)moved >> i) & 1U) != 0U) {
            if (!bounce->active) {
                bounce->active = true;
                bounce->latch = *change;
            }
            bounce->last_tick = at;
        }
    }
    inputs->levels = change->inputs;
}

/* Find the input that came to rest first, until an instant; -1 for none. */
static int8_t at_rest(const struct lb_inputs *inputs, uint64_t until)
{
    int8_t first = -1;
    for (uint8_t i = 0U; i < inputs->identity->n_inputs; i++) {
        const struct lb_bounce *bounce = &inputs->bounces[i];
        if (bounce->active && bounce->last_tick + inputs->debounce_ticks <= until &&
            (first < 0 || bounce->last_tick < inputs->bounces[first].last_tick)) {
            first = (int8_t)i;
        }
    }
    return first;
}

/* The oldest change that waits, NULL if none. After lost ones: the levels of now. */
static const struct lb_latch *peek(struct lb_inputs *inputs)
{
    const struct lb_port *port = inputs->port;
    port->lock();
    if (inputs->n_waiting == 0U && inputs->overflowed) {
        /* Changes of an input that chatters were lost; its level may differ from the
         * last one noted. Latched too late for them, and marked so. */
        inputs->overflowed = false;
        const uint32_t tick = port->ticks();
        lb_inputs_change(inputs, tick, tick, port->inputs());
        struct lb_latch *latch = &inputs->ring[inputs->first];
        for (uint8_t i = 0U; i < inputs->identity->n_channels; i++) {
            latch->status[i] |= (uint8_t)LB_STATUS_LATE;
        }
    }
    const uint8_t n_waiting = inputs->n_waiting;
    port->unlock();
    return n_waiting > 0U ? &inputs->ring[inputs->first] : NULL;
}

static void drop(struct lb_inputs *inputs)
{
    inputs->port->lock();
    inputs->first = (uint8_t)((inputs->first + 1U) % LB_CHANGE_QUEUE);
    inputs->n_waiting--;
    inputs->port->unlock();
}

bool lb_inputs_next(struct lb_inputs *inputs, uint64_t now, struct lb_held *held)
{
    /* Strategy: the main loop may be late. A change is noted only after what had come to
     * rest before it, so that the edges do not depend on when they are looked for. */
    for (;;) {
        const struct lb_latch *change = peek(inputs);
        uint64_t until = now;
        if (change != NULL) {
            /* Ticks are 32 bits of `now`; a change is a short while ago, or, of an
             * interrupt since `now` was read, a little ahead. */
            until = now + (uint64_t)(int64_t)(int32_t)(change->ticks - (uint32_t)now);
        }
        const int8_t rested = at_rest(inputs, until);
        if (rested >= 0) {
            const uint8_t bit = (uint8_t)(1U << (uint8_t)rested);
            inputs->bounces[rested].active = false;
            if (((inputs->levels ^ inputs->reported) & bit) != 0U) {
                inputs->reported ^= bit;
                held->input = (uint8_t)rested;
                held->level = (inputs->reported & bit) != 0U ? 1U : 0U;
                held->latch = &inputs->bounces[rested].latch;
                return true;
            }
        } else if (change != NULL) {
            note(inputs, change, until);
            drop(inputs);
        } else {
            return false;
        }
    }
}
