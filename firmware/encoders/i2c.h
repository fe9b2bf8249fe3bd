/* I2C on several lines at once: one clock, a data line for each of several buses. */
#ifndef I2C_H
#define I2C_H

#include <stdint.h>

/* `lines`: bit i for data line i. Two starts without a stop are a repeated start. */
void i2c_start(uint8_t lines);
void i2c_stop(uint8_t lines);

/* Returns the lines on which it was acknowledged. */
uint8_t i2c_write(uint8_t lines, uint8_t byte);

/* Read a byte on all lines: eight samples of them, the highest bit first. */
void i2c_read(uint8_t lines, uint8_t *samples, uint8_t is_last);

#endif
