/* The machine that this port emulates: a counter of microseconds with one timer,
 * encoders that rest or turn steadily, inputs, sensors. */
#ifndef MACHINE_H
#define MACHINE_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"

#define TICK_RATE_HZ 1000000U

struct machine_options {
    uint32_t n_channels;
    uint32_t n_inputs;
    uint32_t bits;        /* of each encoder */
    uint32_t first_ticks; /* of the counter, at power-up */
};

/* Switch the machine on; every time it gets another boot_id. */
void machine_power_up(const struct machine_options *options);

/* Let the machine live until now: interrupts at their instants, the main loop between. */
void machine_live(void);
/* How long nothing is due, in microseconds; at most `longest_us`. */
uint32_t machine_idle_us(uint32_t longest_us);

struct lb_board *machine_board(void);

/* What a script does to it; each returns false where there is no such thing. */
bool machine_set_count(uint32_t channel, uint32_t count);
bool machine_turn(uint32_t channel, int32_t counts_per_s);
bool machine_set_status(uint32_t channel, uint32_t status);
bool machine_set_input(uint32_t input, uint32_t level);
bool machine_set_temperature(uint32_t sensor, int32_t hundredths_c);

#endif
