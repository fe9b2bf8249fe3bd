/* Second boot stage: 256 bytes at the begin of the flash, which the chip's ROM checks by
 * the CRC that image.py adds, copies to RAM and calls. It lets the flash be read as memory
 * by the command 03, which every flash chip has; the program itself runs from RAM. */
    .syntax unified
    .cpu cortex-m0plus
    .thumb

    .equ SSI_BASE, 0x18000000     /* the controller of the flash */
    .equ SSI_CTRLR0, 0x00
    .equ SSI_CTRLR1, 0x04
    .equ SSI_ENABLE, 0x08
    .equ SSI_BAUD, 0x14
    .equ SSI_SPI_CTRLR0, 0xF4
    .equ CTRLR0_VALUE, (31 << 16) | (3 << 8)            /* 32 bits a frame; read after a command */
    .equ SPI_CTRLR0_VALUE, (0x03 << 24) | (2 << 8) | (6 << 2) /* 8 bits command, 24 address */
    .equ VECTORS, 0x10000100
    .equ VTOR, 0xE000ED08

    .section .boot2, "ax"
    .thumb_func
    .global boot2
boot2:
    ldr r3, =SSI_BASE
    movs r1, #0
    str r1, [r3, #SSI_ENABLE]     /* it can be set up only while disabled */
    movs r1, #4
    str r1, [r3, #SSI_BAUD]       /* the system's clock by 4 */
    ldr r1, =CTRLR0_VALUE
    str r1, [r3, #SSI_CTRLR0]
    movs r1, #0
    str r1, [r3, #SSI_CTRLR1]     /* one frame a read */
    ldr r1, =SPI_CTRLR0_VALUE
    ldr r2, =(SSI_BASE + SSI_SPI_CTRLR0)
    str r1, [r2]
    movs r1, #1
    str r1, [r3, #SSI_ENABLE]
    ldr r0, =VECTORS              /* the table in flash: stack and entry */
    ldr r1, =VTOR
    str r0, [r1]
    ldmia r0!, {r1, r2}
    msr msp, r1
    bx r2
    .pool
