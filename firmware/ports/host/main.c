/* The latch board as a program: its line is a pty, its encoders and inputs obey commands
 * on standard input. Usage: latch-board [OPTION VALUE]...
 *
 *   --link PATH        of the link to the pty, as a host opens it (default: latch-board)
 *   --channels N       0 to 32 encoders (7)
 *   --inputs N         0 to 8 (2)
 *   --bits N           1 to 32, of each encoder (23)
 *   --first-ticks N    the counter at power-up (0)
 */
#define _POSIX_C_SOURCE 200809L

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"
#include "line.h"
#include "machine.h"
#include "script.h"

#define LONGEST_IDLE_US 1000U
#define REFUSED 2

struct arguments {
    const char *link;
    struct machine_options machine;
};

/* Read a number up to a limit; false where the text is none. */
static bool number(const char *text, uint32_t limit, uint32_t *value)
{
    char *end = NULL;
    errno = 0;
    const unsigned long read = strtoul(text, &end, 0);
    *value = (uint32_t)read;
    return errno == 0 && end != text && *end == '\0' && text[0] != '-' && read <= limit;
}

static bool take_option(struct arguments *arguments, const char *name, const char *text)
{
    struct machine_options *machine = &arguments->machine;
    if (strcmp(name, "--link") == 0) {
        arguments->link = text;
        return text[0] != '\0';
    }
    if (strcmp(name, "--channels") == 0) {
        return number(text, LB_MAX_CHANNELS, &machine->n_channels);
    }
    if (strcmp(name, "--inputs") == 0) {
        return number(text, LB_MAX_INPUTS, &machine->n_inputs);
    }
    if (strcmp(name, "--bits") == 0) {
        return number(text, 32U, &machine->bits) && machine->bits > 0U;
    }
    if (strcmp(name, "--first-ticks") == 0) {
        return number(text, UINT32_MAX, &machine->first_ticks);
    }
    return false;
}

/* Pass the host's bytes to the board while it can answer. */
static void receive(void)
{
    uint8_t byte;
    while (lb_can_receive(machine_board()) && line_read(&byte, 1U) == 1U) {
        lb_receive(machine_board(), byte);
    }
}

static bool execute(const char *text, const void *context)
{
    const struct arguments *arguments = context;
    return script_execute(text, &arguments->machine, arguments->link);
}

int main(int argc, char **argv)
{
    struct arguments arguments = {
        .link = "latch-board",
        .machine = {.n_channels = 7U, .n_inputs = 2U, .bits = 23U, .first_ticks = 0U},
    };
    for (int i = 1; i < argc; i += 2) {
        if (i + 1 >= argc || !take_option(&arguments, argv[i], argv[i + 1])) {
            fprintf(stderr, "latch-board: bad option %s; see the head of main.c\n", argv[i]);
            return REFUSED;
        }
    }
    machine_power_up(&arguments.machine);
    if (!line_plug(arguments.link)) {
        fprintf(stderr, "latch-board: no pty at %s: %s\n", arguments.link, strerror(errno));
        return REFUSED;
    }
    printf("ready %s\n", arguments.link);
    (void)fflush(stdout);

    bool is_on = true;
    while (is_on) {
        /* A descriptor of -1 is not waited for. */
        struct pollfd ready[2] = {
            {.fd = STDIN_FILENO, .events = POLLIN},
            {.fd = line_descriptor(), .events = POLLIN},
        };
        if (line_host_gone()) {
            lb_host_gone(machine_board());
        }
        const uint32_t idle_us = machine_idle_us(LONGEST_IDLE_US);
        const int idle_ms = (int)((idle_us + 999U) / 1000U);
        if (poll(ready, 2, idle_ms) < 0 && errno != EINTR) {
            break;
        }
        machine_live();
        if (ready[1].revents != 0) {
            receive();
        }
        if (ready[0].revents != 0) {
            is_on = commands_obey(execute, &arguments);
        }
        machine_live();
        line_flush();
    }
    line_unplug(arguments.link);
    return 0;
}
