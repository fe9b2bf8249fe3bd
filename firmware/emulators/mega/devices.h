/* What the models of encoders share. */
#ifndef DEVICES_H
#define DEVICES_H

#include "encoders.h"
#include "motion.h"

struct device {
    struct motion *motion;
    unsigned bits;
    enum fault fault;
    uint64_t latched_at;
    bool line_is_known;
    bool line;      /* level of the data line */
    uint64_t word;  /* what it shifts out, the next bit uppermost of n_left */
    unsigned n_left;
};

extern struct device devices[MOTIONS];
extern unsigned n_devices;

/* Latch now: the count. */
uint32_t device_latch(struct device *device);
/* Set the data line (PA0 onwards). */
void device_set_data(unsigned channel, bool level);

void quadrature_begin(void);
void quadrature_restart(void);

void ssi_begin(void);
void biss_begin(void);
void as5047_begin(void);
void amt22_begin(void);
void shift_restart(void);

void amt21_begin(void);
void amt21_restart(void);

void as5600_begin(void);
void multiplexer_begin(void);
void i2c_restart(void);

#endif
