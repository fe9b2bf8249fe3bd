/* Registers of the RP2040 that this port uses, by the names of its data sheet. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
/* Aliases of each peripheral's registers: a write sets, or clears, the bits given. */
#define SET(address) REGISTER((address) + 0x2000U)
#define CLEAR(address) REGISTER((address) + 0x3000U)

/* Resets, 2.14: a bit for each peripheral. */
#define RESETS_RESET 0x4000C000U
#define RESETS_DONE REGISTER(0x4000C008U)
#define RESET_ADC (1U << 0)
#define RESET_IO_BANK0 (1U << 5)
#define RESET_PADS_BANK0 (1U << 8)
#define RESET_PLL_SYS (1U << 12)
#define RESET_TIMER (1U << 21)
#define RESET_UART0 (1U << 22)
#define RESET_UART1 (1U << 23)

/* Clocks, 2.15; crystal, 2.16; PLL, 2.18; random bit of the ring oscillator, 2.17. */
#define CLK_REF_CTRL REGISTER(0x40008030U)
#define CLK_REF_SELECTED REGISTER(0x40008038U)
#define CLK_SYS_CTRL REGISTER(0x4000803CU)
#define CLK_SYS_SELECTED REGISTER(0x40008044U)
#define CLK_PERI_CTRL REGISTER(0x40008048U)
#define CLK_ADC_CTRL REGISTER(0x40008060U)
#define XOSC_CTRL REGISTER(0x40024000U)
#define XOSC_STATUS REGISTER(0x40024004U)
#define XOSC_STARTUP REGISTER(0x4002400CU)
#define PLL_SYS_CS REGISTER(0x40028000U)
#define PLL_SYS_PWR 0x40028004U
#define PLL_SYS_FBDIV REGISTER(0x40028008U)
#define PLL_SYS_PRIM REGISTER(0x4002800CU)
#define ROSC_RANDOMBIT REGISTER(0x4006001CU)
#define WATCHDOG_TICK REGISTER(0x4005802CU)

/* Timer of microseconds, 4.6. */
#define TIMER_ALARM0 REGISTER(0x40054010U)
#define TIMER_ALARM1 REGISTER(0x40054014U)
#define TIMER_ARMED REGISTER(0x40054020U)
#define TIMER_RAWL REGISTER(0x40054028U)
#define TIMER_INTR REGISTER(0x40054034U)
#define TIMER_INTE REGISTER(0x40054038U)

/* Pins, 2.19: four interrupt bits each, eight pins a register. */
#define IO_CTRL(pin) REGISTER(0x40014004U + (8U * (pin)))
#define IO_INTR(group) REGISTER(0x400140F0U + (4U * (group)))
#define IO_PROC0_INTE(group) REGISTER(0x40014100U + (4U * (group)))
#define IO_EDGES 0xCU /* falling and rising */
#define PADS(pin) REGISTER(0x4001C004U + (4U * (pin)))
#define PADS_INPUT_PULLED_UP 0x4AU /* input enabled, pull-up, Schmitt trigger */
#define FUNCTION_UART 2U
#define FUNCTION_SIO 5U

/* Single-cycle access to pins, 2.3.1. */
#define GPIO_IN REGISTER(0xD0000004U)
#define GPIO_OUT_SET REGISTER(0xD0000014U)
#define GPIO_OUT_CLR REGISTER(0xD0000018U)
#define GPIO_OE REGISTER(0xD0000020U)
#define GPIO_OE_SET REGISTER(0xD0000024U)
#define GPIO_OE_CLR REGISTER(0xD0000028U)

/* UARTs 0 and 1, 4.2. */
#define UART_DR(n) REGISTER(0x40034000U + (0x4000U * (n)))
#define UART_FR(n) REGISTER(0x40034018U + (0x4000U * (n)))
#define UART_IBRD(n) REGISTER(0x40034024U + (0x4000U * (n)))
#define UART_FBRD(n) REGISTER(0x40034028U + (0x4000U * (n)))
#define UART_LCR_H(n) REGISTER(0x4003402CU + (0x4000U * (n)))
#define UART_CR(n) REGISTER(0x40034030U + (0x4000U * (n)))
#define UART_IMSC 0x40034038U /* of UART 0 */
#define UART_ICR(n) REGISTER(0x40034044U + (0x4000U * (n)))
#define UART_FR_BUSY (1U << 3)
#define UART_FR_RXFE (1U << 4)
#define UART_FR_TXFF (1U << 5)
#define UART_INT_RX (1U << 4)
#define UART_INT_TX (1U << 5)
#define UART_INT_RX_TIMEOUT (1U << 6)

/* ADC, 4.9. */
#define ADC_CS REGISTER(0x4004C000U)
#define ADC_RESULT REGISTER(0x4004C004U)

/* Interrupt controller of the Cortex-M0+: a bit for each interrupt. */
#define VTOR REGISTER(0xE000ED08U)
#define NVIC_ENABLE REGISTER(0xE000E100U)
#define NVIC_DISABLE REGISTER(0xE000E180U)
#define NVIC_SET_PENDING REGISTER(0xE000E200U)
#define NVIC_PRIORITY(n) REGISTER(0xE000E400U + (4U * (n)))
#define IRQ_TIMER_0 0U
#define IRQ_TIMER_1 1U
#define IRQ_IO_BANK0 13U
#define IRQ_UART0 20U
#define IRQ_CHANGES 26U /* belongs to no peripheral: pended by software */

#endif
