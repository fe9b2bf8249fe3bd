#include "message.h"

/* The longest bodies fit into a frame. */
_Static_assert(34U + (5U * LB_MAX_CHANNELS) <= LB_MAX_BODY, "HELLO fits");
_Static_assert(5U + (2U * LB_MAX_TEMPERATURES) <= LB_MAX_BODY, "TEMPERATURES fits");

uint16_t lb_get_u16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (uint16_t)((uint16_t)bytes[1] << 8));
}

uint32_t lb_get_u32(const uint8_t *bytes)
{
    return (uint32_t)lb_get_u16(bytes) | ((uint32_t)lb_get_u16(&bytes[2]) << 16);
}

static void put_u8(struct lb_body *body, uint8_t value)
{
    body->bytes[body->n_bytes] = value;
    body->n_bytes++;
}

static void put_u16(struct lb_body *body, uint16_t value)
{
    put_u8(body, (uint8_t)(value & 0xFFU));
    put_u8(body, (uint8_t)(value >> 8));
}

static void put_u32(struct lb_body *body, uint32_t value)
{
    put_u16(body, (uint16_t)(value & 0xFFFFU));
    put_u16(body, (uint16_t)(value >> 16));
}

static void begin(struct lb_body *body, uint8_t type)
{
    body->n_bytes = 0U;
    put_u8(body, type);
}

void lb_put_hello(struct lb_body *body, uint8_t request, const struct lb_identity *identity)
{
    begin(body, 0x81U);
    put_u8(body, request);
    put_u8(body, LB_MAJOR);
    put_u8(body, LB_MINOR);
    for (uint8_t i = 0U; i < sizeof identity->board_id; i++) {
        put_u8(body, identity->board_id[i]);
    }
    for (uint8_t i = 0U; i < sizeof identity->firmware; i++) {
        put_u8(body, identity->firmware[i]);
    }
    put_u8(body, identity->n_channels);
    put_u8(body, identity->n_inputs);
    put_u8(body, identity->n_temperatures);
    put_u32(body, identity->tick_rate_hz);
    put_u32(body, identity->max_rate_millihz);
    put_u32(body, identity->boot_id);
    for (uint8_t i = 0U; i < identity->n_channels; i++) {
        put_u8(body, identity->channels[i].bits);
        put_u32(body, identity->channels[i].modulus);
    }
}

void lb_put_reply(struct lb_body *body, uint8_t request_type, uint8_t request, uint8_t result,
                  uint32_t value)
{
    begin(body, 0x82U);
    put_u8(body, request_type);
    put_u8(body, request);
    put_u8(body, result);
    put_u32(body, value);
}

void lb_put_latch(struct lb_body *body, uint8_t type, uint8_t a, uint8_t b, uint32_t seq,
                  const struct lb_latch *latch, uint8_t n_channels)
{
    begin(body, type);
    put_u8(body, a);
    put_u8(body, b);
    put_u8(body, latch->inputs);
    put_u32(body, seq);
    put_u32(body, latch->ticks);
    for (uint8_t i = 0U; i < n_channels; i++) {
        put_u32(body, latch->counts[i]);
    }
    for (uint8_t i = 0U; i < n_channels; i++) {
        put_u8(body, latch->status[i]);
    }
}

void lb_put_temperatures(struct lb_body *body, uint32_t ticks, uint8_t n_temperatures,
                         int16_t (*temperature)(uint8_t sensor))
{
    begin(body, 0x85U);
    put_u32(body, ticks);
    for (uint8_t i = 0U; i < n_temperatures; i++) {
        put_u16(body, (uint16_t)temperature(i));
    }
}

void lb_put_alarm(struct lb_body *body, const struct lb_alarm *alarm, uint32_t seq, uint32_t ticks)
{
    begin(body, 0x86U);
    put_u8(body, alarm->channel);
    put_u8(body, alarm->state);
    put_u16(body, alarm->code);
    put_u32(body, seq);
    put_u32(body, ticks);
    put_u32(body, (uint32_t)alarm->value);
}

void lb_put_heartbeat(struct lb_body *body, const struct lb_heartbeat *heartbeat)
{
    begin(body, 0x87U);
    put_u8(body, heartbeat->state);
    put_u8(body, heartbeat->inputs);
    put_u8(body, heartbeat->edges_back);
    put_u32(body, heartbeat->ticks);
    put_u32(body, heartbeat->next_sample_seq);
    put_u32(body, heartbeat->next_edge_seq);
    put_u32(body, heartbeat->tx_dropped);
    put_u32(body, heartbeat->rx_rejected);
}
