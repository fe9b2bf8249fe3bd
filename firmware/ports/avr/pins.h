/* Pins of an Arduino Mega (ATmega2560), in the names of the processor and of the board.
 *
 *   data lines, SDA lines     PA0 to PA6   D22 to D28, channel 0 first
 *   clock, SCL                PG0          D41
 *   chip select               PG1          D40
 *   MOSI (constant)           PG2          D39
 *   RS-485 bus                PD3, PD2     D18 out, D19 in; PG1 (D40) enables the driver
 *   quadrature A and B        PK0 to PK7   A8 to A15: channels 0 to 3, A on the even ones
 *                             PB0 to PB5   D53, D52, D51, D50, D10, D11: channels 4 to 6
 *   quadrature index          PC0 to PC6   D37 down to D31, channel 0 first
 *   thermometers              PF0 to PF3   A0 to A3
 *   mark while latching       PG5          D4, for an oscilloscope
 *   button, touch probe       PL1, PL0     D48, D49 (see clock.c)
 *
 * Ports A to G are within reach of single-cycle instructions: setting one bit of them
 * cannot be interrupted halfway. */
#ifndef PINS_H
#define PINS_H

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdbool.h>
#include <stdint.h>
#include <util/delay.h>

#include "settings.h"

#define PINS_DATA_MASK ((uint8_t)((1U << CHANNELS) - 1U))
#define PINS_WIRES_MASK ((uint8_t)((1U << THERMOMETERS) - 1U))

static inline void pins_set(volatile uint8_t *port, uint8_t bit, bool level)
{
    if (level) {
        *port = (uint8_t)(*port | (uint8_t)(1U << bit));
    } else {
        *port = (uint8_t)(*port & (uint8_t)~(1U << bit));
    }
}

static inline void pins_clock(bool level)
{
    pins_set(&PORTG, PG0, level);
}

static inline void pins_select(bool level)
{
    pins_set(&PORTG, PG1, level);
}

static inline void pins_mark(bool level)
{
    pins_set(&PORTG, PG5, level);
}

static inline uint8_t pins_data(void)
{
    return PINA;
}

/* Half a period of the clock, beside the instructions: 500 ns. */
static inline void pins_wait(void)
{
    _delay_us(0.3);
}

/* Microseconds known to the compiler only: the loop is counted in cycles. */
#define pins_wait_us(microseconds) _delay_us(microseconds)

/* Data lines in, pulled up, so that an absent encoder reads as ones; clock, chip select
 * and MOSI out, at rest. */
static inline void pins_init_shift(bool clock_rests, bool mosi)
{
    DDRA = 0U;
    PORTA = PINS_DATA_MASK;
    pins_clock(clock_rests);
    pins_select(true);
    pins_set(&PORTG, PG2, mosi);
    DDRG |= (uint8_t)(_BV(PG0) | _BV(PG1) | _BV(PG2) | _BV(PG5));
}

/* RS-485: the driver off; the line in pulled up, so that without a transceiver it rests. */
static inline void pins_init_bus(void)
{
    PORTD |= (uint8_t)_BV(PD2);
    pins_select(false);
    DDRG |= (uint8_t)(_BV(PG1) | _BV(PG5));
}

/* I2C: lines are driven low or released to their pull-up resistors, never driven high:
 * the output register stays 0, the direction register switches. */
static inline void pins_init_i2c(void)
{
    PORTA = 0U;
    DDRA = 0U;
    PORTG &= (uint8_t)~_BV(PG0);
    DDRG = (uint8_t)((DDRG & (uint8_t)~_BV(PG0)) | _BV(PG5));
}

static inline void pins_sda_low(uint8_t lines)
{
    DDRA = lines;
}

static inline void pins_scl(bool released)
{
    pins_set(&DDRG, PG0, !released);
}

/* Half a period of 400 kHz, beside the instructions. */
static inline void pins_wait_i2c(void)
{
    _delay_us(0.8);
}

/* Wires of thermometers: low, or released to their pull-up resistors. */
static inline void pins_wires_low(bool low)
{
    DDRF = low ? PINS_WIRES_MASK : 0U;
}

static inline uint8_t pins_wires(void)
{
    return PINF;
}

/* A and B in, pulled up, as are the index lines; a change of any calls an interrupt. */
static inline void pins_init_quadrature(void)
{
    PORTK = 0xFFU;
    PORTB = 0x3FU;
    PORTC = 0x7FU;
    DDRG |= _BV(PG5);
    PCMSK2 = 0xFFU;                 /* each line of port K */
    PCMSK0 = 0x3FU;                 /* lines 0 to 5 of port B */
    PCICR = _BV(PCIE2) | _BV(PCIE0); /* both groups */
}

static inline uint8_t pins_bank(uint8_t bank)
{
    return bank == 0U ? PINK : (uint8_t)(PINB & 0x3FU);
}

static inline uint8_t pins_index(void)
{
    return PINC;
}

/* Keep all interrupts away for some instructions. */
typedef uint8_t pins_state;

static inline pins_state pins_lock(void)
{
    const uint8_t state = SREG; /* its bit I: whether interrupts were allowed */
    cli();
    return state;
}

static inline void pins_unlock(pins_state state)
{
    __asm__ volatile("" ::: "memory"); /* what was written in between is written before */
    SREG = state;
}

#endif
