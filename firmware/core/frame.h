/* Frames: COBS with a CRC, docs/serial-protocol.md, section 1. */
#ifndef LB_FRAME_H
#define LB_FRAME_H

#include <stdbool.h>
#include <stdint.h>

#define LB_MAX_BODY 250U
#define LB_MAX_SEGMENT 253U /* crc, and the one byte that COBS adds */
#define LB_FRAME_COST 4U    /* crc, COBS, delimiter */

/* CRC-16/IBM-3740. */
uint16_t lb_crc(const uint8_t *bytes, uint8_t n_bytes);

/* Write the frame of a body of 1 to 250 bytes, delimiter included, into n_body +
 * LB_FRAME_COST bytes. Returns its length. */
uint16_t lb_frame(const uint8_t *body, uint8_t n_body, uint8_t *frame);

/* Bytes of the line, cut at the delimiters. */
struct lb_receiver {
    uint8_t segment[LB_MAX_SEGMENT];
    uint8_t n_bytes;
    bool too_long;
    uint32_t rejected; /* segments that were no valid frame */
};

void lb_receiver_init(struct lb_receiver *receiver);

/* Take a byte. Returns the length of the body that it completes, which stands in
 * `segment` until the next byte; else 0. */
uint8_t lb_receiver_take(struct lb_receiver *receiver, uint8_t byte);

#endif
