#include "i2c.h"
#include "settings.h"

#if FRONT_END == AS5600

#include "pins.h"

#define BITS 8U

static uint8_t clock_in(void)
{
    pins_wait_i2c();
    pins_scl(true);
    pins_wait_i2c();
    const uint8_t sample = pins_data();
    pins_scl(false);
    return sample;
}

void i2c_start(uint8_t lines)
{
    pins_sda_low(0U);
    pins_wait_i2c();
    pins_scl(true);
    pins_wait_i2c();
    pins_sda_low(lines);
    pins_wait_i2c();
    pins_scl(false);
}

void i2c_stop(uint8_t lines)
{
    pins_sda_low(lines);
    pins_wait_i2c();
    pins_scl(true);
    pins_wait_i2c();
    pins_sda_low(0U);
    pins_wait_i2c();
}

uint8_t i2c_write(uint8_t lines, uint8_t byte)
{
    for (uint8_t i = 0U; i < BITS; i++) {
        pins_sda_low((byte & 0x80U) != 0U ? 0U : lines);
        byte = (uint8_t)(byte << 1);
        (void)clock_in();
    }
    pins_sda_low(0U);
    return (uint8_t)((uint8_t)~clock_in() & lines);
}

void i2c_read(uint8_t lines, uint8_t *samples, uint8_t is_last)
{
    for (uint8_t i = 0U; i < BITS; i++) {
        samples[i] = clock_in();
    }
    pins_sda_low(is_last != 0U ? 0U : lines); /* acknowledged if more is wanted */
    (void)clock_in();
    pins_sda_low(0U);
}

#endif
