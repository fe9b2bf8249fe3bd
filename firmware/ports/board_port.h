/* What microcontrollers with a clock, pins, encoders and a serial line have in common. */
#ifndef BOARD_PORT_H
#define BOARD_PORT_H

#include <stdint.h>

#include "board.h"

extern const struct lb_port board_port;

/* One of the port's functions, which each port defines. */
int16_t board_port_temperature(uint8_t sensor);

/* Take the host's bytes, send what waits, and look after the encoders. */
void board_port_serve(struct lb_board *board);

#endif
