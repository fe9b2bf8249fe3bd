#include "words.h"

#define BITS_OF_BYTE 8U
#define ALL_ONES_16 0xFFFFU
#define POSITION_14 0x3FFFU
#define BISS_CRC_BITS 6U
#define BISS_POLYNOMIAL 0x03U /* x^6 + x + 1, without its highest term */

uint32_t word_of(const uint8_t *samples, uint8_t n_bits, uint8_t channel)
{
    const uint8_t mask = (uint8_t)(1U << channel);
    uint32_t word = 0U;
    /* Byte by byte: a small processor shifts a byte five times faster than a word. */
    uint8_t i = 0U;
    while (i < n_bits) {
        uint8_t byte = 0U;
        uint8_t n_taken = 0U;
        while (i < n_bits && n_taken < BITS_OF_BYTE) {
            byte = (uint8_t)(byte << 1);
            if ((samples[i] & mask) != 0U) {
                byte |= 1U;
            }
            i++;
            n_taken++;
        }
        word = (word << n_taken) | byte;
    }
    return word;
}

static bool level(const uint8_t *samples, uint8_t place, uint8_t channel)
{
    return ((unsigned)samples[place] >> channel & 1U) != 0U;
}

static uint8_t parity(uint16_t word)
{
    uint8_t folded = (uint8_t)((word >> 8) ^ word);
    folded ^= (uint8_t)(folded >> 4);
    folded ^= (uint8_t)(folded >> 2);
    folded ^= (uint8_t)(folded >> 1);
    return folded & 1U;
}

enum health word_ssi(const uint8_t *samples, uint8_t channel, uint8_t bits, bool gray,
                     uint32_t *count)
{
    const bool idle = level(samples, 0U, channel);
    const bool pause = level(samples, (uint8_t)(bits + 1U), channel);
    uint32_t word = word_of(&samples[1], bits, channel);
    if (gray) {
        for (uint8_t shift = 1U; shift < 32U; shift = (uint8_t)(shift << 1)) {
            word ^= word >> shift;
        }
    }
    *count = word;
    /* Without an encoder or its power the line is at one level all the time. */
    return idle && !pause ? HEALTHY : SILENT;
}

enum health word_biss(const uint8_t *samples, uint8_t channel, uint8_t bits, uint32_t *count)
{
    uint8_t place = 0U;
    while (place < BISS_WAIT && level(samples, place, channel)) {
        place++; /* idle: high, until it acknowledges */
    }
    while (place < BISS_WAIT && !level(samples, place, channel)) {
        place++;
    }
    *count = 0U;
    if (place >= BISS_WAIT) {
        return SILENT;
    }
    place = (uint8_t)(place + 2U); /* the start bit, and one of register access */
    *count = word_of(&samples[place], bits, channel);

    /* Error and warning belong to what the CRC covers. */
    const uint8_t n_covered = (uint8_t)(bits + 2U);
    uint8_t crc = 0U;
    for (uint8_t i = 0U; i < n_covered; i++) {
        const bool bit = level(samples, (uint8_t)(place + i), channel);
        const bool carry = (crc & 0x20U) != 0U;
        crc = (uint8_t)((uint8_t)(crc << 1) & 0x3FU);
        if (bit != carry) {
            crc ^= BISS_POLYNOMIAL;
        }
    }
    const uint8_t sent = (uint8_t)word_of(&samples[(unsigned)place + n_covered], BISS_CRC_BITS, channel);
    if ((sent ^ crc) != 0x3FU) {
        return INVALID; /* it is sent inverted */
    }
    if (!level(samples, (uint8_t)(place + bits), channel)) {
        return INVALID;
    }
    if (!level(samples, (uint8_t)((unsigned)place + bits + 1U), channel)) {
        return WEAK;
    }
    return HEALTHY;
}

uint32_t word_position_14(uint16_t word)
{
    return word & POSITION_14;
}

enum health word_check_amt(uint16_t word)
{
    /* Odd bits with K1, even ones with K0: each an odd number of ones. */
    return parity(word & 0xAAAAU) == 1U && parity(word & 0x5555U) == 1U ? HEALTHY : INVALID;
}

enum health word_as5047(const uint8_t *samples, uint8_t channel, uint32_t *count)
{
    const uint16_t word = (uint16_t)word_of(samples, 16U, channel);
    *count = word_position_14(word);
    if (word == ALL_ONES_16) {
        return SILENT; /* the pull-up */
    }
    const bool error = (word & 0x4000U) != 0U;
    return error || parity(word) != 0U ? INVALID : HEALTHY;
}

enum health word_amt22(const uint8_t *samples, uint8_t channel, uint32_t *count)
{
    const uint16_t word = (uint16_t)word_of(samples, 16U, channel);
    *count = word_position_14(word);
    if (word == ALL_ONES_16) {
        return SILENT;
    }
    return word_check_amt(word);
}
