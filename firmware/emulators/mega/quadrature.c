/* Incremental encoders with A, B and index: A leads B when counting up, the index is high
 * in one of the four states, at multiples of a turn. */
#include <math.h>
#include <stddef.h>

#include "devices.h"
#include "machine.h"

/* Channels 0 to 3 on port K, 4 to 6 on port B; index lines on port C. */
static char port_of(unsigned channel)
{
    return channel < 4U ? 'K' : 'B';
}

static uint32_t shown[MOTIONS]; /* the count that the lines say */

static void show(unsigned channel, uint32_t count)
{
    static const bool level_a[4] = {false, true, true, false};
    static const bool level_b[4] = {false, false, true, true};
    const struct device *device = &devices[channel];
    const unsigned bit = 2U * (channel % 4U);
    const unsigned state = count % 4U;
    const unsigned before = shown[channel] % 4U;
    shown[channel] = count;
    if (device->fault == ABSENT) {
        return;
    }
    machine_set_line('C', channel, count == 0U);
    if (level_a[state] != level_a[before]) {
        machine_set_line(port_of(channel), bit, level_a[state]);
    }
    if (level_b[state] != level_b[before]) {
        machine_set_line(port_of(channel), bit + 1U, level_b[state]);
    }
}

/* A change of count is due. Returns when the next one is. */
static avr_cycle_count_t step(avr_t *avr, avr_cycle_count_t when, void *param)
{
    const struct device *device = param;
    const struct motion *motion = device->motion;
    const unsigned channel = (unsigned)(device - devices);
    (void)avr;
    show(channel, motion_count(motion, when));
    if (motion->counts_per_s == 0.0) {
        return 0;
    }
    const double position = motion_position(motion, when);
    /* Just at a whole count, one that counts down has it for a cycle more. */
    const double past = position - floor(position);
    const double left = motion->counts_per_s > 0.0 ? 1.0 - past : past;
    const double cycles = left * CYCLES_PER_S / fabs(motion->counts_per_s);
    return when + (avr_cycle_count_t)ceil(cycles + 1e-6);
}

void quadrature_begin(void)
{
    for (unsigned i = 0U; i < n_devices; i++) {
        const unsigned bit = 2U * (i % 4U);
        machine_set_line(port_of(i), bit, false);
        machine_set_line(port_of(i), bit + 1U, false);
    }
}

void quadrature_restart(void)
{
    for (unsigned i = 0U; i < n_devices; i++) {
        avr_cycle_timer_cancel(machine, step, &devices[i]);
        /* A hand that has moved it meanwhile turned it step by step. */
        const uint32_t count = motion_count(&motions[i], machine->cycle);
        while (shown[i] != count) {
            show(i, (shown[i] + 1U) % motions[i].modulus);
            (void)machine_run(machine->cycle + 800U);
        }
        avr_cycle_timer_register(machine, 1, step, &devices[i]);
    }
}
