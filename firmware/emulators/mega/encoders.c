#include "encoders.h"

#include <math.h>
#include <string.h>

#include "devices.h"
#include "machine.h"

struct device devices[MOTIONS];
unsigned n_devices;
static void (*restart)(void);

static const struct {
    const char *name;
    void (*begin)(void);
    void (*restart)(void);
} kinds[] = {
    {"quadrature", quadrature_begin, quadrature_restart},
    {"ssi", ssi_begin, shift_restart},
    {"biss", biss_begin, shift_restart},
    {"as5047", as5047_begin, shift_restart},
    {"amt22", amt22_begin, shift_restart},
    {"amt21", amt21_begin, amt21_restart},
    {"as5600", as5600_begin, i2c_restart},
    {"as5600-multiplexer", multiplexer_begin, i2c_restart},
};

bool encoders_init(const char *kind, unsigned n_channels, unsigned bits, uint32_t counts_per_turn)
{
    n_devices = n_channels;
    motion_init(counts_per_turn != 0U ? counts_per_turn : (uint32_t)1U << bits, CYCLES_PER_S);
    for (unsigned i = 0U; i < n_channels; i++) {
        devices[i] = (struct device){.motion = &motions[i], .bits = bits};
    }
    for (unsigned i = 0U; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (strcmp(kinds[i].name, kind) == 0) {
            kinds[i].begin();
            restart = kinds[i].restart;
            restart();
            return true;
        }
    }
    return false;
}

void encoders_restart(void)
{
    restart();
}

void encoders_fail(unsigned channel, enum fault fault)
{
    devices[channel].fault = fault;
}

void encoders_await_latch(void)
{
    for (unsigned i = 0U; i < n_devices; i++) {
        devices[i].latched_at = 0U;
    }
}

uint64_t encoders_latched_at(unsigned channel)
{
    return devices[channel].latched_at;
}

uint32_t device_latch(struct device *device)
{
    if (device->latched_at == 0U) {
        device->latched_at = machine->cycle;
    }
    return motion_count(device->motion, machine->cycle);
}

void device_set_data(unsigned channel, bool level)
{
    struct device *device = &devices[channel];
    /* An absent encoder leaves its line to the pull-up. */
    const bool line = level || device->fault == ABSENT;
    if (!device->line_is_known || device->line != line) {
        device->line_is_known = true;
        device->line = line;
        machine_set_line('A', channel, line);
    }
}
