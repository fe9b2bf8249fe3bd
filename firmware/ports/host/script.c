#include "script.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "line.h"

#define COMMAND_BYTES 16

static const char *const commands =
    "count CHANNEL COUNT, turn CHANNEL COUNTS_PER_S, status CHANNEL BITS, input NUMBER LEVEL, "
    "temperature SENSOR HUNDREDTHS_C, alarm CHANNEL STATE CODE VALUE, lose SAMPLES, spoil TYPE, "
    "unplug, plug, power, show, quit";

static bool alarm_of(const int64_t *numbers)
{
    const struct lb_alarm alarm = {
        .channel = (uint8_t)numbers[0],
        .state = (uint8_t)numbers[1],
        .code = (uint16_t)numbers[2],
        .value = (int32_t)numbers[3],
    };
    return lb_report_alarm(machine_board(), &alarm);
}

/* A command with numbers; false where it is none, or does not fit the machine. */
static bool change(const char *command, const int64_t *numbers, int n_numbers)
{
    const uint32_t first = (uint32_t)numbers[0];
    if (strcmp(command, "count") == 0 && n_numbers == 2) {
        return machine_set_count(first, (uint32_t)numbers[1]);
    }
    if (strcmp(command, "turn") == 0 && n_numbers == 2) {
        return machine_turn(first, (int32_t)numbers[1]);
    }
    if (strcmp(command, "status") == 0 && n_numbers == 2) {
        return machine_set_status(first, (uint32_t)numbers[1]);
    }
    if (strcmp(command, "input") == 0 && n_numbers == 2) {
        return machine_set_input(first, (uint32_t)numbers[1]);
    }
    if (strcmp(command, "temperature") == 0 && n_numbers == 2) {
        return machine_set_temperature(first, (int32_t)numbers[1]);
    }
    if (strcmp(command, "alarm") == 0 && n_numbers == 4) {
        return alarm_of(numbers);
    }
    if (strcmp(command, "lose") == 0 && n_numbers == 1) {
        line_lose(first);
        return true;
    }
    if (strcmp(command, "spoil") == 0 && n_numbers == 1) {
        line_spoil((uint8_t)first);
        return true;
    }
    return false;
}

static void show(void)
{
    const struct lb_board *board = machine_board();
    printf("streaming %d next_edge %" PRIu32 " unacknowledged %u\n", board->sampler.running ? 1 : 0,
           board->edges.next_seq, (unsigned)board->edges.n_waiting);
}

bool script_execute(const char *text, const struct machine_options *options, const char *link)
{
    char command[COMMAND_BYTES] = "";
    int64_t numbers[4] = {0, 0, 0, 0};
    const int n_words =
        sscanf(text, "%15s %" SCNi64 " %" SCNi64 " %" SCNi64 " %" SCNi64, command, &numbers[0],
               &numbers[1], &numbers[2], &numbers[3]);

    if (strcmp(command, "quit") == 0) {
        return false;
    }
    if (strcmp(command, "show") == 0) {
        show();
    } else {
        bool is_done = true;
        if (strcmp(command, "power") == 0) {
            line_unplug(link);
            machine_power_up(options);
            is_done = line_plug(link);
        } else if (strcmp(command, "unplug") == 0) {
            line_unplug(link);
        } else if (strcmp(command, "plug") == 0) {
            is_done = line_plug(link);
        } else {
            is_done = change(command, numbers, n_words - 1);
        }
        if (is_done) {
            printf("done\n");
        } else {
            printf("error: '%s' is no command of this board; expected %s\n", text, commands);
        }
    }
    (void)fflush(stdout);
    return true;
}
