#define _POSIX_C_SOURCE 200809L

#include "machine.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "line.h"

#define MICROSECONDS 1000000
#define NANOSECONDS_PER_US 1000
#define MAX_RATE_MILLIHZ 10000000U /* 10 kHz, the largest of the protocol */
#define LATE_TICKS 1U
#define N_TEMPERATURES 2U
#define ROOM_BYTES 4096U /* for the frames of one instant, with all edges that wait */
#define LONGEST_LAG_US (5U * MICROSECONDS)

struct encoder {
    uint32_t count;       /* when it was set in motion or set */
    uint64_t since_us;    /* the instant of that */
    int32_t counts_per_s; /* 0: it rests */
    uint8_t status;
};

static struct {
    struct lb_board board;
    struct lb_identity identity;
    struct timespec power_up;
    uint32_t first_ticks;
    uint64_t now_us; /* since power-up; the machine may be behind the computer's time */
    bool timer_is_set;
    uint64_t timer_us;
    uint8_t inputs;
    struct encoder encoders[LB_MAX_CHANNELS];
    int16_t temperatures[N_TEMPERATURES];
} machine;

static uint64_t modulus(void)
{
    return UINT64_C(1) << machine.identity.channels[0].bits;
}

/* ---- functions of the port ------------------------------------------------------------ */

static uint32_t ticks(void)
{
    return machine.first_ticks + (uint32_t)machine.now_us;
}

static uint32_t count_of(const struct encoder *encoder)
{
    const int64_t elapsed_us = (int64_t)(machine.now_us - encoder->since_us);
    int64_t moved = (elapsed_us * encoder->counts_per_s) / MICROSECONDS;
    moved = (moved + (int64_t)encoder->count) % (int64_t)modulus();
    return (uint32_t)(moved < 0 ? moved + (int64_t)modulus() : moved);
}

static uint32_t latch(uint32_t *counts, uint8_t *status)
{
    for (uint8_t i = 0U; i < machine.identity.n_channels; i++) {
        counts[i] = count_of(&machine.encoders[i]);
        status[i] = machine.encoders[i].status;
    }
    return ticks();
}

static uint8_t inputs(void)
{
    return machine.inputs;
}

static void set_timer(uint32_t tick)
{
    const int32_t ahead = (int32_t)(tick - ticks());
    machine.timer_us = machine.now_us + (uint64_t)(ahead > 0 ? ahead : 0);
    machine.timer_is_set = true;
}

static void stop_timer(void)
{
    machine.timer_is_set = false;
}

static int16_t temperature(uint8_t sensor)
{
    return machine.temperatures[sensor];
}

/* Interrupts are called from one thread here: there is nothing to keep away. */
static void lock(void)
{
}

static void unlock(void)
{
}

static const struct lb_port port = {
    .ticks = ticks,
    .latch = latch,
    .inputs = inputs,
    .set_timer = set_timer,
    .stop_timer = stop_timer,
    .room = line_room,
    .send = line_send,
    .temperature = temperature,
    .lock = lock,
    .unlock = unlock,
};

/* ---- its life ------------------------------------------------------------------------- */

static uint64_t computer_us(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return ((uint64_t)(now.tv_sec - machine.power_up.tv_sec) * MICROSECONDS) +
           (uint64_t)(((int64_t)now.tv_nsec - machine.power_up.tv_nsec) / NANOSECONDS_PER_US);
}

/* Never the one before: it counts from a number that differs from run to run. */
static uint32_t next_boot_id(void)
{
    static uint32_t boot_id;
    if (boot_id == 0U) {
        boot_id = (uint32_t)machine.power_up.tv_nsec ^ ((uint32_t)getpid() << 16);
    }
    boot_id++;
    return boot_id;
}

void machine_power_up(const struct machine_options *options)
{
    static const uint8_t board_id[12] = {'h', 'o', 's', 't', ' ', 'b', 'o', 'a', 'r', 'd', 0, 1};
    struct lb_identity *identity = &machine.identity;

    memset(&machine, 0, sizeof machine);
    (void)clock_gettime(CLOCK_MONOTONIC, &machine.power_up);
    machine.first_ticks = options->first_ticks;
    machine.temperatures[0] = 2300;
    machine.temperatures[1] = LB_NO_SENSOR;
    memcpy(identity->board_id, board_id, sizeof board_id);
    identity->firmware[0] = 1U;
    identity->n_channels = (uint8_t)options->n_channels;
    identity->n_inputs = (uint8_t)options->n_inputs;
    identity->n_temperatures = N_TEMPERATURES;
    identity->tick_rate_hz = TICK_RATE_HZ;
    identity->max_rate_millihz = options->n_channels > 0U ? MAX_RATE_MILLIHZ : 0U;
    identity->boot_id = next_boot_id();
    identity->late_ticks = LATE_TICKS;
    for (uint32_t i = 0U; i < LB_MAX_CHANNELS; i++) {
        identity->channels[i].bits = (uint8_t)options->bits;
    }
    lb_init(&machine.board, identity, &port);
}

/* A host that reads late, as on a busy computer, holds the machine's time up, not its
 * samples; one that does not read at all loses them. */
static bool is_held_up(uint64_t now_us)
{
    return line_room() < ROOM_BYTES && now_us < machine.now_us + LONGEST_LAG_US;
}

void machine_live(void)
{
    const uint64_t until_us = computer_us();
    while (machine.timer_is_set && machine.timer_us <= until_us) {
        if (line_room() < ROOM_BYTES) {
            line_flush();
        }
        if (is_held_up(until_us)) {
            return;
        }
        machine.now_us = machine.timer_us;
        machine.timer_is_set = false;
        lb_timer_due(&machine.board);
        lb_poll(&machine.board);
    }
    machine.now_us = until_us;
    lb_poll(&machine.board);
}

uint32_t machine_idle_us(uint32_t longest_us)
{
    const uint64_t now_us = computer_us();
    if (!machine.timer_is_set || machine.timer_us >= now_us + longest_us || is_held_up(now_us)) {
        return longest_us;
    }
    return machine.timer_us > now_us ? (uint32_t)(machine.timer_us - now_us) : 0U;
}

struct lb_board *machine_board(void)
{
    return &machine.board;
}

/* ---- what a script does --------------------------------------------------------------- */

bool machine_set_count(uint32_t channel, uint32_t count)
{
    if (channel >= machine.identity.n_channels || count >= modulus()) {
        return false;
    }
    machine.encoders[channel].count = count;
    machine.encoders[channel].counts_per_s = 0;
    return true;
}

bool machine_turn(uint32_t channel, int32_t counts_per_s)
{
    if (channel >= machine.identity.n_channels) {
        return false;
    }
    struct encoder *encoder = &machine.encoders[channel];
    encoder->count = count_of(encoder);
    encoder->since_us = machine.now_us;
    encoder->counts_per_s = counts_per_s;
    return true;
}

bool machine_set_status(uint32_t channel, uint32_t status)
{
    if (channel >= machine.identity.n_channels || status > UINT8_MAX) {
        return false;
    }
    machine.encoders[channel].status = (uint8_t)status;
    return true;
}

bool machine_set_input(uint32_t input, uint32_t level)
{
    if (input >= machine.identity.n_inputs || level > 1U) {
        return false;
    }
    const uint8_t bit = (uint8_t)(1U << input);
    const uint8_t levels =
        (uint8_t)(level != 0U ? machine.inputs | bit : machine.inputs & (uint8_t)~bit);
    if (levels != machine.inputs) {
        machine.inputs = levels;
        const uint32_t tick = ticks();
        lb_inputs_changed(&machine.board, tick, tick, levels);
    }
    return true;
}

bool machine_set_temperature(uint32_t sensor, int32_t hundredths_c)
{
    if (sensor >= N_TEMPERATURES || hundredths_c < INT16_MIN || hundredths_c > INT16_MAX) {
        return false;
    }
    machine.temperatures[sensor] = (int16_t)hundredths_c;
    return true;
}
