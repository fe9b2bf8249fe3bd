/* What a port provides: the microcontroller, its encoders, its inputs and its line. */
#ifndef LB_PORT_H
#define LB_PORT_H

#include <stdint.h>

#include "config.h"

/* Bits of an encoder's status, section 4. */
enum {
    LB_STATUS_ERROR = 1,
    LB_STATUS_WARNING = 2,
    LB_STATUS_LATE = 4,
    LB_STATUS_STALE = 8
};

/* Temperature of a sensor that is not there, section 4. */
#define LB_NO_SENSOR INT16_MIN

/* Where nothing else is said, functions are called from the main loop only. */
struct lb_port {
    /* The counter that runs at tick_rate_hz and wraps at 2^32. Also from interrupts. */
    uint32_t (*ticks)(void);

    /* Latch all encoders at one instant: a count and a status for each channel. Returns
     * the ticks of that instant. Called from the main loop and from interrupts: where
     * the encoders share a bus, it locks interrupts itself. */
    uint32_t (*latch)(uint32_t *counts, uint8_t *status);

    /* The inputs now, bit i for input i, 1 where active. Also from interrupts. */
    uint8_t (*inputs)(void);

    /* Have lb_timer_due called, from an interrupt, when the counter reaches this tick;
     * at once where it has passed already (by less than 2^31). Replaces an earlier one. */
    void (*set_timer)(uint32_t tick);
    void (*stop_timer)(void);

    /* How many bytes send takes now without waiting. */
    uint16_t (*room)(void);
    /* Send the bytes of one frame; there is room for them. */
    void (*send)(const uint8_t *bytes, uint16_t n_bytes);

    /* A sensor in 0.01 Celsius, or LB_NO_SENSOR. */
    int16_t (*temperature)(uint8_t sensor);

    /* Keep interrupts away from what they share with the main loop, for some ten
     * instructions; pairs are not nested. Both are also barriers of the compiler's order
     * of memory accesses, since it does not see through the pointers. */
    void (*lock)(void);
    void (*unlock)(void);
};

/* An encoder, section 4. */
struct lb_channel {
    uint8_t bits;
    uint32_t modulus; /* 0 stands for 2^bits */
};

/* What HELLO says of the board, and what the port promises. */
struct lb_identity {
    uint8_t board_id[12];
    uint8_t firmware[3];
    uint8_t n_channels;
    uint8_t n_inputs;
    uint8_t n_temperatures;
    uint32_t tick_rate_hz;      /* 100 kHz to 100 MHz */
    uint32_t max_rate_millihz;  /* up to 10 kHz; 0 without channels */
    uint32_t boot_id;           /* drawn at power-up, never the one before */
    uint32_t late_ticks;        /* latched later than this after its instant: late */
    struct lb_channel channels[LB_MAX_CHANNELS];
};

#endif
