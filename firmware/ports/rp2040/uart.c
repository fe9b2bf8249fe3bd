/* UART 0, at GPIO 0 and 1. */
#include "uart.h"

#include "pins.h"
#include "start.h"

#define CLOCK_PERI_HZ 125000000U
/* In 64ths of a sixteenth of the clock. */
#define DIVIDER (((8U * CLOCK_PERI_HZ / BAUD_RATE) + 1U) / 2U)
#define RING_BYTES 1024U

struct ring {
    volatile uint32_t head; /* both count on; places wrap */
    volatile uint32_t tail;
    uint8_t bytes[RING_BYTES];
};

static struct ring received;
static struct ring sending;

void uart_init(void)
{
    PADS(1U) = PADS_INPUT_PULLED_UP;
    IO_CTRL(0U) = FUNCTION_UART;
    IO_CTRL(1U) = FUNCTION_UART;
    UART_IBRD(0U) = DIVIDER / 64U;
    UART_FBRD(0U) = DIVIDER % 64U;
    UART_LCR_H(0U) = (3U << 5) | (1U << 4); /* 8 bits, FIFOs on; also takes over the divider */
    UART_CR(0U) = (1U << 9) | (1U << 8) | 1U; /* both ways, on */
    REGISTER(UART_IMSC) = UART_INT_RX | UART_INT_RX_TIMEOUT;
}

bool uart_take(uint8_t *byte)
{
    const uint32_t tail = received.tail;
    if (received.head == tail) {
        return false;
    }
    *byte = received.bytes[tail % RING_BYTES];
    received.tail = tail + 1U;
    return true;
}

uint16_t uart_room(void)
{
    return (uint16_t)(RING_BYTES - (sending.head - sending.tail));
}

/* Fill the FIFO; its interrupt comes when it is half empty, and not before it was filled. */
static void fill(void)
{
    while (sending.tail != sending.head && (UART_FR(0U) & UART_FR_TXFF) == 0U) {
        UART_DR(0U) = sending.bytes[sending.tail % RING_BYTES];
        sending.tail++;
    }
    if (sending.tail == sending.head) {
        CLEAR(UART_IMSC) = UART_INT_TX;
    } else {
        SET(UART_IMSC) = UART_INT_TX;
    }
}

void uart_send(const uint8_t *bytes, uint16_t n_bytes)
{
    for (uint16_t i = 0U; i < n_bytes; i++) {
        sending.bytes[sending.head % RING_BYTES] = bytes[i];
        sending.head++;
    }
    const pins_state state = pins_lock();
    fill();
    pins_unlock(state);
}

void uart_due(void)
{
    while ((UART_FR(0U) & UART_FR_RXFE) == 0U) {
        const uint8_t byte = (uint8_t)UART_DR(0U);
        if (received.head - received.tail < RING_BYTES) { /* else the frame's CRC says so */
            received.bytes[received.head % RING_BYTES] = byte;
            received.head++;
        }
    }
    UART_ICR(0U) = UART_INT_RX | UART_INT_RX_TIMEOUT | UART_INT_TX;
    fill();
}
