#include "board.h"

#include <stddef.h>

#define MILLI 1000U
#define EDGE_AGAIN_MS 50U       /* section 4, EDGE */
#define DROPPING_ENDS_MS 1000U  /* so long without a loss, and ALARM 6 is cleared */
#define LONGEST_DEBOUNCE_US 1000000U
#define FORGET_EDGES 1U /* flag of HELLO */

/* Defaults after power-up, section 3. */
#define DEFAULT_EDGE_MASK 0xFFU
#define DEFAULT_HEARTBEAT_MS 1000U
#define DEFAULT_TEMPERATURE_MS 5000U
#define DEFAULT_DEBOUNCE_US 5000U

/* Lengths of bodies, sections 3 and 4. */
#define HELLO_HEAD 34U
#define BYTES_PER_CHANNEL 5U
#define LATCH_HEAD 12U
#define HEARTBEAT_LENGTH 24U

static uint64_t ticks_of_ms(const struct lb_board *board, uint32_t duration_ms)
{
    return ((uint64_t)duration_ms * board->identity->tick_rate_hz) / MILLI;
}

static void set_period(struct lb_board *board, struct lb_period *period, uint16_t period_ms)
{
    period->ticks = ticks_of_ms(board, period_ms);
    period->due = board->now + period->ticks;
}

static bool is_due(const struct lb_board *board, const struct lb_period *period)
{
    return period->ticks > 0U && period->due <= board->now;
}

static void advance(struct lb_board *board)
{
    /* The loop is called more often than the counter wraps. */
    board->now += (uint32_t)(board->port->ticks() - (uint32_t)board->now);
}

void lb_init(struct lb_board *board, const struct lb_identity *identity,
             const struct lb_port *port)
{
    board->identity = identity;
    board->port = port;
    board->now = port->ticks();
    board->greeted = false;
    board->refused = false;
    board->edge_mask = DEFAULT_EDGE_MASK;
    set_period(board, &board->heartbeat, DEFAULT_HEARTBEAT_MS);
    set_period(board, &board->temperatures, DEFAULT_TEMPERATURE_MS);
    board->heartbeat.due = board->now;
    board->temperatures.due = board->now;
    lb_receiver_init(&board->receiver);
    lb_sampler_init(&board->sampler, identity, port);
    lb_inputs_init(&board->inputs, identity, port);
    lb_inputs_debounce(&board->inputs, DEFAULT_DEBOUNCE_US);
    lb_edges_init(&board->edges);
    board->next_alarm_seq = 0U;
    board->tx_dropped = 0U;
    board->requests_rejected = 0U;
    board->dropping = false;
    board->dropping_ends = 0U;
    board->losing_edges = false;
    board->alarm_first = 0U;
    board->n_alarms = 0U;
    board->dropping_to_send = false;
    board->losing_to_send = false;
}

static bool has_room(const struct lb_board *board, uint16_t n_body)
{
    return board->port->room() >= (uint16_t)(n_body + LB_FRAME_COST);
}

static void send(struct lb_board *board)
{
    const uint16_t n_bytes = lb_frame(board->body.bytes, board->body.n_bytes, board->frame);
    board->port->send(board->frame, n_bytes);
}

/* ---- requests ---------------------------------------------------------------------- */

bool lb_can_receive(const struct lb_board *board)
{
    /* The longest answer is HELLO; two small ones (REPLY, ALARM) are shorter. */
    const uint16_t n_channels = board->identity->n_channels;
    return has_room(board, (uint16_t)(HELLO_HEAD + (BYTES_PER_CHANNEL * n_channels)));
}

static void reply(struct lb_board *board, uint8_t request_type, uint8_t request,
                  uint8_t result, uint32_t value)
{
    lb_put_reply(&board->body, request_type, request, result, value);
    send(board);
}

/* No edge waits any more: the alarm about lost ones is over. */
static void clear_losing(struct lb_board *board)
{
    if (board->losing_edges && board->edges.n_waiting == 0U) {
        board->losing_edges = false;
        board->losing_to_send = true;
    }
}

static void greet(struct lb_board *board, const uint8_t *fields)
{
    const uint8_t request = fields[0];
    lb_sampler_stop(&board->sampler);
    board->refused = fields[1] != LB_MAJOR;
    if (board->refused) {
        reply(board, LB_HELLO, request, LB_OTHER_MAJOR, LB_MAJOR);
        return;
    }
    board->greeted = true;
    if ((fields[2] & FORGET_EDGES) != 0U) {
        lb_edges_forget(&board->edges);
        clear_losing(board);
    }
    lb_put_hello(&board->body, request, board->identity);
    send(board);
}

static void configure(struct lb_board *board, const uint8_t *fields)
{
    const uint32_t debounce_us = lb_get_u32(&fields[6]);
    if (debounce_us > LONGEST_DEBOUNCE_US) {
        reply(board, LB_CONFIGURE, fields[0], LB_OUT_OF_RANGE, 0U);
        return;
    }
    board->edge_mask = fields[1];
    set_period(board, &board->heartbeat, lb_get_u16(&fields[2]));
    set_period(board, &board->temperatures, lb_get_u16(&fields[4]));
    lb_inputs_debounce(&board->inputs, debounce_us);
    reply(board, LB_CONFIGURE, fields[0], LB_DONE, 0U);
}

static void start(struct lb_board *board, const uint8_t *fields)
{
    const uint32_t rate_millihz = lb_get_u32(&fields[1]);
    const uint32_t largest = board->identity->max_rate_millihz;
    if (rate_millihz == 0U || rate_millihz > largest) {
        reply(board, LB_START, fields[0], LB_RATE_OUT_OF_RANGE, largest);
        return;
    }
    reply(board, LB_START, fields[0], LB_DONE, rate_millihz);
    lb_sampler_start(&board->sampler, fields[0], rate_millihz);
}

static void latch(struct lb_board *board, uint8_t request)
{
    struct lb_latch latch;
    latch.inputs = board->port->inputs();
    latch.ticks = board->port->latch(latch.counts, latch.status);
    lb_put_latch(&board->body, LB_SAMPLE_TYPE, LB_ON_REQUEST, request, 0U, &latch,
                 board->identity->n_channels);
    send(board);
}

/* The length of a request's fields; 0 where the type is not known. */
static uint8_t fields_length(uint8_t type)
{
    switch (type) {
    case LB_HELLO:
        return 3U;
    case LB_CONFIGURE:
        return 10U;
    case LB_START:
        return 5U;
    case LB_STOP:
    case LB_LATCH:
        return 1U;
    case LB_EDGE_ACK:
        return 4U;
    default:
        return 0U;
    }
}

/* Carry out a request whose length is right, from a host that has said HELLO. */
static void obey(struct lb_board *board, uint8_t type, const uint8_t *fields)
{
    switch (type) {
    case LB_CONFIGURE:
        configure(board, fields);
        break;
    case LB_START:
        start(board, fields);
        break;
    case LB_STOP:
        lb_sampler_stop(&board->sampler);
        reply(board, LB_STOP, fields[0], LB_DONE, 0U);
        break;
    default: /* LATCH is the only one that is left */
        latch(board, fields[0]);
        break;
    }
}

static void answer(struct lb_board *board, const uint8_t *body, uint8_t n_body)
{
    const uint8_t type = body[0];
    const uint8_t *fields = &body[1];
    const uint8_t n_fields = (uint8_t)(n_body - 1U);
    const uint8_t expected = fields_length(type);

    if (expected == 0U || n_fields != expected) {
        board->requests_rejected++;
        /* Only what can be a request is answered: it has a number. */
        if (type < LB_BOARD_TYPES && type != LB_EDGE_ACK && n_fields > 0U && !board->refused) {
            reply(board, type, fields[0],
                  expected == 0U ? LB_UNKNOWN_REQUEST : LB_WRONG_LENGTH, 0U);
        }
    } else if (type == LB_HELLO) {
        greet(board, fields);
    } else if (board->refused) {
        /* All else of a host of another major is ignored. */
    } else if (type == LB_EDGE_ACK) {
        lb_edges_acknowledge(&board->edges, lb_get_u32(fields));
        clear_losing(board);
    } else if (!board->greeted) {
        reply(board, type, fields[0], LB_NOT_NOW, 0U);
    } else {
        obey(board, type, fields);
    }
}

void lb_receive(struct lb_board *board, uint8_t byte)
{
    const uint8_t n_body = lb_receiver_take(&board->receiver, byte);
    if (n_body > 0U) {
        advance(board);
        answer(board, board->receiver.segment, n_body);
    }
}

void lb_host_gone(struct lb_board *board)
{
    board->receiver.n_bytes = 0U;
    board->receiver.too_long = false;
    lb_sampler_stop(&board->sampler);
}

/* ---- what the board says by itself -------------------------------------------------- */

bool lb_report_alarm(struct lb_board *board, const struct lb_alarm *alarm)
{
    if (board->n_alarms >= LB_ALARM_QUEUE) {
        return false;
    }
    board->alarms[((unsigned)board->alarm_first + board->n_alarms) % LB_ALARM_QUEUE] = *alarm;
    board->n_alarms++;
    return true;
}

static void send_alarm(struct lb_board *board, const struct lb_alarm *alarm)
{
    lb_put_alarm(&board->body, alarm, board->next_alarm_seq, (uint32_t)board->now);
    board->next_alarm_seq++;
    send(board);
}

static void send_own_alarm(struct lb_board *board, uint16_t code, bool raised, uint32_t how_many)
{
    const struct lb_alarm alarm = {
        .channel = LB_WHOLE_BOARD,
        .state = raised ? 1U : 0U,
        .code = code,
        .value = how_many > (uint32_t)INT32_MAX ? INT32_MAX : (int32_t)how_many,
    };
    send_alarm(board, &alarm);
}

static void send_alarms(struct lb_board *board)
{
    if (board->dropping && board->dropping_ends <= board->now) {
        board->dropping = false;
        board->dropping_to_send = true;
    }
    /* The room for a heartbeat is enough for an alarm. */
    if (board->dropping_to_send && has_room(board, HEARTBEAT_LENGTH)) {
        board->dropping_to_send = false;
        send_own_alarm(board, LB_FRAMES_DROPPED, board->dropping, board->tx_dropped);
    }
    if (board->losing_to_send && has_room(board, HEARTBEAT_LENGTH)) {
        board->losing_to_send = false;
        send_own_alarm(board, LB_EDGES_LOST, board->losing_edges, board->edges.n_lost);
    }
    while (board->n_alarms > 0U && has_room(board, HEARTBEAT_LENGTH)) {
        send_alarm(board, &board->alarms[board->alarm_first]);
        board->alarm_first = (uint8_t)((board->alarm_first + 1U) % LB_ALARM_QUEUE);
        board->n_alarms--;
    }
}

static uint16_t latch_length(const struct lb_board *board)
{
    return (uint16_t)(LATCH_HEAD + (BYTES_PER_CHANNEL * board->identity->n_channels));
}

static void number_edges(struct lb_board *board)
{
    struct lb_held held;
    while (lb_inputs_next(&board->inputs, board->now, &held)) {
        const bool is_reported = (((unsigned)board->edge_mask >> held.input) & 1U) != 0U;
        if (is_reported && !lb_edges_add(&board->edges, &held, board->now)) {
            board->losing_edges = true;
            board->losing_to_send = true;
        }
    }
}

static void send_edges(struct lb_board *board)
{
    struct lb_edge *edge = lb_edges_due(&board->edges, board->now);
    while (edge != NULL && has_room(board, latch_length(board))) {
        lb_put_latch(&board->body, LB_EDGE_TYPE, edge->input, edge->level, edge->seq,
                     &edge->latch, board->identity->n_channels);
        send(board);
        edge->due = board->now + ticks_of_ms(board, EDGE_AGAIN_MS);
        edge = lb_edges_due(&board->edges, board->now);
    }
}

static void beat(struct lb_board *board)
{
    const struct lb_port *port = board->port;
    struct lb_heartbeat heartbeat;
    heartbeat.state = lb_sampler_state(&board->sampler, &heartbeat.next_sample_seq) ? 1U : 0U;
    heartbeat.inputs = port->inputs();
    heartbeat.edges_back = lb_edges_back(&board->edges);
    heartbeat.ticks = port->ticks();
    heartbeat.next_edge_seq = board->edges.next_seq;
    heartbeat.tx_dropped = board->tx_dropped;
    heartbeat.rx_rejected = board->receiver.rejected + board->requests_rejected;
    lb_put_heartbeat(&board->body, &heartbeat);
    send(board);
    board->heartbeat.due = board->now + board->heartbeat.ticks;
}

static void send_temperatures(struct lb_board *board)
{
    const uint8_t n_temperatures = board->identity->n_temperatures;
    if (n_temperatures > 0U) {
        lb_put_temperatures(&board->body, (uint32_t)board->now, n_temperatures,
                            board->port->temperature);
        send(board);
    }
    board->temperatures.due = board->now + board->temperatures.ticks;
}

static void count_dropped(struct lb_board *board, uint32_t n_dropped)
{
    if (n_dropped > 0U) {
        board->tx_dropped += n_dropped;
        board->dropping_to_send = board->dropping_to_send || !board->dropping;
        board->dropping = true;
        board->dropping_ends = board->now + ticks_of_ms(board, DROPPING_ENDS_MS);
    }
}

static void send_samples(struct lb_board *board)
{
    /* Samples leave room for an edge and a heartbeat, which are never dropped. */
    const uint16_t n_wanted = (uint16_t)(2U * latch_length(board) + HEARTBEAT_LENGTH +
                                         2U * LB_FRAME_COST);
    const struct lb_sample *sample = lb_sampler_peek(&board->sampler);
    while (sample != NULL) {
        if (has_room(board, n_wanted)) {
            lb_put_latch(&board->body, LB_SAMPLE_TYPE, LB_TIMED, board->sampler.request,
                         sample->seq, &sample->latch, board->identity->n_channels);
            send(board);
        } else {
            count_dropped(board, 1U);
        }
        lb_sampler_drop(&board->sampler);
        sample = lb_sampler_peek(&board->sampler);
    }
    count_dropped(board, lb_sampler_take_missed(&board->sampler));
}

void lb_poll(struct lb_board *board)
{
    advance(board);
    number_edges(board);
    send_edges(board);
    send_alarms(board);
    send_samples(board);
    if (is_due(board, &board->heartbeat) && has_room(board, HEARTBEAT_LENGTH)) {
        beat(board);
    }
    if (is_due(board, &board->temperatures) &&
        has_room(board, (uint16_t)(5U + (2U * board->identity->n_temperatures)))) {
        send_temperatures(board);
    }
}

/* ---- from interrupts ------------------------------------------------------------------ */

void lb_timer_due(struct lb_board *board)
{
    lb_sampler_due(&board->sampler);
}

void lb_inputs_changed(struct lb_board *board, uint32_t earliest, uint32_t tick,
                       uint8_t levels)
{
    lb_inputs_change(&board->inputs, earliest, tick, levels);
}
