/* An ATmega2560 of libsimavr that runs the firmware, with what libsimavr 1.6 lacks. */
#ifndef MACHINE_H
#define MACHINE_H

#include <stdbool.h>
#include <stdint.h>

#include <simavr/sim_avr.h>

#define CYCLES_PER_S 16000000U

extern avr_t *machine;

/* Load the firmware; its counter begins at a multiple of 65536, its EEPROM with a number. */
bool machine_load(const char *elf, uint32_t first_ticks, uint32_t boot_id);
/* Switch it off and on. */
void machine_power(void);
/* Run until a cycle; false where it has crashed. */
bool machine_run(uint64_t until_cycle);

/* A line of a port, as seen from outside: set its level. */
void machine_set_line(char port, unsigned bit, bool level);
/* Have `changed` called with the level of an output. */
void machine_watch_line(char port, unsigned bit, avr_irq_notify_t changed);

/* USART 1: give it a byte, which it has taken a byte's time later. */
void machine_bus_receive(uint8_t byte);
void machine_on_bus_sent(avr_irq_notify_t sent);

/* Give a byte to USART 0; false while its buffer is full. What it sends goes to `sent`. */
bool machine_receive(uint8_t byte);
void machine_on_sent(avr_irq_notify_t sent);

#endif
