/* The counter of 2 MHz, the timer of samples, and the inputs captured by it. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

#define CLOCK_HZ (F_CPU / 8U)

/* Start counting; interrupts call this board. */
void clock_init(struct lb_board *board);

/* The port's functions. */
uint32_t clock_ticks(void);
uint8_t clock_inputs(void);
void clock_set_timer(uint32_t tick);
void clock_stop_timer(void);

/* Keep away the interrupts that call the core, and only these: a latch may last longer
 * than the line can wait. Pairs may be nested. */
void clock_hold(void);
void clock_release(void);

/* Whether an interrupt has left something to do, since this was last asked. */
bool clock_take_woken(void);

/* Inline: an interrupt that calls a function saves twice as many registers. */
extern volatile bool clock_woken;

static inline void clock_wake(void)
{
    clock_woken = true;
}

#endif
