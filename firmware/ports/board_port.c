#include "board_port.h"

#include "clock.h"
#include "encoders.h"
#include "pins.h"
#include "settings.h"
#include "thermometers.h"
#include "uart.h"

static uint32_t latch(uint32_t *counts, uint8_t *status)
{
    clock_hold();
    pins_mark(true);
    const uint32_t tick = clock_ticks(); /* after the mark: interrupts between the two count */
    encoders_latch(counts, status);
    pins_mark(false);
    clock_release();
    return tick;
}

const struct lb_port board_port = {
    .ticks = clock_ticks,
    .latch = latch,
    .inputs = clock_inputs,
    .set_timer = clock_set_timer,
    .stop_timer = clock_stop_timer,
    .room = uart_room,
    .send = uart_send,
    .temperature = board_port_temperature,
    .lock = clock_hold,
    .unlock = clock_release,
};

void board_port_serve(struct lb_board *board)
{
    uint8_t byte;
    while (lb_can_receive(board) && uart_take(&byte)) {
        lb_receive(board, byte);
        /* Only a delimiter may be answered: until then room is not asked for again. */
        while (byte != 0U && uart_take(&byte)) {
            lb_receive(board, byte);
        }
    }
    lb_poll(board);
    encoders_watch(board, clock_hold, clock_release);
#if THERMOMETERS > 0
    thermometers_serve(clock_ticks(), CLOCK_HZ / 1000U);
#endif
}
