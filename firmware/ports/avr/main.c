/* The latch board on an Arduino Mega. */
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include "board.h"
#include "board_port.h"
#include "clock.h"
#include "encoders.h"
#include "pins.h"
#include "quadrature.h"
#include "settings.h"
#include "thermometers.h"
#include "uart.h"

/* What this processor latches, frames and sends with a third of its time to spare. */
#if FRONT_END == AS5600 && I2C_MULTIPLEXER
#define PROCESSOR_RATE_HZ 250U
#else
#define PROCESSOR_RATE_HZ 500U
#endif
#define MAX_RATE_HZ \
    (UART_SAMPLE_RATE_HZ < PROCESSOR_RATE_HZ ? UART_SAMPLE_RATE_HZ : PROCESSOR_RATE_HZ)
/* The way from an edge to its latch, with another latch or interrupt in between. */
#define LATE_TICKS (CLOCK_HZ / 20000U) /* 50 us */

static struct lb_board board;

/* It is counted in EEPROM: never the one before. A cell lasts for 100 000 power-ups. */
static uint32_t EEMEM stored_boot_id;

static uint32_t next_boot_id(void)
{
    const uint32_t boot_id = eeprom_read_dword(&stored_boot_id) + 1U;
    eeprom_update_dword(&stored_boot_id, boot_id);
    return boot_id;
}

/* The ATmega2560 has no sensor of its own. */
int16_t board_port_temperature(uint8_t sensor)
{
#if THERMOMETERS > 0
    return thermometers_hundredths_c(sensor);
#else
    (void)sensor;
    return LB_NO_SENSOR;
#endif
}

static struct lb_identity identity = {
    .board_id = {'m', 'e', 'g', 'a', '2', '5', '6', '0', 0U, 0U, (BOARD_NUMBER >> 8) & 0xFFU,
                 BOARD_NUMBER & 0xFFU},
    .firmware = {1U, 0U, 0U},
    .n_inputs = INPUTS,
    .n_temperatures = THERMOMETERS,
    .tick_rate_hz = CLOCK_HZ,
    .max_rate_millihz = MAX_RATE_HZ * 1000U,
    .late_ticks = LATE_TICKS,
};

#if FRONT_END == QUADRATURE
ISR(PCINT2_vect)
{
    quadrature_changed(0U, pins_bank(0U), pins_index());
}

ISR(PCINT0_vect)
{
    quadrature_changed(1U, pins_bank(1U), pins_index());
}
#endif

/* Sleep until an interrupt has left something to do. */
static void rest(void)
{
    cli();
    while (!clock_take_woken()) {
        sleep_enable();
        sei(); /* takes effect after the next instruction: no interrupt gets in between */
        sleep_cpu();
        sleep_disable();
        cli();
    }
    sei();
}

int main(void)
{
    SMCR = 0U; /* sleep is the mode idle: timers, captures and the line go on */
    identity.boot_id = next_boot_id();
    encoders_init(&identity);
    uart_init();
    clock_init(&board);
    clock_hold(); /* no input before the core knows it */
    sei();
    lb_init(&board, &identity, &board_port);
    clock_release();
    for (;;) {
        board_port_serve(&board);
        rest();
    }
}
