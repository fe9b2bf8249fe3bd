#include "edges.h"

#include <stddef.h>

#define HALF_OF_NUMBERS UINT32_C(0x80000000)

static uint8_t place(const struct lb_edges *edges, uint8_t index)
{
    return (uint8_t)(((unsigned)edges->first + index) % LB_MAX_EDGES);
}

void lb_edges_init(struct lb_edges *edges)
{
    edges->next_seq = 0U;
    edges->n_lost = 0U;
    edges->first = 0U;
    edges->n_waiting = 0U;
}

bool lb_edges_add(struct lb_edges *edges, const struct lb_held *held, uint64_t now)
{
    const uint32_t seq = edges->next_seq;
    edges->next_seq++;
    if (edges->n_waiting >= LB_MAX_EDGES) {
        edges->n_lost++;
        return false;
    }
    struct lb_edge *edge = &edges->ring[place(edges, edges->n_waiting)];
    edge->seq = seq;
    edge->input = held->input;
    edge->level = held->level;
    edge->due = now;
    edge->latch = *held->latch;
    edges->n_waiting++;
    return true;
}

void lb_edges_acknowledge(struct lb_edges *edges, uint32_t seq)
{
    /* Modulo 2^32: what lies ahead of the oldest by less than half of all numbers. A
     * number that was not yet given acknowledges nothing. */
    const uint32_t newest = edges->next_seq - 1U;
    if ((uint32_t)(newest - seq) >= HALF_OF_NUMBERS) {
        return;
    }
    while (edges->n_waiting > 0U &&
           (uint32_t)(seq - edges->ring[edges->first].seq) < HALF_OF_NUMBERS) {
        edges->first = place(edges, 1U);
        edges->n_waiting--;
    }
}

void lb_edges_forget(struct lb_edges *edges)
{
    edges->n_waiting = 0U;
}

struct lb_edge *lb_edges_due(struct lb_edges *edges, uint64_t now)
{
    for (uint8_t i = 0U; i < edges->n_waiting; i++) {
        struct lb_edge *edge = &edges->ring[place(edges, i)];
        if (edge->due <= now) {
            return edge;
        }
    }
    return NULL;
}

uint8_t lb_edges_back(const struct lb_edges *edges)
{
    if (edges->n_waiting == 0U) {
        return 0U;
    }
    const uint32_t back = edges->next_seq - edges->ring[edges->first].seq;
    return back > UINT8_MAX ? UINT8_MAX : (uint8_t)back;
}
