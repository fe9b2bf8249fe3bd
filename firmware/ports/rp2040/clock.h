/* The counter of microseconds, the timer of samples, and the inputs. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

#include "board.h"

#define CLOCK_HZ 1000000U

/* Make the inputs readable. */
void clock_init_inputs(void);

/* Interrupts call this board from now on. */
void clock_init(struct lb_board *board);

/* The port's functions. */
uint32_t clock_ticks(void);
uint8_t clock_inputs(void);
void clock_set_timer(uint32_t tick);
void clock_stop_timer(void);

/* Keep away the interrupts that call the core, and only these. Pairs may be nested. */
void clock_hold(void);
void clock_release(void);

#endif
