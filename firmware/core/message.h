/* Messages of the board as bodies of frames, docs/serial-protocol.md, section 4. */
#ifndef LB_MESSAGE_H
#define LB_MESSAGE_H

#include <stdint.h>

#include "frame.h"
#include "port.h"

#define LB_MAJOR 1U
#define LB_MINOR 0U
#define LB_WHOLE_BOARD 0xFFU /* channel of an alarm */

/* Types of messages, sections 3 and 4. */
enum {
    LB_HELLO = 0x01,
    LB_CONFIGURE = 0x02,
    LB_START = 0x03,
    LB_STOP = 0x04,
    LB_LATCH = 0x05,
    LB_EDGE_ACK = 0x06,
    LB_BOARD_TYPES = 0x80, /* from here on the board's own */
    LB_SAMPLE_TYPE = 0x83,
    LB_EDGE_TYPE = 0x84
};

/* Results of REPLY. */
enum {
    LB_DONE = 0,
    LB_UNKNOWN_REQUEST = 1,
    LB_WRONG_LENGTH = 2,
    LB_RATE_OUT_OF_RANGE = 3,
    LB_OTHER_MAJOR = 4,
    LB_OUT_OF_RANGE = 5,
    LB_NOT_NOW = 6
};

/* Causes of SAMPLE. */
enum { LB_TIMED = 0, LB_ON_REQUEST = 1 };

/* Codes of ALARM that the core raises. */
enum { LB_FRAMES_DROPPED = 6, LB_EDGES_LOST = 7 };

/* All encoders at one instant. */
struct lb_latch {
    uint32_t ticks;
    uint8_t inputs;
    uint8_t status[LB_MAX_CHANNELS];
    uint32_t counts[LB_MAX_CHANNELS];
};

/* A body that is being written; the longest (HELLO of 32 channels) has 194 bytes. */
struct lb_body {
    uint8_t bytes[LB_MAX_BODY];
    uint8_t n_bytes;
};

uint32_t lb_get_u32(const uint8_t *bytes);
uint16_t lb_get_u16(const uint8_t *bytes);

void lb_put_hello(struct lb_body *body, uint8_t request, const struct lb_identity *identity);
void lb_put_reply(struct lb_body *body, uint8_t request_type, uint8_t request, uint8_t result,
                  uint32_t value);
/* SAMPLE: a is the cause, b the request. EDGE: a is the input, b its level. */
void lb_put_latch(struct lb_body *body, uint8_t type, uint8_t a, uint8_t b, uint32_t seq,
                  const struct lb_latch *latch, uint8_t n_channels);
void lb_put_temperatures(struct lb_body *body, uint32_t ticks, uint8_t n_temperatures,
                         int16_t (*temperature)(uint8_t sensor));

struct lb_alarm {
    uint8_t channel;
    uint8_t state;
    uint16_t code;
    int32_t value;
};

void lb_put_alarm(struct lb_body *body, const struct lb_alarm *alarm, uint32_t seq, uint32_t ticks);

struct lb_heartbeat {
    uint8_t state;
    uint8_t inputs;
    uint8_t edges_back;
    uint32_t ticks;
    uint32_t next_sample_seq;
    uint32_t next_edge_seq;
    uint32_t tx_dropped;
    uint32_t rx_rejected;
};

void lb_put_heartbeat(struct lb_body *body, const struct lb_heartbeat *heartbeat);

#endif
