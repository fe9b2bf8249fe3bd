/* Timed samples: when each is due, and those that wait for the main loop.
 *
 * The timer's interrupt latches and queues; the main loop takes and sends. */
#ifndef LB_SAMPLER_H
#define LB_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "message.h"

struct lb_sample {
    uint32_t seq;
    struct lb_latch latch;
};

struct lb_sampler {
    const struct lb_identity *identity;
    const struct lb_port *port;
    /* Shared with the interrupt, under lock. */
    bool running;
    uint32_t next_seq;
    uint8_t first; /* place in the ring of the oldest that waits */
    uint8_t n_waiting;
    uint32_t n_missed; /* for which there was no room, since last asked */
    /* The interrupt's own while running. */
    uint32_t due_tick;
    uint64_t ticks_left;  /* from due_tick to the next sample, where that is far away */
    uint64_t whole_ticks; /* of a period */
    uint64_t rest;        /* of a period, in parts of `parts` */
    uint64_t parts;
    uint64_t fraction; /* of a tick, in parts, by which due_tick is early */
    struct lb_sample ring[LB_SAMPLE_QUEUE];
    /* The main loop's own. */
    uint8_t request; /* that of the START */
};

void lb_sampler_init(struct lb_sampler *sampler, const struct lb_identity *identity,
                     const struct lb_port *port);

/* Begin a stream; sample 0 is due a millisecond from now. */
void lb_sampler_start(struct lb_sampler *sampler, uint8_t request, uint32_t rate_millihz);
/* End it; samples that still wait are not sent. */
void lb_sampler_stop(struct lb_sampler *sampler);

/* The timer has reached the tick that was set. From its interrupt. */
void lb_sampler_due(struct lb_sampler *sampler);

/* The oldest waiting sample, NULL if none; it stays until lb_sampler_drop. */
const struct lb_sample *lb_sampler_peek(struct lb_sampler *sampler);
void lb_sampler_drop(struct lb_sampler *sampler);

/* Whether a stream runs, and the number of the next sample that will be sent. */
bool lb_sampler_state(struct lb_sampler *sampler, uint32_t *next_seq);

/* How many could not be queued since this was last asked. */
uint32_t lb_sampler_take_missed(struct lb_sampler *sampler);

/* Latch all for an instant that is already some ticks ago; marks what is late. */
void lb_latch_for(const struct lb_identity *identity, const struct lb_port *port,
                  uint32_t tick, struct lb_latch *latch);

#endif
