/* The core on a bench for its unit tests: a counter that stands still until it is moved,
 * encoders whose counts are the ticks of their latch, a line that keeps what is sent. */
#include <string.h>

#include "board.h"

#define SENT_BYTES 60000U

static struct {
    struct lb_board board;
    struct lb_identity identity;
    uint32_t ticks;
    uint32_t latch_takes; /* ticks */
    uint8_t inputs;
    bool timer_is_set;
    uint32_t timer_tick;
    uint32_t n_locked;
    uint16_t room;
    uint32_t n_sent;
    uint8_t sent[SENT_BYTES];
} bench;

static uint32_t ticks(void) { return bench.ticks; }
static uint8_t inputs(void) { return bench.inputs; }

static uint32_t latch(uint32_t *counts, uint8_t *status)
{
    bench.ticks += bench.latch_takes;
    for (uint8_t i = 0U; i < bench.identity.n_channels; i++) {
        counts[i] = bench.ticks + 1000U * i;
        status[i] = 0U;
    }
    return bench.ticks;
}

static void set_timer(uint32_t tick)
{
    bench.timer_tick = tick;
    bench.timer_is_set = true;
}

static void stop_timer(void) { bench.timer_is_set = false; }
static uint16_t room(void) { return bench.room; }

static void send(const uint8_t *bytes, uint16_t n_bytes)
{
    memcpy(&bench.sent[bench.n_sent], bytes, n_bytes);
    bench.n_sent += n_bytes;
    bench.room = (uint16_t)(bench.room - n_bytes);
}

static int16_t temperature(uint8_t sensor)
{
    return sensor == 0U ? (int16_t)2300 : LB_NO_SENSOR;
}

static void lock(void) { bench.n_locked++; }
static void unlock(void) { bench.n_locked--; }

static const struct lb_port port = {ticks, latch, inputs,      set_timer, stop_timer,
                                    room,  send,  temperature, lock,      unlock};

void bench_power_up(uint32_t tick_rate_hz, uint32_t first_ticks, uint8_t n_channels,
                    uint8_t n_temperatures)
{
    static const struct lb_identity board = {
        .board_id = {0x54, 0x52, 0x41, 0x56, 0x45, 0x52, 0x53, 0x45, 0, 0, 0, 7},
        .firmware = {1, 2, 3},
        .n_inputs = 2,
        .max_rate_millihz = 10000000,
        .boot_id = 0xDEADBEEF,
        .late_ticks = 3,
        .channels = {{23, 8388608}, {32, 1048576}},
    };
    memset(&bench, 0, sizeof bench);
    bench.identity = board;
    bench.identity.tick_rate_hz = tick_rate_hz;
    bench.identity.n_channels = n_channels;
    bench.identity.n_temperatures = n_temperatures;
    bench.ticks = first_ticks;
    bench.room = SENT_BYTES;
    lb_init(&bench.board, &bench.identity, &port);
}

/* Let time pass. The main loop runs after each interrupt and so often, at least; with 0
 * only once, at the end. */
void bench_advance(uint64_t n_ticks, uint32_t poll_every)
{
    const uint32_t longest = poll_every > 0U ? poll_every : UINT32_C(1) << 30;
    while (n_ticks > 0U) {
        uint32_t step = n_ticks < longest ? (uint32_t)n_ticks : longest;
        const uint32_t to_timer = bench.timer_tick - bench.ticks;
        const bool is_due = bench.timer_is_set && to_timer <= step;
        step = is_due ? to_timer : step;
        bench.ticks += step;
        n_ticks -= step;
        if (is_due) {
            bench.timer_is_set = false;
            lb_timer_due(&bench.board);
        }
        if (poll_every > 0U) {
            lb_poll(&bench.board);
        }
    }
    lb_poll(&bench.board);
}

/* Change the inputs after some ticks in which the main loop does not run. */
void bench_inputs(uint32_t n_ticks, uint8_t levels)
{
    bench.ticks += n_ticks;
    bench.inputs = levels;
    lb_inputs_changed(&bench.board, bench.ticks, bench.ticks, levels);
}

void bench_receive(const uint8_t *bytes, uint32_t n_bytes)
{
    for (uint32_t i = 0U; i < n_bytes; i++) {
        lb_receive(&bench.board, bytes[i]);
    }
}

uint32_t bench_take(uint8_t *bytes)
{
    const uint32_t n_bytes = bench.n_sent;
    memcpy(bytes, bench.sent, n_bytes);
    bench.n_sent = 0U;
    return n_bytes;
}

void bench_set_room(uint16_t n_bytes) { bench.room = n_bytes; }
void bench_set_latch_takes(uint32_t n_ticks) { bench.latch_takes = n_ticks; }
uint32_t bench_n_locked(void) { return bench.n_locked; }
void bench_host_gone(void) { lb_host_gone(&bench.board); }

int bench_alarm(uint8_t channel, uint8_t state, uint16_t code, int32_t value)
{
    const struct lb_alarm alarm = {channel, state, code, value};
    return lb_report_alarm(&bench.board, &alarm) ? 1 : 0;
}
