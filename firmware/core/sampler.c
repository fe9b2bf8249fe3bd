#include "sampler.h"

#include <stddef.h>

/* A timer's tick must lie within half a turn of the counter: longer waits are cut. */
#define LONGEST_WAIT_TICKS (UINT32_C(1) << 30)
#define MILLI 1000U

void lb_latch_for(const struct lb_identity *identity, const struct lb_port *port,
                  uint32_t tick, struct lb_latch *latch)
{
    const uint32_t latched_tick = port->latch(latch->counts, latch->status);
    latch->ticks = tick;
    if ((uint32_t)(latched_tick - tick) > identity->late_ticks) {
        for (uint8_t i = 0U; i < identity->n_channels; i++) {
            latch->status[i] |= (uint8_t)LB_STATUS_LATE;
        }
    }
}

void lb_sampler_init(struct lb_sampler *sampler, const struct lb_identity *identity,
                     const struct lb_port *port)
{
    sampler->identity = identity;
    sampler->port = port;
    sampler->running = false;
    sampler->next_seq = 0U;
    sampler->first = 0U;
    sampler->n_waiting = 0U;
    sampler->n_missed = 0U;
    sampler->request = 0U;
}

/* Set the timer to the next sample, or to a stop on the way there. */
static void set_timer(struct lb_sampler *sampler)
{
    const uint32_t wait = sampler->ticks_left > LONGEST_WAIT_TICKS
                              ? LONGEST_WAIT_TICKS
                              : (uint32_t)sampler->ticks_left;
    sampler->ticks_left -= wait;
    sampler->due_tick += wait;
    sampler->port->set_timer(sampler->due_tick);
}

void lb_sampler_start(struct lb_sampler *sampler, uint8_t request, uint32_t rate_millihz)
{
    const struct lb_port *port = sampler->port;
    const uint64_t span = (uint64_t)sampler->identity->tick_rate_hz * MILLI;

    lb_sampler_stop(sampler);
    sampler->request = request;
    sampler->next_seq = 0U;
    /* Strategy: sample k is due at round(k span / rate). The quotient is followed as a
     * whole number and a fraction in parts of 2 rate that begins at one half, so that it
     * is exact however long the stream runs. */
    sampler->whole_ticks = span / rate_millihz;
    sampler->rest = 2U * (span % rate_millihz);
    sampler->parts = 2U * (uint64_t)rate_millihz;
    sampler->fraction = rate_millihz;
    sampler->ticks_left = sampler->identity->tick_rate_hz / MILLI;
    sampler->due_tick = port->ticks();
    port->lock();
    sampler->running = true;
    set_timer(sampler);
    port->unlock();
}

void lb_sampler_stop(struct lb_sampler *sampler)
{
    const struct lb_port *port = sampler->port;
    port->lock();
    port->stop_timer();
    if (sampler->n_waiting > 0U) {
        sampler->next_seq = sampler->ring[sampler->first].seq;
        sampler->n_waiting = 0U;
    }
    sampler->running = false;
    port->unlock();
}

void lb_sampler_due(struct lb_sampler *sampler)
{
    if (!sampler->running) {
        return;
    }
    if (sampler->ticks_left > 0U) {
        set_timer(sampler);
        return;
    }
    if (sampler->n_waiting < LB_SAMPLE_QUEUE) {
        const uint8_t place = (uint8_t)(((unsigned)sampler->first + sampler->n_waiting) % LB_SAMPLE_QUEUE);
        struct lb_sample *sample = &sampler->ring[place];
        lb_latch_for(sampler->identity, sampler->port, sampler->due_tick, &sample->latch);
        sample->latch.inputs = sampler->port->inputs();
        sample->seq = sampler->next_seq;
        sampler->n_waiting++;
    } else {
        sampler->n_missed++;
    }
    sampler->next_seq++;
    sampler->ticks_left = sampler->whole_ticks;
    sampler->fraction += sampler->rest;
    if (sampler->fraction >= sampler->parts) {
        sampler->fraction -= sampler->parts;
        sampler->ticks_left++;
    }
    set_timer(sampler);
}

const struct lb_sample *lb_sampler_peek(struct lb_sampler *sampler)
{
    sampler->port->lock();
    const uint8_t n_waiting = sampler->n_waiting;
    sampler->port->unlock();
    /* The interrupt writes behind those that wait: this one may be read without lock. */
    return n_waiting > 0U ? &sampler->ring[sampler->first] : NULL;
}

void lb_sampler_drop(struct lb_sampler *sampler)
{
    sampler->port->lock();
    sampler->first = (uint8_t)((sampler->first + 1U) % LB_SAMPLE_QUEUE);
    sampler->n_waiting--;
    sampler->port->unlock();
}

bool lb_sampler_state(struct lb_sampler *sampler, uint32_t *next_seq)
{
    sampler->port->lock();
    const bool running = sampler->running;
    *next_seq = sampler->n_waiting > 0U ? sampler->ring[sampler->first].seq : sampler->next_seq;
    sampler->port->unlock();
    return running;
}

uint32_t lb_sampler_take_missed(struct lb_sampler *sampler)
{
    sampler->port->lock();
    const uint32_t n_missed = sampler->n_missed;
    sampler->n_missed = 0U;
    sampler->port->unlock();
    return n_missed;
}
