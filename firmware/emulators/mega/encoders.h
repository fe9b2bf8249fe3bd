/* Models of encoders at the pins of ports/avr/pins.h, written from their data sheets and not
 * from the firmware. */
#ifndef MODEL_ENCODERS_H
#define MODEL_ENCODERS_H

#include <stdbool.h>
#include <stdint.h>

enum fault { NO_FAULT, WEAK, NO_MAGNET, ABSENT, BAD_CHECK };

/* `kind`: quadrature, ssi, biss, as5047, amt22, as5600, as5600-multiplexer, amt21. */
bool encoders_init(const char *kind, unsigned n_channels, unsigned bits, uint32_t counts_per_turn);

/* Continue after the power was off, or after a motion was changed. */
void encoders_restart(void);

void encoders_fail(unsigned channel, enum fault fault);

/* The cycle of a channel's first latch since it was awaited; 0: none. */
void encoders_await_latch(void);
uint64_t encoders_latched_at(unsigned channel);

#endif
