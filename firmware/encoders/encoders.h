/* The board's encoders, whatever their kind: counts and status for the core, and alarms. */
#ifndef ENCODERS_H
#define ENCODERS_H

#include <stdint.h>

#include "board.h"

/* Initialise the encoders, and describe them to the core. */
void encoders_init(struct lb_identity *identity);

/* Latch all of them; the core's interrupts are held. */
void encoders_latch(uint32_t *counts, uint8_t *status);

/* Look after encoders that nobody reads, and raise or clear alarms. From the main loop,
 * as often as it likes; `hold` and `release` keep the core's interrupts away. */
void encoders_watch(struct lb_board *board, void (*hold)(void), void (*release)(void));

#endif
