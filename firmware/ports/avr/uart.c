/* USART 0, which the Mega's USB converter is wired to. */
#include "uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "clock.h"
#include "settings.h"

/* Twice the usual rate: eight cycles a bit. */
#define CYCLES_PER_BIT 8U
#define DIVIDER ((F_CPU / CYCLES_PER_BIT) / BAUD_RATE)
_Static_assert(DIVIDER * BAUD_RATE * CYCLES_PER_BIT == F_CPU,
               "BAUD_RATE does not divide the clock; 1000000 and 500000 do");

/* Rings of 256 bytes: their places wrap as a uint8_t does. One place stays empty. */
#define RING_BYTES 256U

struct ring {
    volatile uint8_t head; /* where the next byte is put */
    volatile uint8_t tail; /* where the next byte is taken */
    uint8_t bytes[RING_BYTES];
};

static struct ring received;
static struct ring sending;

void uart_init(void)
{
    UCSR0A = _BV(U2X0); /* before the divider, when libsimavr computes its rate */
    UBRR0 = DIVIDER - 1U;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);              /* 8 data bits, no parity, 1 stop bit */
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);  /* both ways; received bytes interrupt */
}

bool uart_take(uint8_t *byte)
{
    const uint8_t tail = received.tail;
    if (received.head == tail) {
        return false;
    }
    *byte = received.bytes[tail];
    received.tail = (uint8_t)(tail + 1U);
    return true;
}

uint16_t uart_room(void)
{
    return (uint16_t)(RING_BYTES - 1U - (uint8_t)(sending.head - sending.tail));
}

void uart_send(const uint8_t *bytes, uint16_t n_bytes)
{
    uint8_t head = sending.head;
    for (uint16_t i = 0U; i < n_bytes; i++) {
        sending.bytes[head] = bytes[i];
        head++;
    }
    sending.head = head;
    UCSR0B |= _BV(UDRIE0); /* its interrupt takes them; one access cannot be interrupted */
}

ISR(USART0_RX_vect)
{
    const uint8_t byte = UDR0;
    const uint8_t head = received.head;
    const uint8_t next = (uint8_t)(head + 1U);
    if (next != received.tail) { /* else it is lost, and the frame's CRC says so */
        received.bytes[head] = byte;
        received.head = next;
    }
    clock_wake();
}

ISR(USART0_UDRE_vect)
{
    const uint8_t tail = sending.tail;
    if (sending.head == tail) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
        return;
    }
    UDR0 = sending.bytes[tail];
    sending.tail = (uint8_t)(tail + 1U);
}
