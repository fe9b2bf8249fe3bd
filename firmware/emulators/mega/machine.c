#include "machine.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>

/* Registers of the ATmega2560, by their addresses in data space. */
enum {
    TIFR4 = 0x39, TIFR5 = 0x3A, PCIFR = 0x3B, GTCCR = 0x43, PCICR = 0x68,
    PCMSK2 = 0x6D, TIMSK4 = 0x72, TIMSK5 = 0x73,
    PCINT2_VECTOR = 11
};
#define PORTS 12U /* A to L */
#define RAM_OF_ELF 0x800000U /* where the linker puts the data space */

avr_t *machine;
static uint16_t high_address; /* of clock_high, the upper half of the counter */
static uint32_t first_ticks_wanted;
static avr_irq_t *uart;
static avr_irq_t *bus; /* USART 1 */
static bool uart_is_full;

/* libsimavr has pin changes of port B only; these are port K's. */
static avr_int_vector_t pcint2 = {
    .enable = AVR_IO_REGBIT(PCICR, 2),
    .raised = AVR_IO_REGBIT(PCIFR, 2),
    .vector = PCINT2_VECTOR,
};

static void port_k_changed(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)param;
    if (irq->value != value && (machine->data[PCMSK2] >> irq->irq & 1U) != 0U) {
        (void)avr_raise_interrupt(machine, &pcint2);
    }
}

/* A flag is cleared by writing a one to it: libsimavr 1.6 clears all of the register. */
static void write_flags(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)param;
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        if (vector->raised.reg == address && (value >> vector->raised.bit & 1U) != 0U &&
            avr_regbit_get(avr, vector->raised)) {
            avr_clear_interrupt(avr, vector);
        }
    }
}

/* An interrupt whose flag was set while it was disabled comes when it is enabled. */
static void write_enables(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)param;
    avr->data[address] = value;
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        if (vector->enable.reg == address && avr_regbit_get(avr, vector->enable) &&
            avr_regbit_get(avr, vector->raised)) {
            (void)avr_raise_interrupt(avr, vector);
        }
    }
}

/* The firmware lets its counter run: now its upper half can be set. */
static void write_prescaler(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)param;
    avr->data[address] = value;
    if (value == 0U && high_address != 0U) {
        avr->data[high_address] = (uint8_t)(first_ticks_wanted >> 16);
        avr->data[high_address + 1U] = (uint8_t)(first_ticks_wanted >> 24);
    }
}

static avr_irq_t *line_of(char port, unsigned bit)
{
    return avr_io_getirq(machine, AVR_IOCTL_IOPORT_GETIRQ((uint32_t)port), (int)bit);
}

static void full(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    uart_is_full = value != 0U;
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    (void)avr;
    (void)cycles;
}

static void log_errors(avr_t *avr, const int level, const char *format, va_list values)
{
    (void)avr;
    if (level <= LOG_ERROR) {
        (void)vfprintf(stderr, format, values);
    }
}

bool machine_load(const char *elf, uint32_t first_ticks, uint32_t boot_id)
{
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    avr_global_logger_set(log_errors);
    if (elf_read_firmware(elf, &firmware) != 0) {
        return false;
    }
    machine = avr_make_mcu_by_name("atmega2560");
    if (machine == NULL) {
        return false;
    }
    (void)avr_init(machine);
    avr_load_firmware(machine, &firmware);
    machine->frequency = CYCLES_PER_S;
    machine->sleep = no_sleep;
    for (uint32_t i = 0U; i < firmware.symbolcount; i++) {
        if (strcmp(firmware.symbol[i]->symbol, "clock_high") == 0) {
            high_address = (uint16_t)(firmware.symbol[i]->addr - RAM_OF_ELF);
        }
    }
    first_ticks_wanted = first_ticks;

    avr_register_vector(machine, &pcint2);
    for (unsigned i = 0U; i < 8U; i++) {
        avr_irq_register_notify(line_of('K', i), port_k_changed, NULL);
    }
    static const avr_io_addr_t flags[] = {TIFR4, TIFR5};
    for (unsigned i = 0U; i < 2U; i++) {
        machine->io[AVR_DATA_TO_IO(flags[i])].w.c = write_flags;
    }
    avr_register_io_write(machine, TIMSK4, write_enables, NULL);
    avr_register_io_write(machine, TIMSK5, write_enables, NULL);
    avr_register_io_write(machine, GTCCR, write_prescaler, NULL);

    uint32_t no_flags = 0U; /* neither echoes lines nor sleeps by itself */
    (void)avr_ioctl(machine, AVR_IOCTL_UART_SET_FLAGS('0'), &no_flags);
    uart = avr_io_getirq(machine, AVR_IOCTL_UART_GETIRQ('0'), 0);
    avr_irq_register_notify(&uart[UART_IRQ_OUT_XOFF], full, NULL);

    (void)avr_ioctl(machine, AVR_IOCTL_UART_SET_FLAGS('1'), &no_flags);
    bus = avr_io_getirq(machine, AVR_IOCTL_UART_GETIRQ('1'), 0);

    uint8_t stored[4] = {(uint8_t)boot_id, (uint8_t)(boot_id >> 8), (uint8_t)(boot_id >> 16),
                         (uint8_t)(boot_id >> 24)};
    avr_eeprom_desc_t eeprom = {.ee = stored, .offset = 0U, .size = sizeof stored};
    (void)avr_ioctl(machine, AVR_IOCTL_EEPROM_SET, &eeprom);
    return true;
}

void machine_power(void)
{
    avr_reset(machine);
    uart_is_full = false;
}

bool machine_run(uint64_t until_cycle)
{
    machine->run_cycle_limit = 4000U;
    while (machine->cycle < until_cycle) {
        const int state = avr_run(machine);
        if (state == cpu_Done || state == cpu_Crashed) {
            return false;
        }
    }
    return true;
}

void machine_set_line(char port, unsigned bit, bool level)
{
    /* Driven from outside: the processor's pull-ups do not change it. */
    /* cppcheck-suppress unassignedVariable -- its elements are */
    static uint8_t driven[PORTS];
    static uint8_t levels[PORTS];
    const unsigned place = (unsigned)(port - 'A');
    driven[place] |= (uint8_t)(1U << bit);
    levels[place] = (uint8_t)((levels[place] & ~(1U << bit)) | (unsigned)level << bit);
    avr_ioport_external_t external = {
        .name = (unsigned)port & 0x7FU, .mask = driven[place], .value = levels[place]};
    (void)avr_ioctl(machine, AVR_IOCTL_IOPORT_SET_EXTERNAL((uint32_t)port), &external);
    avr_raise_irq(line_of(port, bit), level ? 1U : 0U);
}

void machine_watch_line(char port, unsigned bit, avr_irq_notify_t changed)
{
    avr_irq_register_notify(line_of(port, bit), changed, NULL);
}

bool machine_receive(uint8_t byte)
{
    if (uart_is_full) {
        return false;
    }
    avr_raise_irq(&uart[UART_IRQ_INPUT], byte);
    return true;
}

void machine_on_sent(avr_irq_notify_t sent)
{
    avr_irq_register_notify(&uart[UART_IRQ_OUTPUT], sent, NULL);
}

void machine_bus_receive(uint8_t byte)
{
    avr_raise_irq(&bus[UART_IRQ_INPUT], byte);
}

void machine_on_bus_sent(avr_irq_notify_t sent)
{
    avr_irq_register_notify(&bus[UART_IRQ_OUTPUT], sent, NULL);
}
