/* AS5600 sensors on I2C, each with an SDA line of its own (PA0 onwards) or all behind a
 * TCA9548A on the first; SCL is PG0. From their data sheets. */
#include <stddef.h>

#include <simavr/avr_ioport.h>

#include "devices.h"
#include "machine.h"

#define SENSOR 0x36U
#define MULTIPLEXER 0x70U

enum phase { IDLE, ADDRESS, WRITING, READING };

/* A bus: what its slaves have seen. */
struct bus {
    enum phase phase;
    unsigned n_bits;     /* of the byte, 8: the acknowledge */
    unsigned byte;
    unsigned n_bytes;    /* after the address */
    bool to_multiplexer;
    bool acknowledges;   /* a slave pulls the line now */
    bool master_acked;
    bool pulled;         /* by a slave */
    bool sda_seen;
    uint8_t sending;
    uint8_t pending_channels; /* of the multiplexer, from the next stop on */
    uint8_t channels;
};

static struct bus buses[MOTIONS];
static uint8_t pointers[MOTIONS]; /* register of each sensor */
static uint16_t angles[MOTIONS];  /* latched when a read begins */
static bool has_multiplexer;
static unsigned n_buses;
static uint8_t master_low; /* SDA lines that the processor drives low */
static bool scl = true;

static bool sda_of(unsigned line)
{
    return (master_low >> line & 1U) == 0U && !buses[line].pulled;
}

static void pull(unsigned line, bool low)
{
    buses[line].pulled = low;
    machine_set_line('A', line, sda_of(line));
}

/* The sensor that the bus reaches; MOTIONS for none. */
static unsigned sensor_of(unsigned line)
{
    unsigned sensor = line;
    if (has_multiplexer) {
        sensor = MOTIONS;
        for (unsigned i = 0U; i < n_devices; i++) {
            if (buses[0].channels == 1U << i) {
                sensor = i;
            }
        }
    }
    return sensor < n_devices && devices[sensor].fault != ABSENT ? sensor : MOTIONS;
}

static uint8_t read_register(unsigned sensor)
{
    static const uint8_t statuses[] = {
        [NO_FAULT] = 0x20U, [WEAK] = 0x30U, [NO_MAGNET] = 0x10U, [ABSENT] = 0U, [BAD_CHECK] = 0x20U};
    uint8_t value = 0U;
    switch (pointers[sensor]) {
    case 0x0BU:
        value = statuses[devices[sensor].fault];
        pointers[sensor]++;
        break;
    case 0x0CU: /* the pointer of the angle goes to its low byte and back */
        angles[sensor] = (uint16_t)device_latch(&devices[sensor]);
        value = (uint8_t)(angles[sensor] >> 8);
        pointers[sensor] = 0x0DU;
        break;
    case 0x0DU:
        value = (uint8_t)angles[sensor];
        pointers[sensor] = 0x0CU;
        break;
    default:
        break;
    }
    return value;
}

/* A whole byte has come from the master; whether a slave acknowledges it. */
static bool take(unsigned line)
{
    struct bus *bus = &buses[line];
    const unsigned sensor = sensor_of(line);
    if (bus->phase == ADDRESS) {
        const unsigned address = bus->byte >> 1;
        bus->to_multiplexer = has_multiplexer && address == MULTIPLEXER;
        if (!bus->to_multiplexer && (address != SENSOR || sensor == MOTIONS)) {
            bus->phase = IDLE;
            return false;
        }
        bus->phase = (bus->byte & 1U) != 0U ? READING : WRITING;
        bus->n_bytes = 0U;
        return true;
    }
    if (bus->to_multiplexer) {
        bus->pending_channels = (uint8_t)bus->byte;
    } else if (bus->n_bytes == 0U) {
        pointers[sensor] = (uint8_t)bus->byte;
    }
    bus->n_bytes++;
    return true;
}

static void begin_byte(unsigned line)
{
    struct bus *bus = &buses[line];
    bus->n_bits = 0U;
    bus->byte = 0U;
    if (bus->phase == READING) {
        const unsigned sensor = sensor_of(line);
        bus->sending = sensor < MOTIONS ? read_register(sensor) : 0xFFU;
        pull(line, (bus->sending & 0x80U) == 0U);
    }
}

static void scl_rose(unsigned line)
{
    struct bus *bus = &buses[line];
    if (bus->phase == IDLE) {
        return;
    }
    if (bus->n_bits < 8U && bus->phase != READING) {
        bus->byte = bus->byte << 1 | (sda_of(line) ? 1U : 0U);
    } else if (bus->n_bits == 8U && bus->phase == READING && !bus->acknowledges) {
        bus->master_acked = !sda_of(line);
    }
}

static void scl_fell(unsigned line)
{
    struct bus *bus = &buses[line];
    if (bus->phase == IDLE) {
        return;
    }
    if (bus->n_bits == 8U) { /* the acknowledge is over */
        const bool more = bus->acknowledges || bus->master_acked;
        bus->acknowledges = false;
        pull(line, false);
        if (bus->phase == READING && !more) {
            bus->phase = IDLE;
            return;
        }
        begin_byte(line);
        return;
    }
    if (bus->n_bits > 8U) { /* the start's fall */
        begin_byte(line);
        return;
    }
    bus->n_bits++;
    if (bus->n_bits < 8U) {
        if (bus->phase == READING) {
            pull(line, (bus->sending >> (7U - bus->n_bits) & 1U) == 0U);
        }
    } else if (bus->phase == READING) {
        pull(line, false); /* the master acknowledges */
        bus->acknowledges = false;
    } else {
        bus->acknowledges = take(line);
        pull(line, bus->acknowledges);
    }
}

static void sda_changed(unsigned line)
{
    struct bus *bus = &buses[line];
    const bool sda = sda_of(line);
    if (sda == bus->sda_seen) {
        return;
    }
    bus->sda_seen = sda;
    if (scl && !sda) {
        bus->phase = ADDRESS;
        bus->n_bits = 9U;
        bus->acknowledges = false;
    } else if (scl) {
        bus->phase = IDLE;
        bus->channels = bus->pending_channels;
    }
}

static void sda_directions(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    master_low = (uint8_t)value;
    for (unsigned i = 0U; i < n_buses; i++) {
        machine_set_line('A', i, sda_of(i));
        sda_changed(i);
    }
}

static void scl_direction(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    const bool level = (value & 1U) == 0U;
    if (level == scl) {
        return;
    }
    scl = level;
    for (unsigned i = 0U; i < n_buses; i++) {
        if (level) {
            scl_rose(i);
        } else {
            scl_fell(i);
        }
        buses[i].sda_seen = sda_of(i);
    }
}

void i2c_restart(void)
{
    for (unsigned i = 0U; i < MOTIONS; i++) {
        buses[i] = (struct bus){.phase = IDLE, .sda_seen = true, .channels = buses[i].channels};
    }
}

static void begin(void)
{
    for (unsigned i = 0U; i < n_buses; i++) {
        machine_set_line('A', i, true);
    }
    avr_irq_t *a = avr_io_getirq(machine, AVR_IOCTL_IOPORT_GETIRQ('A'), IOPORT_IRQ_DIRECTION_ALL);
    avr_irq_t *g = avr_io_getirq(machine, AVR_IOCTL_IOPORT_GETIRQ('G'), IOPORT_IRQ_DIRECTION_ALL);
    avr_irq_register_notify(a, sda_directions, NULL);
    avr_irq_register_notify(g, scl_direction, NULL);
}

void as5600_begin(void)
{
    n_buses = n_devices;
    begin();
}

void multiplexer_begin(void)
{
    has_multiplexer = true;
    n_buses = 1U;
    begin();
}
