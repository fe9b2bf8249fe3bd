/* Edges, kept until the host acknowledges them. The main loop's own. */
#ifndef LB_EDGES_H
#define LB_EDGES_H

#include <stdbool.h>
#include <stdint.h>

#include "inputs.h"

struct lb_edge {
    uint32_t seq;
    uint8_t input;
    uint8_t level;
    uint64_t due; /* when it is to be sent (again), unwrapped ticks */
    struct lb_latch latch;
};

struct lb_edges {
    uint32_t next_seq;
    uint32_t n_lost; /* for which there was no room */
    uint8_t first;   /* place in the ring of the oldest */
    uint8_t n_waiting;
    struct lb_edge ring[LB_MAX_EDGES];
};

void lb_edges_init(struct lb_edges *edges);

/* Number a change that has held; false if there was no room to keep it. */
bool lb_edges_add(struct lb_edges *edges, const struct lb_held *held, uint64_t now);

/* Forget every edge up to and including a number. */
void lb_edges_acknowledge(struct lb_edges *edges, uint32_t seq);
void lb_edges_forget(struct lb_edges *edges);

/* The oldest edge that is to be sent now, NULL if none. */
struct lb_edge *lb_edges_due(struct lb_edges *edges, uint64_t now);

/* How many numbers before the next one the oldest waiting edge has, 255 at most; 0: none. */
uint8_t lb_edges_back(const struct lb_edges *edges);

#endif
