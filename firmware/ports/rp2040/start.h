/* What the start-up code needs of the program, and the interrupts in its vector table. */
#ifndef START_H
#define START_H

_Noreturn void start(void);
_Noreturn void main_program(void);

void start_clocks(void);

void timer_due(void);
void timer_wakes(void);
void pins_changed(void);
void changes_due(void);
void uart_due(void);

void *memcpy(void *to, const void *from, unsigned n_bytes);
void *memset(void *to, int value, unsigned n_bytes);

#endif
