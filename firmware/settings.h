/* What your board is built for: the file to edit. Each value can also be given to make:
 * `make mega FRONT_END=SSI CHANNELS=7`. Pins are in ports/<processor>/pins.h. */
#ifndef SETTINGS_H
#define SETTINGS_H

/* Kinds of encoders; all encoders of a board are of one kind. */
#define QUADRATURE 1 /* A, B, index: incremental */
#define SSI 2
#define BISS 3   /* BiSS-C, point to point */
#define AS5047 4 /* SPI: AS5047, AS5048A */
#define AMT22 5  /* SPI */
#define AS5600 6 /* I2C: one SDA line for each, or one bus behind a TCA9548A */
#define AMT21 7  /* RS-485: one bus, at 2 Mbit/s */

#ifndef FRONT_END
#define FRONT_END QUADRATURE
#endif

/* Number of encoders, 1 to 7. */
#ifndef CHANNELS
#define CHANNELS 7
#endif

/* QUADRATURE: counts per turn of each encoder (four times its lines), and whether their
 * index lines are wired. */
#ifndef COUNTS_PER_TURN
#define COUNTS_PER_TURN {8192, 8192, 8192, 8192, 8192, 8192, 8192}
#endif
#ifndef INDEX_WIRED
#define INDEX_WIRED 0
#endif

/* SSI, BISS: bits of the word (1 to 32); SSI: whether it is in Gray code. */
#ifndef WORD_BITS
#define WORD_BITS 19
#endif
#ifndef GRAY_CODE
#define GRAY_CODE 0
#endif

/* AS5600: 1 where all are on one bus behind a TCA9548A (its address pins low). */
#ifndef I2C_MULTIPLEXER
#define I2C_MULTIPLEXER 0
#endif

/* AMT21: the address of each encoder, channel 0 first. */
#ifndef AMT21_ADDRESSES
#define AMT21_ADDRESSES {0x54, 0x58, 0x5C, 0x60, 0x64, 0x68, 0x6C}
#endif

/* DS18B20 thermometers, each on a pin of its own: 0 to 4 (Mega), 0 to 3 (Pico). */
#ifndef THERMOMETERS
#define THERMOMETERS 0
#endif

/* Button and touch probe: contacts to ground, 1 or 2 of them. */
#ifndef INPUTS
#define INPUTS 2
#endif

/* Of the serial line; 16 MHz divide to 500000 and 1000000 without a rest. */
#ifndef BAUD_RATE
#define BAUD_RATE 1000000
#endif

/* Boards of one computer need different numbers: part of their board_id. */
#ifndef BOARD_NUMBER
#define BOARD_NUMBER 1
#endif

#endif
