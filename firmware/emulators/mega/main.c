/* mega-emulator: the firmware of an Arduino Mega, run by libsimavr with its line on a pty.
 *
 *   mega-emulator --elf FILE --link PATH [--encoders KIND] [--channels 7] [--bits 19]
 *                 [--counts-per-turn 0] [--first-ticks 0]
 *
 * It prints `ready PATH`, obeys the commands of `commands` below, one a line, and answers
 * each with `done`, with what was asked for, or with `error: ...`. Emulated time keeps the
 * pace of the computer's clock; where the computer is too slow it falls behind, and `show`
 * says by how much. */
#define _POSIX_C_SOURCE 200809L

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "commands.h"
#include "encoders.h"
#include "line.h"
#include "machine.h"
#include "message.h"
#include "motion.h"
#include "thermometers.h"

#define REFUSED 2
#define SLICE_CYCLES (CYCLES_PER_S / 2000U) /* at most so long without a look at the line */
#define LONGEST_LAG_NS 50000000
#define KEPT_CYCLES (CYCLES_PER_S / 8U) /* an edge that was not sent again for so long is forgotten */
#define EDGES 32U

static const char *const commands =
    "count CHANNEL COUNT, turn CHANNEL COUNTS_PER_S, step CHANNEL COUNTS_PER_S, "
    "fail CHANNEL 0 to 4 (nothing, weak, no magnet, absent, bad check), input NUMBER LEVEL, "
    "temperature THERMOMETER HUNDREDTHS_C, bounce NUMBER LEVEL CHANGES, lose SAMPLES, spoil TYPE, "
    "unplug, plug, power, forward SECONDS, "
    "latency, show, quit";

struct options {
    const char *elf;
    const char *link;
    const char *encoders;
    unsigned n_channels;
    unsigned bits;
    uint32_t counts_per_turn;
    uint32_t first_ticks;
};

static struct {
    uint8_t frame[300]; /* that the board is sending */
    uint16_t n_frame;
    struct {
        uint32_t seq;
        uint64_t sent_at;
    } edges[EDGES];
    uint32_t next_edge;
    uint8_t waiting[4096]; /* bytes of the host */
    size_t n_waiting;
    uint64_t changed_at; /* the last first change of an input */
    uint32_t counts_then[MOTIONS];
    uint64_t marked_at;  /* and the latch after it; 0: none yet */
    int64_t lag_ns;
    struct timespec origin; /* computer's time of the cycle `origin_cycle` */
    uint64_t origin_cycle;
} world;

/* ---- the line ------------------------------------------------------------------------ */

/* The number of an EDGE: bytes 4 to 7 of its body, which COBS has stuffed. */
static uint32_t edge_seq(const uint8_t *frame, uint16_t n_frame)
{
    uint8_t body[300] = {0};
    uint16_t n_body = 0U;
    for (uint16_t from = 0U; from + 1U < n_frame;) {
        const uint16_t next = (uint16_t)(from + frame[from]);
        for (from++; from < next && from < n_frame; from++) {
            body[n_body++] = frame[from];
        }
        body[n_body++] = 0U;
    }
    return (uint32_t)body[4] | (uint32_t)body[5] << 8 | (uint32_t)body[6] << 16 |
           (uint32_t)body[7] << 24;
}

static void note_edge(void)
{
    const uint32_t seq = edge_seq(world.frame, world.n_frame);
    world.edges[seq % EDGES].seq = seq;
    world.edges[seq % EDGES].sent_at = machine->cycle;
    if (seq >= world.next_edge) {
        world.next_edge = seq + 1U;
    }
}

static void sent(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    if (world.n_frame < sizeof world.frame) {
        world.frame[world.n_frame++] = (uint8_t)value;
    }
    if (value == 0U) {
        if (world.n_frame > 4U && world.frame[1] == LB_EDGE_TYPE) {
            note_edge();
        }
        line_send(world.frame, world.n_frame);
        world.n_frame = 0U;
    }
}

static void receive(void)
{
    (void)line_descriptor(); /* whether the host has opened it by now */
    world.n_waiting +=
        line_read(&world.waiting[world.n_waiting], sizeof world.waiting - world.n_waiting);
    size_t n_taken = 0U;
    while (n_taken < world.n_waiting && machine_receive(world.waiting[n_taken])) {
        n_taken++;
    }
    world.n_waiting -= n_taken;
    memmove(world.waiting, &world.waiting[n_taken], world.n_waiting);
}

/* ---- time ---------------------------------------------------------------------------- */

static int64_t elapsed_ns(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)(now.tv_sec - world.origin.tv_sec) * 1000000000 +
           (now.tv_nsec - world.origin.tv_nsec);
}

static void begin_pace(void)
{
    (void)clock_gettime(CLOCK_MONOTONIC, &world.origin);
    world.origin_cycle = machine->cycle;
}

/* Run until emulated time is the computer's. */
static bool live(void)
{
    uint64_t target = world.origin_cycle + (uint64_t)elapsed_ns() * (CYCLES_PER_S / 1000000U) / 1000U;
    const uint64_t lag_ns = (target - machine->cycle) * 1000U / (CYCLES_PER_S / 1000000U);
    if (target > machine->cycle && lag_ns > LONGEST_LAG_NS) {
        world.lag_ns += (int64_t)lag_ns;
        begin_pace();
        target = machine->cycle + SLICE_CYCLES;
    }
    bool runs = true;
    while (runs && machine->cycle < target) {
        const uint64_t next = machine->cycle + SLICE_CYCLES;
        runs = machine_run(next < target ? next : target);
        receive();
        line_flush();
    }
    return runs;
}

/* ---- the button, and the mark of a latch ------------------------------------------------ */

static void marked(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (value != 0U && irq->value == 0U) {
        if (world.marked_at == 0U) {
            world.marked_at = machine->cycle;
        }
        for (unsigned i = 0U; i < MOTIONS; i++) {
            motion_latched(&motions[i], machine->cycle);
        }
    }
}

/* Inputs 0 and 1 are at PL1 and PL0, contacts to ground. */
static void set_input(unsigned input, bool active)
{
    machine_set_line('L', input == 0U ? 1U : 0U, !active);
}

static void bounce(unsigned input, bool active, unsigned n_changes)
{
    world.changed_at = machine->cycle;
    world.marked_at = 0U;
    encoders_await_latch();
    for (unsigned i = 0U; i < MOTIONS; i++) {
        world.counts_then[i] = motion_count(&motions[i], machine->cycle);
    }
    set_input(input, active);
    bool level = active;
    for (unsigned i = 1U; i < n_changes || level != active; i++) {
        (void)machine_run(machine->cycle + 700U * i); /* 44 us, 88 us, ... */
        level = !level;
        set_input(input, level);
    }
    (void)machine_run(machine->cycle + SLICE_CYCLES); /* a hand is not faster */
}

static void print_latency(void)
{
    printf("contact %" PRIu64 " mark %" PRId64 " counts", world.changed_at,
           (int64_t)(world.marked_at - world.changed_at));
    for (unsigned i = 0U; i < MOTIONS; i++) {
        printf(" %" PRIu32, world.counts_then[i]);
    }
    printf(" channels");
    for (unsigned i = 0U; i < MOTIONS; i++) {
        const uint64_t latched_at = encoders_latched_at(i);
        if (latched_at != 0U) {
            printf(" %" PRId64, (int64_t)(latched_at - world.changed_at));
        }
    }
    printf("\n");
}

/* ---- commands ------------------------------------------------------------------------- */

static void show(void)
{
    unsigned n_kept = 0U;
    for (unsigned i = 0U; i < EDGES; i++) {
        if (world.edges[i].sent_at != 0U && world.edges[i].sent_at + KEPT_CYCLES > machine->cycle) {
            n_kept++;
        }
    }
    printf("lag_ms %" PRId64 " next_edge %" PRIu32 " unacknowledged %u cycle %" PRIu64 "\n",
           world.lag_ns / 1000000, world.next_edge, n_kept, (uint64_t)machine->cycle);
}

static void power(void)
{
    machine_power();
    for (unsigned i = 0U; i < EDGES; i++) {
        world.edges[i].sent_at = 0U;
    }
    world.next_edge = 0U;
    world.n_frame = 0U;
    world.n_waiting = 0U;
    encoders_restart();
    thermometers_restart();
}

/* A command with numbers; false where it is none. */
static bool change(const char *command, const double *numbers, int n_numbers)
{
    const unsigned first = (unsigned)numbers[0];
    const bool is_channel = first < MOTIONS;
    struct motion *motion = &motions[is_channel ? first : 0U];
    const uint64_t cycle = machine->cycle;
    if (strcmp(command, "count") == 0 && n_numbers == 2 && is_channel) {
        motion_set(motion, numbers[1] + 0.5, 0.0, cycle);
        encoders_restart();
    } else if ((strcmp(command, "turn") == 0 || strcmp(command, "step") == 0) && n_numbers == 2 &&
               is_channel) {
        motion_set(motion, motion_position(motion, cycle), numbers[1], cycle);
        motion->in_step = command[0] == 's';
        encoders_restart();
    } else if (strcmp(command, "fail") == 0 && n_numbers == 2 && is_channel) {
        encoders_fail(first, (enum fault)numbers[1]);
    } else if (strcmp(command, "temperature") == 0 && n_numbers == 2 && first < THERMOMETER_WIRES) {
        thermometers_set(first, (int)numbers[1]);
    } else if (strcmp(command, "input") == 0 && n_numbers == 2) {
        bounce(first, numbers[1] != 0.0, 1U);
    } else if (strcmp(command, "bounce") == 0 && n_numbers == 3) {
        bounce(first, numbers[1] != 0.0, (unsigned)numbers[2]);
    } else if (strcmp(command, "lose") == 0 && n_numbers == 1) {
        line_lose(first);
    } else if (strcmp(command, "spoil") == 0 && n_numbers == 1) {
        line_spoil((uint8_t)first);
    } else if (strcmp(command, "forward") == 0 && n_numbers == 1) {
        (void)machine_run(cycle + (uint64_t)(numbers[0] * CYCLES_PER_S));
        begin_pace();
    } else {
        return false;
    }
    return true;
}

static bool execute(const char *text, const void *context)
{
    const struct options *options = context;
    char command[16] = "";
    double numbers[3] = {0.0, 0.0, 0.0};
    const int n_words =
        sscanf(text, "%15s %lf %lf %lf", command, &numbers[0], &numbers[1], &numbers[2]);
    bool is_done = true;
    if (strcmp(command, "quit") == 0) {
        return false;
    }
    if (strcmp(command, "show") == 0) {
        show();
    } else if (strcmp(command, "latency") == 0) {
        print_latency();
    } else {
        if (strcmp(command, "power") == 0) {
            power();
        } else if (strcmp(command, "unplug") == 0) {
            line_unplug(options->link);
        } else if (strcmp(command, "plug") == 0) {
            is_done = line_plug(options->link);
        } else {
            is_done = change(command, numbers, n_words - 1);
        }
        if (is_done) {
            printf("done\n");
        } else {
            printf("error: '%s' is no command of this emulator; expected %s\n", text, commands);
        }
    }
    (void)fflush(stdout);
    return true;
}

static bool take_option(struct options *options, const char *name, const char *value)
{
    if (strcmp(name, "--elf") == 0) {
        options->elf = value;
    } else if (strcmp(name, "--link") == 0) {
        options->link = value;
    } else if (strcmp(name, "--encoders") == 0) {
        options->encoders = value;
    } else if (strcmp(name, "--channels") == 0) {
        options->n_channels = (unsigned)strtoul(value, NULL, 10);
    } else if (strcmp(name, "--bits") == 0) {
        options->bits = (unsigned)strtoul(value, NULL, 10);
    } else if (strcmp(name, "--counts-per-turn") == 0) {
        options->counts_per_turn = (uint32_t)strtoul(value, NULL, 10);
    } else if (strcmp(name, "--first-ticks") == 0) {
        options->first_ticks = (uint32_t)strtoul(value, NULL, 10);
    } else {
        return false;
    }
    return options->n_channels <= MOTIONS && options->bits <= 32U;
}

int main(int argc, char **argv)
{
    struct options options = {.elf = "mega.elf", .link = "mega", .encoders = "quadrature",
                              .n_channels = MOTIONS, .bits = 19U};
    for (int i = 1; i < argc; i += 2) {
        if (i + 1 >= argc || !take_option(&options, argv[i], argv[i + 1])) {
            fprintf(stderr, "mega-emulator: bad option %s; see the head of main.c\n", argv[i]);
            return REFUSED;
        }
    }
    const uint32_t boot_id = (uint32_t)time(NULL) ^ ((uint32_t)getpid() << 16);
    if (!machine_load(options.elf, options.first_ticks, boot_id)) {
        fprintf(stderr, "mega-emulator: %s cannot be loaded\n", options.elf);
        return REFUSED;
    }
    set_input(0U, false);
    set_input(1U, false);
    if (!encoders_init(options.encoders, options.n_channels, options.bits, options.counts_per_turn)) {
        fprintf(stderr, "mega-emulator: no model of encoders %s\n", options.encoders);
        return REFUSED;
    }
    thermometers_init();
    machine_on_sent(sent);
    machine_watch_line('G', 5U, marked);
    if (!line_plug(options.link)) {
        fprintf(stderr, "mega-emulator: no pty at %s: %s\n", options.link, strerror(errno));
        return REFUSED;
    }
    (void)machine_run(CYCLES_PER_S / 20U); /* until the firmware counts */
    printf("ready %s\n", options.link);
    (void)fflush(stdout);

    begin_pace();
    bool is_on = true;
    while (is_on) {
        /* A descriptor of -1 is not waited for. */
        struct pollfd ready[2] = {
            {.fd = STDIN_FILENO, .events = POLLIN},
            {.fd = line_descriptor(), .events = POLLIN},
        };
        if (poll(ready, 2, 1) < 0 && errno != EINTR) {
            break;
        }
        if (!live()) {
            fprintf(stderr, "mega-emulator: the firmware has crashed at %#x\n",
                    (unsigned)machine->pc);
            break;
        }
        if ((ready[0].revents & (POLLIN | POLLHUP)) != 0) {
            is_on = commands_obey(execute, &options);
        }
    }
    line_unplug(options.link);
    return 0;
}
