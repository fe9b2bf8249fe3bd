/* The latch board: the conversation of docs/serial-protocol.md over a port's functions.
 *
 *   from interrupts:  lb_timer_due, lb_inputs_changed (they do not interrupt each other)
 *   from main loop:   lb_poll, at least each millisecond; lb_receive while lb_can_receive
 */
#ifndef LB_BOARD_H
#define LB_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "edges.h"
#include "frame.h"
#include "inputs.h"
#include "message.h"
#include "sampler.h"

/* Something that is done again and again. */
struct lb_period {
    uint64_t ticks; /* 0: never */
    uint64_t due;
};

struct lb_board {
    const struct lb_identity *identity;
    const struct lb_port *port;
    uint64_t now; /* ticks since power-up; its lower half is the counter */
    bool greeted; /* by HELLO of this major */
    bool refused; /* the host speaks another major */
    uint8_t edge_mask;
    struct lb_period heartbeat;
    struct lb_period temperatures;
    struct lb_receiver receiver;
    struct lb_sampler sampler;
    struct lb_inputs inputs;
    struct lb_edges edges;
    /* Alarms: of the board itself as states, of the port in a queue. */
    uint32_t next_alarm_seq;
    uint32_t tx_dropped;
    uint32_t requests_rejected; /* valid frames that were no request */
    bool dropping;
    uint64_t dropping_ends;
    bool losing_edges;
    uint8_t alarm_first;
    uint8_t n_alarms;
    struct lb_alarm alarms[LB_ALARM_QUEUE];
    bool dropping_to_send;
    bool losing_to_send;
    /* Of the frame that is being written. */
    struct lb_body body;
    uint8_t frame[LB_MAX_BODY + LB_FRAME_COST];
};

/* Begin as after power-up. Identity and port must outlive the board. */
void lb_init(struct lb_board *board, const struct lb_identity *identity,
             const struct lb_port *port);

/* Whether the line has room for any answer; else bytes stay where they are. */
bool lb_can_receive(const struct lb_board *board);
void lb_receive(struct lb_board *board, uint8_t byte);

/* Do all that is due. */
void lb_poll(struct lb_board *board);

/* The port knows that the host has closed its end: no stream, no half of a request. */
void lb_host_gone(struct lb_board *board);

/* Report an alarm of an encoder or of the supply; false if too many wait: try again. */
bool lb_report_alarm(struct lb_board *board, const struct lb_alarm *alarm);

/* The counter has reached the tick of set_timer. */
void lb_timer_due(struct lb_board *board);
/* The inputs have changed at a tick and have these levels now. From the tick `earliest` on
 * the port may have missed changes before this one: it is late by them. Else the two are equal. */
void lb_inputs_changed(struct lb_board *board, uint32_t earliest, uint32_t tick,
                       uint8_t levels);

#endif
