/* Strategy: all wires are driven at once, one slot of a bit (70 us) a millisecond, so that
 * the main loop is never held up for longer; a round of 108 slots and the conversion take
 * a second. Interrupts are locked only where a slot bears no delay, for some 12 us. One
 * that stretches another slot spoils the round, which the check of nine bytes shows. */
#include "thermometers.h"

#include "settings.h"

#if THERMOMETERS > 0

#include <stdbool.h>

#include "pins.h"
#include "port.h"

#define SKIP_ROM 0xCCU /* to whoever is on the wire */
#define CONVERT 0x44U
#define READ_SCRATCHPAD 0xBEU

#define SCRATCHPAD_BYTES 9U
#define FIXED_BYTE 5U /* always FF: a wire that is held low sends zeros, whose check is right */
#define POWER_UP_RAW 0x0550 /* 85 Celsius, before the first conversion: no measurement */
#define CRC_POLYNOMIAL 0x8CU /* x^8 + x^5 + x^4 + 1, the lowest bit first */
#define CONVERSION_MS 800U
#define ROUNDS_KEPT 3U

/* The slots of a round. */
#define COMMAND_BITS 16U
#define CONVERT_BEGINS 2U /* after the reset and the answer to it */
#define SECOND_RESET (CONVERT_BEGINS + COMMAND_BITS)
#define READ_BEGINS (SECOND_RESET + 2U)
#define DATA_BEGINS (READ_BEGINS + COMMAND_BITS)
#define ROUND_ENDS (DATA_BEGINS + (SCRATCHPAD_BYTES * 8U))

static struct {
    uint8_t slot;      /* of the round, the next one */
    uint32_t due_tick;
    uint8_t bytes[THERMOMETERS][SCRATCHPAD_BYTES];
    int16_t hundredths_c[THERMOMETERS];
    uint8_t rounds_left[THERMOMETERS]; /* for which the value stands */
    bool begun;
} wires;

static void write_bit(bool bit)
{
    if (bit) {
        const pins_state state = pins_lock();
        pins_wires_low(true);
        pins_wait_us(5);
        pins_wires_low(false);
        pins_unlock(state);
        pins_wait_us(60);
    } else {
        pins_wires_low(true);
        pins_wait_us(65);
        pins_wires_low(false);
        pins_wait_us(5);
    }
}

static uint8_t read_bits(void)
{
    const pins_state state = pins_lock();
    pins_wires_low(true);
    pins_wait_us(2);
    pins_wires_low(false);
    pins_wait_us(8);
    const uint8_t levels = pins_wires();
    pins_unlock(state);
    pins_wait_us(55);
    return levels;
}

static uint8_t crc(const uint8_t *bytes)
{
    uint8_t rest = 0U;
    for (uint8_t i = 0U; i < SCRATCHPAD_BYTES; i++) {
        rest ^= bytes[i];
        for (uint8_t bit = 0U; bit < 8U; bit++) {
            rest = (uint8_t)((rest & 1U) != 0U ? (rest >> 1) ^ CRC_POLYNOMIAL : rest >> 1);
        }
    }
    return rest;
}

static void judge(uint8_t sensor)
{
    const uint8_t *bytes = wires.bytes[sensor];
    const int16_t raw = (int16_t)((uint16_t)bytes[0] | ((uint16_t)bytes[1] << 8));
    if (crc(bytes) == 0U && bytes[FIXED_BYTE] == 0xFFU && raw != POWER_UP_RAW) {
        wires.hundredths_c[sensor] = (int16_t)(((int32_t)raw * 25) / 4); /* of 1/16 */
        wires.rounds_left[sensor] = ROUNDS_KEPT;
    } else if (wires.rounds_left[sensor] > 0U) {
        wires.rounds_left[sensor]--;
    }
}

static void command_bit(uint8_t command, uint8_t place)
{
    const unsigned word = SKIP_ROM | ((unsigned)command << 8);
    write_bit((word >> place & 1U) != 0U);
}

static void data_bit(uint8_t place)
{
    const uint8_t levels = read_bits();
    for (uint8_t i = 0U; i < THERMOMETERS; i++) {
        uint8_t *byte = &wires.bytes[i][place / 8U];
        *byte = (uint8_t)(*byte >> 1);
        if (((unsigned)levels >> i & 1U) != 0U) {
            *byte |= 0x80U;
        }
    }
}

void thermometers_serve(uint32_t now, uint32_t ticks_per_ms)
{
    if (wires.begun && (int32_t)(now - wires.due_tick) < 0) {
        return;
    }
    wires.begun = true;
    wires.due_tick = now + ticks_per_ms;
    const uint8_t slot = wires.slot;
    if (slot == 0U || slot == SECOND_RESET) {
        pins_wires_low(true); /* until the next slot */
    } else if (slot == 1U || slot == SECOND_RESET + 1U) {
        pins_wires_low(false); /* sensors answer until the next slot, which need not be seen */
    } else if (slot < SECOND_RESET) {
        command_bit(CONVERT, (uint8_t)(slot - CONVERT_BEGINS));
    } else if (slot < DATA_BEGINS) {
        command_bit(READ_SCRATCHPAD, (uint8_t)(slot - READ_BEGINS));
    } else {
        data_bit((uint8_t)(slot - DATA_BEGINS));
    }
    wires.slot++;
    if (wires.slot == SECOND_RESET) {
        wires.due_tick = now + (CONVERSION_MS * ticks_per_ms);
    } else if (wires.slot == ROUND_ENDS) {
        for (uint8_t i = 0U; i < THERMOMETERS; i++) {
            judge(i);
        }
        wires.slot = 0U;
    }
}

int16_t thermometers_hundredths_c(uint8_t sensor)
{
    return wires.rounds_left[sensor] > 0U ? wires.hundredths_c[sensor] : LB_NO_SENSOR;
}

#endif
