/* An edge is stamped by an interrupt of the highest priority, which does nothing else; the
 * core's work on it is done by another one, which waits while something is latched. */
#include "clock.h"

#include <stdbool.h>

#include "pins.h"
#include "quadrature.h"
#include "start.h"

#define CORE ((1U << IRQ_TIMER_0) | (1U << IRQ_CHANGES))
#define WAKE_TICKS (CLOCK_HZ / 1000U)
#define CHANGES 16U
#define INPUTS_MASK ((1U << INPUTS) - 1U)

static struct {
    struct lb_board *board;
    volatile uint32_t holds;
    uint8_t levels; /* of the inputs, after the last change */
    volatile uint32_t head; /* of the changes that wait; places wrap */
    volatile uint32_t tail;
    struct {
        uint32_t tick;
        uint8_t levels;
    } changes[CHANGES];
} timer;

uint32_t clock_ticks(void)
{
    return TIMER_RAWL;
}

uint8_t clock_inputs(void)
{
    return (uint8_t)(~(GPIO_IN >> PIN_FIRST_INPUT) & INPUTS_MASK); /* contacts to ground */
}

void clock_set_timer(uint32_t tick)
{
    TIMER_ALARM0 = tick; /* also arms it */
    if ((int32_t)(tick - TIMER_RAWL) <= 0) {
        NVIC_SET_PENDING = 1U << IRQ_TIMER_0; /* an alarm compares for equality */
    }
}

void clock_stop_timer(void)
{
    TIMER_ARMED = 1U << 0;
    TIMER_INTR = 1U << 0;
}

void clock_hold(void)
{
    NVIC_DISABLE = CORE;
    __asm__ volatile("dsb\n isb" : : : "memory"); /* none begins after this */
    timer.holds++;
}

void clock_release(void)
{
    timer.holds--;
    if (timer.holds == 0U) {
        __asm__ volatile("" : : : "memory");
        NVIC_ENABLE = CORE;
    }
}

void clock_init_inputs(void)
{
    for (uint32_t i = 0U; i < INPUTS; i++) {
        pins_init_pin(PIN_FIRST_INPUT + i);
    }
    pins_wait_us(10U); /* until they are pulled up */
}

void clock_init(struct lb_board *board)
{
    timer.board = board;
    timer.levels = clock_inputs();
    IO_PROC0_INTE(2U) = INPUTS > 1 ? 0xCCU : 0xCU; /* both edges of pins 16 and 17 */
    TIMER_INTE = 3U;
    TIMER_ALARM1 = TIMER_RAWL + WAKE_TICKS;
    /* Priorities, two bits of each byte: pins first, the line, then the core. */
    NVIC_PRIORITY(0U) = 0x00008080U; /* interrupts 0 (samples) and 1 (wake-up) */
    NVIC_PRIORITY(3U) = 0x00000000U; /* 13: pins */
    NVIC_PRIORITY(5U) = 0x00000040U; /* 20: line */
    NVIC_PRIORITY(6U) = 0x00800000U; /* 26: changes of inputs */
    NVIC_ENABLE = CORE | (1U << IRQ_TIMER_1) | (1U << IRQ_IO_BANK0) | (1U << IRQ_UART0);
}

void timer_due(void)
{
    TIMER_INTR = 1U << 0;
    TIMER_ARMED = 1U << 0;
    lb_timer_due(timer.board);
}

/* The main loop sleeps until any interrupt. */
void timer_wakes(void)
{
    TIMER_INTR = 1U << 1;
    TIMER_ALARM1 = TIMER_RAWL + WAKE_TICKS;
}

void pins_changed(void)
{
    const uint32_t tick = TIMER_RAWL;
    /* Acknowledged before they are read: what changes later interrupts again. */
    IO_INTR(0U) = 0xFFFFFFFFU;
    IO_INTR(1U) = 0xFFFFFFFFU;
    IO_INTR(2U) = 0xFFFFFFFFU;
#if FRONT_END == QUADRATURE
    const uint8_t index = pins_index();
    quadrature_changed(0U, pins_bank(0U), index);
    quadrature_changed(1U, pins_bank(1U), index);
#endif
    const uint8_t levels = clock_inputs();
    if (levels != timer.levels) {
        const uint32_t head = timer.head;
        if (head - timer.tail < CHANGES) {
            timer.changes[head % CHANGES].tick = tick;
            timer.changes[head % CHANGES].levels = levels;
            timer.head = head + 1U;
            timer.levels = levels; /* else it differs still, at the next interrupt */
        }
        NVIC_SET_PENDING = 1U << IRQ_CHANGES;
    }
}

void changes_due(void)
{
    while (timer.tail != timer.head) {
        const uint32_t place = timer.tail % CHANGES;
        const uint32_t tick = timer.changes[place].tick;
        lb_inputs_changed(timer.board, tick, tick, timer.changes[place].levels);
        timer.tail++;
    }
}
