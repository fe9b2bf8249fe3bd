/* Timers 4 and 5 count the same 2 MHz. Each stamps one input in hardware: the tick of an
 * edge does not depend on when its interrupt is served. Timer 5 also has the counter's
 * upper half, the timer of samples (compare A) and a wake-up of the main loop each
 * millisecond (compare B). */
#include "clock.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "pins.h"
#include "settings.h"

#define SOONEST_TICKS 16U     /* compare can be set this far ahead without missing it */
#define LONGEST_TICKS 0xF000U /* farther ahead, the overflow looks again */
#define WAKE_TICKS (CLOCK_HZ / 1000U)
#define ENTRY_TICKS 40 /* way of a capture's interrupt past those of the line: 20 us */

/* Interrupts that call the core: those of input captures and of compare A. */
#define CORE_4 _BV(ICIE4)
#define CORE_5 ((uint8_t)(_BV(ICIE5) | _BV(OCIE5A)))

static volatile uint16_t clock_high; /* upper half of the counter */

volatile bool clock_woken;

static struct {
    struct lb_board *board;
    uint8_t holds;   /* how many hold the core's interrupts away */
    uint16_t held;   /* since when they did at last, by the counter's lower half */
    uint16_t freed;  /* and until when */
    bool is_set;     /* a tick is set */
    bool is_armed;   /* and compare A is set to it */
    uint32_t target; /* that tick */
    uint8_t levels;  /* of the inputs, by the edges captured */
} timer;

/* Set the enable bits to what is wanted now. Interrupts are off. */
static void enable(void)
{
    const bool is_free = timer.holds == 0U;
    uint8_t timer_5 = (uint8_t)(_BV(TOIE5) | _BV(OCIE5B));
    if (is_free) {
        timer_5 |= (uint8_t)_BV(ICIE5);
    }
    if (is_free && timer.is_armed) {
        timer_5 |= (uint8_t)_BV(OCIE5A);
    }
    TIMSK5 = timer_5;
    TIMSK4 = (is_free && INPUTS > 1) ? CORE_4 : 0U;
}

/* Whether a capture waits for its interrupt. */
static bool captures_wait(void)
{
    return (TIFR5 & _BV(ICF5)) != 0U || (INPUTS > 1 && (TIFR4 & _BV(ICF4)) != 0U);
}

/* Keep the core's interrupts away. Interrupts are off. */
static void hold(void)
{
    /* A capture that waits since an earlier hold has not been served between the two. */
    if (timer.holds == 0U && !captures_wait()) {
        timer.held = TCNT5;
    }
    timer.holds++;
    enable();
}

/* Let them come again. Interrupts are off. */
static void release(void)
{
    timer.holds--;
    timer.freed = TCNT5;
    enable();
}

uint32_t clock_ticks(void)
{
    const pins_state state = pins_lock(); /* both bytes of TCNT5 go through one register, shared with interrupts */
    const uint16_t low = TCNT5;
    uint16_t high = clock_high;
    if ((TIFR5 & _BV(TOV5)) != 0U && low < 0x8000U) {
        high++; /* it has overflowed, and its interrupt waits */
    }
    pins_unlock(state);
    return ((uint32_t)high << 16) | low;
}

uint8_t clock_inputs(void)
{
    /* Contacts to ground: low is active. */
    const uint8_t low = (uint8_t)~PINL;
    uint8_t levels = (low & _BV(PL1)) != 0U ? 1U : 0U;
    if (INPUTS > 1 && (low & _BV(PL0)) != 0U) {
        levels |= 2U;
    }
    return levels;
}

/* Set compare A, if the target is near enough. Interrupts are off. */
static void arm(void)
{
    const int32_t ahead = (int32_t)(timer.target - clock_ticks());
    timer.is_armed = timer.is_set && ahead < (int32_t)LONGEST_TICKS;
    if (timer.is_armed) {
        OCR5A = ahead < (int32_t)SOONEST_TICKS ? (uint16_t)(TCNT5 + SOONEST_TICKS)
                                               : (uint16_t)timer.target;
    }
    enable();
}

void clock_set_timer(uint32_t tick)
{
    const pins_state state = pins_lock();
    timer.target = tick;
    timer.is_set = true;
    arm();
    pins_unlock(state);
}

void clock_stop_timer(void)
{
    const pins_state state = pins_lock();
    timer.is_set = false;
    timer.is_armed = false;
    enable();
    pins_unlock(state);
}

void clock_hold(void)
{
    const pins_state state = pins_lock();
    hold();
    pins_unlock(state);
}

void clock_release(void)
{
    const pins_state state = pins_lock();
    release();
    pins_unlock(state);
}

bool clock_take_woken(void)
{
    const bool woken = clock_woken;
    clock_woken = false;
    return woken;
}

void clock_init(struct lb_board *board)
{
    timer.board = board;
    PORTL |= (uint8_t)(_BV(PL1) | _BV(PL0)); /* pulled up */
    pins_wait_us(10);                        /* until they are */
    timer.levels = clock_inputs();
    /* Both timers begin together: their common prescaler stands still meanwhile. */
    GTCCR = _BV(TSM) | _BV(PSRSYNC);
    TCNT4 = 0U;
    TCNT5 = 0U;
    OCR5B = WAKE_TICKS;
    /* Normal mode; ICNC: an edge counts once it has held for four cycles; ICES: the rising
     * one, where a button is held already; CS 010: F_CPU / 8. */
    TCCR4A = 0U;
    TCCR5A = 0U;
    TCCR4B = (uint8_t)(_BV(ICNC4) | _BV(CS41) | ((timer.levels & 2U) != 0U ? _BV(ICES4) : 0));
    TCCR5B = (uint8_t)(_BV(ICNC5) | _BV(CS51) | ((timer.levels & 1U) != 0U ? _BV(ICES5) : 0));
    GTCCR = 0U;
    enable();
}

/* Begin work that calls the core: other interrupts may come from here on. */
static void begin(void)
{
    hold();
    sei();
}

static void end(void)
{
    cli();
    clock_wake();
    release();
}

ISR(TIMER5_OVF_vect)
{
    clock_high++;
    if (timer.is_set && !timer.is_armed) {
        arm();
    }
}

ISR(TIMER5_COMPB_vect)
{
    OCR5B = (uint16_t)(OCR5B + WAKE_TICKS);
    clock_wake();
}

ISR(TIMER5_COMPA_vect)
{
    if (!timer.is_set || (int32_t)(clock_ticks() - timer.target) < 0) {
        arm(); /* a match of before it was set */
        return;
    }
    timer.is_set = false;
    timer.is_armed = false;
    begin();
    lb_timer_due(timer.board);
    end();
}

/* An input has changed at the lower half of a tick; its other edge is awaited already. */
static void captured(uint8_t bit, uint16_t low)
{
    const uint32_t now = clock_ticks();
    uint32_t tick = now - (uint16_t)((uint16_t)now - low);
    /* Strategy: the capture holds one time only. Of a contact that bounced while
     * interrupts were held it has the last closure; the first was after the hold's begin.
     * Holds of less than a turn of the lower half come each millisecond. */
    const uint16_t since_held = (uint16_t)(low - timer.held);
    const bool has_waited = (int16_t)(low - timer.freed) < ENTRY_TICKS && (int16_t)since_held > 0;
    const uint32_t earliest = has_waited ? tick - since_held : tick;
    timer.levels ^= bit;
    begin();
    lb_inputs_changed(timer.board, earliest, tick, timer.levels);
    cli();
    /* A bounce that was shorter than the interrupt's way to here left no second capture. */
    while (((clock_inputs() ^ timer.levels) & bit) != 0U && !captures_wait()) {
        tick = clock_ticks();
        timer.levels ^= bit;
        if (bit == 1U) {
            TCCR5B ^= _BV(ICES5);
        } else {
            TCCR4B ^= _BV(ICES4);
        }
        sei();
        lb_inputs_changed(timer.board, tick, tick, timer.levels);
        cli();
    }
    end();
}

ISR(TIMER5_CAPT_vect)
{
    const uint16_t low = ICR5;
    TCCR5B ^= _BV(ICES5);
    TIFR5 = _BV(ICF5); /* changing the edge may set it */
    captured(1U, low);
}

ISR(TIMER4_CAPT_vect)
{
    const uint16_t low = ICR4;
    TCCR4B ^= _BV(ICES4);
    TIFR4 = _BV(ICF4);
    captured(2U, low);
}
