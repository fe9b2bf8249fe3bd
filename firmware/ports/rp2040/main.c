/* The latch board on a Raspberry Pi Pico. */
#include "board.h"
#include "board_port.h"
#include "clock.h"
#include "encoders.h"
#include "pins.h"
#include "settings.h"
#include "start.h"
#include "thermometers.h"
#include "uart.h"

#if FRONT_END == AS5600 && I2C_MULTIPLEXER
#define PROCESSOR_RATE_HZ 500U
#elif FRONT_END == AS5600 || FRONT_END == AMT21
#define PROCESSOR_RATE_HZ 2000U
#else
#define PROCESSOR_RATE_HZ 5000U
#endif
#define MAX_RATE_HZ \
    (UART_SAMPLE_RATE_HZ < PROCESSOR_RATE_HZ ? UART_SAMPLE_RATE_HZ : PROCESSOR_RATE_HZ)
/* The way from an edge to its latch, another latch in between not included. */
#define LATE_TICKS 10U
#define N_TEMPERATURES (THERMOMETERS + 1U) /* the last is the chip's */

static struct lb_board board;

/* 32 bits of the ring oscillator, which runs without relation to the crystal. */
static uint32_t draw_boot_id(void)
{
    uint32_t drawn = 0U;
    for (uint32_t i = 0U; i < 32U; i++) {
        drawn = (drawn << 1) | (ROSC_RANDOMBIT & 1U);
        pins_wait_us(3U);
    }
    return drawn;
}

/* The thermometers, then the chip's own sensor: 0.706 V at 27 Celsius, 1.721 mV less for each degree more. */
int16_t board_port_temperature(uint8_t sensor)
{
#if THERMOMETERS > 0
    if (sensor < THERMOMETERS) {
        return thermometers_hundredths_c(sensor);
    }
#else
    (void)sensor;
#endif
    ADC_CS = 3U | (4U << 12) | (1U << 2); /* on, sensor on; its channel; convert once */
    while ((ADC_CS & (1U << 8)) == 0U) {
    }
    const int32_t microvolts = (int32_t)((ADC_RESULT * 103125U) / 128U); /* of 3.3 V / 4096 */
    return (int16_t)(2700 - (((microvolts - 706000) * 100) / 1721));
}

static struct lb_identity identity = {
    .board_id = {'p', 'i', 'c', 'o', ' ', ' ', ' ', ' ', 0U, 0U, (BOARD_NUMBER >> 8) & 0xFFU,
                 BOARD_NUMBER & 0xFFU},
    .firmware = {1U, 0U, 0U},
    .n_inputs = INPUTS,
    .n_temperatures = N_TEMPERATURES,
    .tick_rate_hz = CLOCK_HZ,
    .max_rate_millihz = MAX_RATE_HZ * 1000U,
    .late_ticks = LATE_TICKS,
};

_Noreturn void main_program(void)
{
    start_clocks();
    pins_init_pin(PIN_MARK);
    GPIO_OE_SET = 1U << PIN_MARK;
    identity.boot_id = draw_boot_id();
    encoders_init(&identity);
    pins_init_wires();
    uart_init();
    clock_init_inputs();
    lb_init(&board, &identity, &board_port);
    clock_init(&board);
    for (;;) {
        board_port_serve(&board);
        __asm__ volatile("wfi"); /* at most a millisecond: timer_wakes */
    }
}
