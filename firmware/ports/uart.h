/* The serial line of a microcontroller's port, interrupt driven. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

#include "settings.h"

/* How many samples a second the line carries: ten bits a byte, 16 + 5 n bytes a sample
 * (section 5), a tenth of it left to edges, heartbeats and answers. */
#define UART_SAMPLE_RATE_HZ ((BAUD_RATE * 9U / 10U) / (10U * (16U + (5U * CHANNELS))))

void uart_init(void);

/* Take a byte of the host; false where none waits. */
bool uart_take(uint8_t *byte);

/* The port's functions. */
uint16_t uart_room(void);
void uart_send(const uint8_t *bytes, uint16_t n_bytes);

#endif
