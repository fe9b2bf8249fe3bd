/* Words that encoders shift out: from levels of a data line to a count. Without a pin. */
#ifndef WORDS_H
#define WORDS_H

#include <stdbool.h>
#include <stdint.h>

#include "front_end.h"

/* Bits of a channel out of samples of all data lines (bit i: channel i), first bit first. */
uint32_t word_of(const uint8_t *samples, uint8_t n_bits, uint8_t channel);

/* Each returns the encoder's health, and the count where there is one.
 *
 * SSI: the idle level, `bits` bits, the level in the pause after them (low while the
 * encoder holds its word); no check bits. */
enum health word_ssi(const uint8_t *samples, uint8_t channel, uint8_t bits, bool gray,
                     uint32_t *count);

/* BiSS-C: until the start bit, then a zero, `bits` bits, error and warning (low if so) and
 * an inverted CRC of six bits, polynomial 43. */
#define BISS_TAIL 8U         /* error, warning, CRC */
#define BISS_WAIT 16U        /* bits until the start bit at most */
enum health word_biss(const uint8_t *samples, uint8_t channel, uint8_t bits, uint32_t *count);

/* AS5047, AS5048A: even parity, an error flag, 14 bits. */
enum health word_as5047(const uint8_t *samples, uint8_t channel, uint32_t *count);

/* AMT21 and AMT22: two inverted parities, of odd and of even bits, and 14 bits. */
uint32_t word_position_14(uint16_t word);
enum health word_check_amt(uint16_t word);
enum health word_amt22(const uint8_t *samples, uint8_t channel, uint32_t *count);

#endif
