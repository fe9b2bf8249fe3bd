/* Pins of a Raspberry Pi Pico, by their GPIO numbers.
 *
 *   UART                      0 (out), 1 (in)
 *   data lines, SDA lines     2 to 8, channel 0 first
 *   clock, SCL                9
 *   chip select, MOSI         10, 11
 *   RS-485 bus                4 (out), 5 (in); 10 enables the driver
 *   quadrature A and B        2 to 15, A of channel 0, B of channel 0, A of channel 1 ...
 *   quadrature index          19 to 22, 26 to 28, channel 0 first
 *   thermometers              26 to 28: not with index lines
 *   button, touch probe       16, 17
 *   mark while latching       18, for an oscilloscope */
#ifndef PINS_H
#define PINS_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"
#include "settings.h"

#if THERMOMETERS > 0 && FRONT_END == QUADRATURE && INDEX_WIRED
#error "GPIO 26 to 28 are index lines: thermometers need encoders of another kind, or INDEX_WIRED=0"
#endif

#define PINS_DATA_MASK ((uint8_t)((1U << CHANNELS) - 1U))
#define PINS_WIRES_MASK ((1U << THERMOMETERS) - 1U)
#define PIN_FIRST_LINE 2U
#define PIN_FIRST_WIRE 26U
#define PIN_CLOCK 9U
#define PIN_SELECT 10U
#define PIN_MOSI 11U
#define PIN_BUS_OUT 4U
#define PIN_BUS_IN 5U
#define PIN_FIRST_INPUT 16U
#define PIN_MARK 18U
#define CYCLES_PER_US 125U

static inline void pins_set(uint32_t pin, bool level)
{
    if (level) {
        GPIO_OUT_SET = 1U << pin;
    } else {
        GPIO_OUT_CLR = 1U << pin;
    }
}

static inline void pins_clock(bool level)
{
    pins_set(PIN_CLOCK, level);
}

static inline void pins_select(bool level)
{
    pins_set(PIN_SELECT, level);
}

static inline void pins_mark(bool level)
{
    pins_set(PIN_MARK, level);
}

static inline uint8_t pins_data(void)
{
    return (uint8_t)(GPIO_IN >> PIN_FIRST_LINE) & PINS_DATA_MASK;
}

/* Three cycles a turn of the loop. */
static inline void pins_wait_cycles(uint32_t cycles)
{
    uint32_t turns = cycles / 3U;
    __asm__ volatile("1: subs %0, #1\n bne 1b" : "+l"(turns) : : "cc");
}

/* Half a period of the clock: 500 ns. */
static inline void pins_wait(void)
{
    pins_wait_cycles(CYCLES_PER_US / 2U);
}

#define pins_wait_us(microseconds) pins_wait_cycles((microseconds)*CYCLES_PER_US)

/* Half a period of 400 kHz. */
static inline void pins_wait_i2c(void)
{
    pins_wait_cycles(CYCLES_PER_US * 5U / 4U);
}

static inline void pins_init_pin(uint32_t pin)
{
    PADS(pin) = PADS_INPUT_PULLED_UP;
    IO_CTRL(pin) = FUNCTION_SIO;
}

static inline void pins_init_lines(uint32_t end)
{
    for (uint32_t pin = PIN_FIRST_LINE; pin < end; pin++) {
        pins_init_pin(pin);
    }
}

static inline void pins_init_shift(bool clock_rests, bool mosi)
{
    pins_init_lines(PIN_MOSI + 1U);
    pins_clock(clock_rests);
    pins_select(true);
    pins_set(PIN_MOSI, mosi);
    GPIO_OE_SET = (1U << PIN_CLOCK) | (1U << PIN_SELECT) | (1U << PIN_MOSI);
}

/* RS-485: the driver off; the line in pulled up, so that without a transceiver it rests. */
static inline void pins_init_bus(void)
{
    PADS(PIN_BUS_IN) = PADS_INPUT_PULLED_UP;
    IO_CTRL(PIN_BUS_OUT) = FUNCTION_UART;
    IO_CTRL(PIN_BUS_IN) = FUNCTION_UART;
    pins_init_pin(PIN_SELECT);
    pins_select(false);
    GPIO_OE_SET = 1U << PIN_SELECT;
}

/* I2C: lines are driven low or released: the output stays 0, the direction switches. */
static inline void pins_init_i2c(void)
{
    pins_init_lines(PIN_CLOCK + 1U);
    GPIO_OUT_CLR = ((uint32_t)PINS_DATA_MASK << PIN_FIRST_LINE) | (1U << PIN_CLOCK);
}

static inline void pins_sda_low(uint8_t lines)
{
    const uint32_t low = (uint32_t)lines << PIN_FIRST_LINE;
    GPIO_OE_CLR = ((uint32_t)PINS_DATA_MASK << PIN_FIRST_LINE) & ~low;
    GPIO_OE_SET = low;
}

static inline void pins_scl(bool released)
{
    if (released) {
        GPIO_OE_CLR = 1U << PIN_CLOCK;
    } else {
        GPIO_OE_SET = 1U << PIN_CLOCK;
    }
}

/* Wires of thermometers: low, or released to their pull-up resistors. */
static inline void pins_init_wires(void)
{
    for (uint32_t pin = PIN_FIRST_WIRE; pin < PIN_FIRST_WIRE + THERMOMETERS; pin++) {
        pins_init_pin(pin);
    }
    GPIO_OUT_CLR = PINS_WIRES_MASK << PIN_FIRST_WIRE;
}

static inline void pins_wires_low(bool low)
{
    if (low) {
        GPIO_OE_SET = PINS_WIRES_MASK << PIN_FIRST_WIRE;
    } else {
        GPIO_OE_CLR = PINS_WIRES_MASK << PIN_FIRST_WIRE;
    }
}

static inline uint8_t pins_wires(void)
{
    return (uint8_t)(GPIO_IN >> PIN_FIRST_WIRE);
}

/* A and B in, each of their edges an interrupt. */
static inline void pins_init_quadrature(void)
{
    pins_init_lines(16U);
    for (uint32_t pin = 19U; pin <= 28U; pin++) {
        if (pin <= 22U || pin >= 26U) {
            pins_init_pin(pin);
        }
    }
    IO_PROC0_INTE(0U) = 0xCCCCCC00U; /* pins 2 to 7 */
    IO_PROC0_INTE(1U) = 0xCCCCCCCCU; /* pins 8 to 15 */
}

static inline uint8_t pins_bank(uint8_t bank)
{
    const uint32_t levels = GPIO_IN;
    return bank == 0U ? (uint8_t)(levels >> 2) : (uint8_t)(levels >> 10) & 0x3FU;
}

static inline uint8_t pins_index(void)
{
    const uint32_t levels = GPIO_IN;
    return (uint8_t)(((levels >> 19) & 0xFU) | ((levels >> 22) & 0x70U));
}

/* Keep all interrupts away for some instructions. */
typedef uint32_t pins_state;

static inline pins_state pins_lock(void)
{
    pins_state state;
    __asm__ volatile("mrs %0, primask\n cpsid i" : "=r"(state) : : "memory");
    return state;
}

static inline void pins_unlock(pins_state state)
{
    __asm__ volatile("msr primask, %0" : : "r"(state) : "memory");
}

#endif
