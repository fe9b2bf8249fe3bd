/* The serial line of this port: a pty, with the faults that a script asks for. */
#ifndef LINE_H
#define LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Make the pty and a link to it; false where the system refuses (errno says why). */
bool line_plug(const char *link);
/* Remove both, as when a plug is pulled. */
void line_unplug(const char *link);

/* The descriptor to wait for; -1 where nobody has opened the other end. */
int line_descriptor(void);
/* Whether the host has closed its end since this was last asked. */
bool line_host_gone(void);

/* Read bytes of the host; returns how many. */
size_t line_read(uint8_t *bytes, size_t n_bytes);
/* Pass on what waits. */
void line_flush(void);

/* The port's functions. */
uint16_t line_room(void);
void line_send(const uint8_t *bytes, uint16_t n_bytes);

/* Lose that many timed samples; spoil a bit of the next frame of a type. */
void line_lose(uint32_t n_samples);
void line_spoil(uint8_t type);

#endif
