/* AS5600: a magnetic encoder of 12 bits on I2C, always at address 36. Either each has an
 * SDA line of its own, and all are read at once; or all are on one bus behind a TCA9548A,
 * and are read one after the other. */
#include "front_end.h"
#include "settings.h"

#if FRONT_END == AS5600

#include <stdbool.h>

#include "i2c.h"
#include "pins.h"
#include "words.h"

#define SENSOR 0x36U
#define MULTIPLEXER 0x70U /* TCA9548A with A0, A1, A2 low */
#define READ 1U
#define STATUS_REGISTER 0x0BU
#define RAW_ANGLE_REGISTER 0x0CU /* high byte, then low; the pointer stays there */
#define MAGNET_TOO_STRONG 0x08U
#define MAGNET_TOO_WEAK 0x10U
#define MAGNET_DETECTED 0x20U
#define COUNT_BITS 12U
#define ALL_LINES PINS_DATA_MASK

#if I2C_MULTIPLEXER
#define GROUPS CHANNELS  /* each channel alone */
#define LINES 1U         /* all on data line 0 */
#else
#define GROUPS 1U
#define LINES ALL_LINES
#endif

static uint8_t magnets[CHANNELS]; /* health by the magnet, from the last look */
static uint8_t silent;            /* channels that did not acknowledge then */

static uint8_t line_of(uint8_t channel)
{
    return I2C_MULTIPLEXER ? 0U : channel;
}

/* Select a group of channels; returns the lines on which the bus works. */
static uint8_t select(uint8_t group)
{
    uint8_t lines = LINES;
    if (I2C_MULTIPLEXER) {
        i2c_start(lines);
        lines = i2c_write(lines, MULTIPLEXER << 1);
        (void)i2c_write(LINES, (uint8_t)(1U << group));
        i2c_stop(LINES); /* only now it switches */
    }
    return lines;
}

/* Set the register that reads begin at; returns the lines that acknowledged. */
static uint8_t point(uint8_t lines, uint8_t sensor_register)
{
    i2c_start(lines);
    uint8_t acknowledged = i2c_write(lines, SENSOR << 1);
    acknowledged &= i2c_write(lines, sensor_register);
    return acknowledged;
}

void front_end_init(void)
{
    pins_init_i2c();
    silent = 0xFFU; /* until the first look */
}

struct lb_channel front_end_channel(uint8_t channel)
{
    (void)channel;
    return (struct lb_channel){.bits = COUNT_BITS, .modulus = 0U};
}

uint8_t front_end_latch(uint32_t *counts, uint8_t *healths)
{
    for (uint8_t group = 0U; group < GROUPS; group++) {
        uint8_t samples[16];
        uint8_t answered = select(group);
        i2c_start(LINES);
        answered &= i2c_write(LINES, (SENSOR << 1) | READ);
        i2c_read(LINES, samples, 0U);
        i2c_read(LINES, &samples[8], 1U);
        i2c_stop(LINES);
        const uint8_t end = GROUPS == 1U ? CHANNELS : (uint8_t)(group + 1U);
        for (uint8_t i = group; i < end; i++) {
            const uint8_t line = line_of(i);
            counts[i] = word_of(&samples[16U - COUNT_BITS], COUNT_BITS, line);
            const bool answers = ((unsigned)answered >> line & 1U) != 0U &&
                                 ((unsigned)silent >> i & 1U) == 0U;
            healths[i] = answers ? magnets[i] : (uint8_t)SILENT;
        }
    }
    return GROUPS == 1U ? 0U : (uint8_t)(ALL_LINES & 0xFEU);
}

/* Read the magnets' status, and set the pointer back to the angle. */
void front_end_look(void)
{
    for (uint8_t group = 0U; group < GROUPS; group++) {
        uint8_t samples[8];
        (void)select(group);
        const uint8_t acknowledged = point(LINES, STATUS_REGISTER);
        i2c_start(LINES);
        (void)i2c_write(LINES, (SENSOR << 1) | READ);
        i2c_read(LINES, samples, 1U);
        i2c_stop(LINES);
        const uint8_t pointed = point(LINES, RAW_ANGLE_REGISTER);
        i2c_stop(LINES);
        const uint8_t end = GROUPS == 1U ? CHANNELS : (uint8_t)(group + 1U);
        for (uint8_t i = group; i < end; i++) {
            const uint8_t line = line_of(i);
            const uint8_t status = (uint8_t)word_of(samples, 8U, line);
            if ((status & MAGNET_DETECTED) == 0U) {
                magnets[i] = INVALID;
            } else if ((status & (MAGNET_TOO_STRONG | MAGNET_TOO_WEAK)) != 0U) {
                magnets[i] = WEAK;
            } else {
                magnets[i] = HEALTHY;
            }
            const uint8_t bit = (uint8_t)(1U << i);
            if (((unsigned)(acknowledged & pointed) >> line & 1U) != 0U) {
                silent &= (uint8_t)~bit;
            } else {
                silent |= bit;
            }
        }
    }
}

#endif
