/* The serial line: UART 0. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

void uart_init(void);

/* Take a byte of the host; false where none waits. */
bool uart_take(uint8_t *byte);

/* The port's functions. */
uint16_t uart_room(void);
void uart_send(const uint8_t *bytes, uint16_t n_bytes);

#endif
