/* USART 1: D18 (TX), D19 (RX); the driver is enabled by D40. */
#include "bus.h"

#include "pins.h"
#include "settings.h"

#if FRONT_END == AMT21

/* Twice the usual rate: eight cycles a bit. */
#define DIVIDER (F_CPU / 8U / BUS_BAUD_RATE)
_Static_assert(DIVIDER * BUS_BAUD_RATE * 8U == F_CPU, "the clock must be 16 MHz");

void bus_init(void)
{
    pins_init_bus();
    UCSR1A = _BV(U2X1); /* before the divider, when libsimavr computes its rate */
    UBRR1 = DIVIDER - 1U;
    UCSR1C = _BV(UCSZ11) | _BV(UCSZ10); /* 8 data bits, no parity, 1 stop bit */
    UCSR1B = _BV(RXEN1) | _BV(TXEN1);
}

void bus_send(uint8_t byte)
{
    while ((UCSR1A & _BV(RXC1)) != 0U) {
        (void)UDR1;
    }
    /* An encoder answers some 3 us later: the driver has to be off by then. */
    const pins_state state = pins_lock();
    pins_select(true);
    UCSR1A = _BV(U2X1) | _BV(TXC1); /* a one clears the flag */
    UDR1 = byte;
    while ((UCSR1A & _BV(TXC1)) == 0U) {
    }
    pins_select(false);
    pins_unlock(state);
}

bool bus_take(uint8_t *byte)
{
    if ((UCSR1A & _BV(RXC1)) == 0U) {
        return false;
    }
    *byte = UDR1;
    return true;
}

#endif
