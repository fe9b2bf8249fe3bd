#include "encoders.h"

#include "front_end.h"

#define LOOKS_PER_S 4U /* at encoders and for alarms */

/* By health: what the protocol calls it, sections 4 status and ALARM. */
static const uint8_t status_of[] = {0U, LB_STATUS_WARNING, LB_STATUS_ERROR, LB_STATUS_ERROR,
                                    LB_STATUS_ERROR};
static const uint8_t alarm_of[] = {0U, 1U, 3U, 2U, 8U};

static struct {
    uint8_t worst[CHANNELS];    /* health since the last look; also from interrupts */
    uint8_t reported[CHANNELS]; /* by an alarm that stands */
    uint32_t looked_at;         /* ticks of the last look */
    bool latched;               /* since then; also from interrupts */
} encoders;

void encoders_init(struct lb_identity *identity)
{
    front_end_init();
    front_end_look();
    identity->n_channels = CHANNELS;
    for (uint8_t i = 0U; i < CHANNELS; i++) {
        identity->channels[i] = front_end_channel(i);
        encoders.worst[i] = HEALTHY;
        encoders.reported[i] = HEALTHY;
    }
    encoders.looked_at = 0U;
}

void encoders_latch(uint32_t *counts, uint8_t *status)
{
    uint8_t healths[CHANNELS];
    const uint8_t late = front_end_latch(counts, healths);
    encoders.latched = true;
    for (uint8_t i = 0U; i < CHANNELS; i++) {
        status[i] = status_of[healths[i]];
        if ((((unsigned)late >> i) & 1U) != 0U) {
            status[i] |= (uint8_t)LB_STATUS_LATE;
        }
        if (healths[i] > encoders.worst[i]) {
            encoders.worst[i] = healths[i];
        }
    }
}

/* Replace the alarm of a channel; returns which one stands then. */
static uint8_t report(struct lb_board *board, uint8_t channel, uint8_t reported, uint8_t health)
{
    struct lb_alarm alarm = {.channel = channel, .state = 0U, .code = alarm_of[reported]};
    if (reported != HEALTHY) {
        if (!lb_report_alarm(board, &alarm)) {
            return reported; /* too many wait; at the next look */
        }
        reported = HEALTHY;
    }
    if (health != HEALTHY) {
        alarm.state = 1U;
        alarm.code = alarm_of[health];
        if (lb_report_alarm(board, &alarm)) {
            reported = health;
        }
    }
    return reported;
}

void encoders_watch(struct lb_board *board, void (*hold)(void), void (*release)(void))
{
    const uint32_t now = board->port->ticks();
    if ((uint32_t)(now - encoders.looked_at) < board->identity->tick_rate_hz / LOOKS_PER_S) {
        return;
    }
    encoders.looked_at = now;
    uint8_t worst[CHANNELS];
    hold();
    front_end_look();
    if (!encoders.latched) {
        uint32_t counts[CHANNELS];
        uint8_t status[CHANNELS];
        encoders_latch(counts, status);
    }
    encoders.latched = false;
    for (uint8_t i = 0U; i < CHANNELS; i++) {
        worst[i] = encoders.worst[i];
        encoders.worst[i] = HEALTHY;
    }
    release();
    for (uint8_t i = 0U; i < CHANNELS; i++) {
        if (worst[i] != encoders.reported[i]) {
            encoders.reported[i] = report(board, i, encoders.reported[i], worst[i]);
        }
    }
}
