/* What each kind of encoder provides; settings.h chooses which one is compiled. */
#ifndef FRONT_END_H
#define FRONT_END_H

#include <stdint.h>

#include "port.h"
#include "settings.h"

/* State of an encoder, the worse the higher. */
enum health {
    HEALTHY,
    WEAK,    /* the count is valid, the signal or magnet is weak */
    FAST,    /* counts were lost: it turned too fast, or its lines are disturbed */
    INVALID, /* it answers, without a valid count */
    SILENT   /* it does not answer */
};

void front_end_init(void);

/* Bits and modulus of a channel. */
struct lb_channel front_end_channel(uint8_t channel);

/* Latch all channels. The core's interrupts are held; others may come. The bit i of
 * the value returned says that channel i was latched later than the first. */
uint8_t front_end_latch(uint32_t *counts, uint8_t *healths);

/* From the main loop, every 250 ms, with the core's interrupts held: what takes its time. */
void front_end_look(void);

#endif
