#include "frame.h"

#define CRC_INITIAL 0xFFFFU
#define CRC_BYTES 2U

uint16_t lb_crc(const uint8_t *bytes, uint8_t n_bytes)
{
    uint16_t crc = CRC_INITIAL;
    for (uint8_t i = 0U; i < n_bytes; i++) {
        /* A byte at a time without a table: the polynomial's bits 12, 5 and 0 fold the
         * upper byte x, as x ^ x >> 4, into these places. */
        uint8_t x = (uint8_t)((uint8_t)(crc >> 8) ^ bytes[i]);
        x = (uint8_t)(x ^ (x >> 4));
        crc = (uint16_t)((uint16_t)(crc << 8) ^ (uint16_t)((uint16_t)x << 12) ^
                         (uint16_t)((uint16_t)x << 5) ^ x);
    }
    return crc;
}

uint16_t lb_frame(const uint8_t *body, uint8_t n_body, uint8_t *frame)
{
    const uint16_t crc = lb_crc(body, n_body);
    const uint16_t n_content = (uint16_t)(n_body + CRC_BYTES);
    uint16_t zero = 0U; /* place of the distance to the next zero */

    /* At most 252 bytes of content: no distance is beyond 254, so none is split. */
    for (uint16_t i = 0U; i < n_content; i++) {
        uint8_t byte;
        if (i < n_body) {
            byte = body[i];
        } else if (i == n_body) {
            byte = (uint8_t)(crc & 0xFFU);
        } else {
            byte = (uint8_t)(crc >> 8);
        }
        const uint16_t place = (uint16_t)(i + 1U);
        if (byte == 0U) {
            frame[zero] = (uint8_t)(place - zero);
            zero = place;
        } else {
            frame[place] = byte;
        }
    }
    const uint16_t end = (uint16_t)(n_content + 1U);
    frame[zero] = (uint8_t)(end - zero);
    frame[end] = 0U;
    return (uint16_t)(end + 1U);
}

void lb_receiver_init(struct lb_receiver *receiver)
{
    receiver->n_bytes = 0U;
    receiver->too_long = false;
    receiver->rejected = 0U;
}

/* Decode COBS in place; returns the length of the content, 0 where it is broken. */
static uint8_t unstuffed(uint8_t *bytes, uint8_t n_bytes)
{
    uint8_t from = 0U;
    uint8_t to = 0U;
    while (from < n_bytes) {
        const uint8_t distance = bytes[from]; /* never 0: that is the delimiter */
        if ((uint16_t)from + distance > n_bytes) {
            return 0U;
        }
        const uint8_t next = (uint8_t)(from + distance);
        for (from++; from < next; from++) {
            bytes[to] = bytes[from];
            to++;
        }
        if (from < n_bytes) {
            bytes[to] = 0U;
            to++;
        }
    }
    return to;
}

uint8_t lb_receiver_take(struct lb_receiver *receiver, uint8_t byte)
{
    if (byte != 0U) {
        if (receiver->n_bytes < LB_MAX_SEGMENT) {
            receiver->segment[receiver->n_bytes] = byte;
            receiver->n_bytes++;
        } else {
            receiver->too_long = true;
        }
        return 0U;
    }
    const uint8_t n_bytes = receiver->n_bytes;
    const bool too_long = receiver->too_long;
    receiver->n_bytes = 0U;
    receiver->too_long = false;
    if (n_bytes == 0U) {
        return 0U; /* two delimiters in a row are one */
    }
    if (!too_long) {
        const uint8_t n_content = unstuffed(receiver->segment, n_bytes);
        if (n_content > CRC_BYTES) {
            const uint8_t n_body = (uint8_t)(n_content - CRC_BYTES);
            const uint16_t crc = (uint16_t)(receiver->segment[n_body] |
                                            (uint16_t)(receiver->segment[n_body + 1U]) << 8);
            if (lb_crc(receiver->segment, n_body) == crc) {
                return n_body;
            }
        }
    }
    receiver->rejected++;
    return 0U;
}
