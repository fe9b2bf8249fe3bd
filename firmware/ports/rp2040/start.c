/* From reset to main: the program to RAM, zeros, clocks, the vector table. */
#include <stdint.h>

#include "registers.h"
#include "start.h"

#define N_VECTORS 48U /* stack, entry, 14 exceptions, 32 interrupts */
#define FLASH_VECTORS 0x10000100U

extern uint32_t program_begin[];
extern uint32_t program_end[];
extern const uint32_t program_in_flash[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];
extern uint32_t stack_top[];

/* An exception that nobody expects: the program stops, a debugger finds it here. */
static void halt(void)
{
    for (;;) {
        __asm__ volatile("wfi");
    }
}

/* The table in RAM, which interrupts need not wait for; aligned as VTOR asks for. */
static uint32_t vectors_in_ram[N_VECTORS] __attribute__((aligned(256)));

__attribute__((section(".start"))) void start(void)
{
    const uint32_t *from = program_in_flash;
    /* cppcheck-suppress comparePointers -- marks of one region, by the linker */
    for (uint32_t *to = program_begin; to < program_end; to++) {
        *to = *from;
        from++;
    }
    /* cppcheck-suppress comparePointers */
    for (uint32_t *to = bss_begin; to < bss_end; to++) {
        *to = 0U;
    }
    const uint32_t *vectors_in_flash = (const uint32_t *)FLASH_VECTORS;
    for (uint32_t i = 0U; i < N_VECTORS; i++) {
        vectors_in_ram[i] = vectors_in_flash[i];
    }
    VTOR = (uint32_t)vectors_in_ram;
    main_program();
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    /* cppcheck-suppress unusedStructMember -- read by the processor */
    const uint32_t *stack;
    /* cppcheck-suppress unusedStructMember */
    handler handlers[N_VECTORS - 1U];
} vectors = {
    .stack = stack_top,
    .handlers = {
        [0] = start,
        [1 ... 14] = halt,
        [15 + IRQ_TIMER_0] = timer_due,
        [15 + IRQ_TIMER_1] = timer_wakes,
        [15 + IRQ_IO_BANK0] = pins_changed,
        [15 + IRQ_UART0] = uart_due,
        [15 + IRQ_CHANGES] = changes_due,
    },
};

/* 12 MHz of the crystal by 125 in the PLL, by 6 and 2: 125 MHz. */
void start_clocks(void)
{
    XOSC_STARTUP = 47U; /* 1 ms in units of 256 periods */
    XOSC_CTRL = 0xFABAA0U; /* enable; 1 to 15 MHz */
    while ((XOSC_STATUS & 0x80000000U) == 0U) {
    }
    CLK_REF_CTRL = 2U; /* the crystal */
    while ((CLK_REF_SELECTED & 4U) == 0U) {
    }
    CLEAR(RESETS_RESET) = RESET_PLL_SYS;
    while ((RESETS_DONE & RESET_PLL_SYS) == 0U) {
    }
    PLL_SYS_CS = 1U; /* the crystal is not divided */
    PLL_SYS_FBDIV = 125U;
    CLEAR(PLL_SYS_PWR) = (1U << 0) | (1U << 5); /* power to the PLL and its oscillator */
    while ((PLL_SYS_CS & 0x80000000U) == 0U) {
    }
    PLL_SYS_PRIM = (6U << 16) | (2U << 12);
    CLEAR(PLL_SYS_PWR) = 1U << 3; /* and to its dividers */
    CLK_SYS_CTRL = 0U; /* from the reference, while its other source is chosen: the PLL */
    CLK_SYS_CTRL = 1U;
    while ((CLK_SYS_SELECTED & 2U) == 0U) {
    }
    CLK_PERI_CTRL = 1U << 11; /* enabled, from the system's clock */
    CLK_ADC_CTRL = (1U << 11) | (3U << 5); /* from the crystal */
    WATCHDOG_TICK = (1U << 9) | 12U; /* 1 MHz for the timer */

    const uint32_t used = RESET_ADC | RESET_IO_BANK0 | RESET_PADS_BANK0 | RESET_TIMER | RESET_UART0 | RESET_UART1;
    CLEAR(RESETS_RESET) = used;
    while ((RESETS_DONE & used) != used) {
    }
}

/* The compiler copies and clears structures by these. */
void *memcpy(void *to, const void *from, unsigned n_bytes)
{
    uint8_t *target = to;
    const uint8_t *source = from;
    for (unsigned i = 0U; i < n_bytes; i++) {
        target[i] = source[i];
    }
    return to;
}

void *memset(void *to, int value, unsigned n_bytes)
{
    uint8_t *target = to;
    for (unsigned i = 0U; i < n_bytes; i++) {
        target[i] = (uint8_t)value;
    }
    return to;
}
