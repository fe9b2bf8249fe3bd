/* UART 1: GPIO 4 (TX), GPIO 5 (RX); the driver is enabled by GPIO 10. */
#include "bus.h"

#include "pins.h"
#include "settings.h"

#if FRONT_END == AMT21

#define CLOCK_PERI_HZ 125000000U
/* In 64ths of a sixteenth of the clock. */
#define DIVIDER (((8U * CLOCK_PERI_HZ / BUS_BAUD_RATE) + 1U) / 2U)
#define BUS 1U

void bus_init(void)
{
    pins_init_bus();
    UART_IBRD(BUS) = DIVIDER / 64U;
    UART_FBRD(BUS) = DIVIDER % 64U;
    UART_LCR_H(BUS) = (3U << 5) | (1U << 4); /* 8 bits, FIFOs on; also takes over the divider */
    UART_CR(BUS) = (1U << 9) | (1U << 8) | 1U; /* both ways, on */
}

void bus_send(uint8_t byte)
{
    while ((UART_FR(BUS) & UART_FR_RXFE) == 0U) {
        (void)UART_DR(BUS);
    }
    /* An encoder answers some 3 us later: the driver has to be off by then. */
    const pins_state state = pins_lock();
    pins_select(true);
    UART_DR(BUS) = byte;
    while ((UART_FR(BUS) & UART_FR_BUSY) != 0U) {
    }
    pins_select(false);
    pins_unlock(state);
}

bool bus_take(uint8_t *byte)
{
    if ((UART_FR(BUS) & UART_FR_RXFE) != 0U) {
        return false;
    }
    *byte = (uint8_t)UART_DR(BUS);
    return true;
}

#endif
