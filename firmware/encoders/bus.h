/* A half-duplex RS-485 bus of encoders, which each port provides: bytes of 8N1 at 2 Mbit/s
 * through a transceiver whose driver an output of the processor enables. */
#ifndef BUS_H
#define BUS_H

#include <stdbool.h>
#include <stdint.h>

#define BUS_BAUD_RATE 2000000U

void bus_init(void);

/* Discard what has come, and send a byte; the driver is off again when this returns. */
void bus_send(uint8_t byte);

/* Take a byte that has come; false where there is none. */
bool bus_take(uint8_t *byte);

#endif
