// AMT21 encoders on an RS-485 bus at UART 1, addresses 0x54, 0x58 and so on; GPIO 10 enables
// the processor's driver. From their data sheet.
"use strict";

const SELECT = 10;
const FIRST_ADDRESS = 0x54;
const BYTE_NANOS = 5_000; // ten bits at 2 Mbit/s
const TURN_AROUND_NANOS = 3_000; // until an encoder answers
const BUSY = 1 << 3; // of the flags of a UART, which rp2040js leaves out
const [ABSENT, BAD_CHECK] = [3, 4];

const oddParity = (bits) => {
  let parity = 1;
  for (; bits !== 0; bits >>= 1) parity ^= bits & 1;
  return parity;
};

function amt21(motions, pins, clock, uart) {
  let driven = false;
  let sendingUntil = 0;
  let answer = [];
  pins.watch(SELECT, (level) => (driven = level));
  const flags = Object.getOwnPropertyDescriptor(Object.getPrototypeOf(uart), "flags").get;
  Object.defineProperty(uart, "flags", {
    get: () => flags.call(uart) | (clock.nanos < sendingUntil ? BUSY : 0),
  });
  // Where the processor drives the bus, nobody hears an answer.
  const arriving = clock.createAlarm(() => {
    if (!driven) uart.feedByte(answer[0]);
    answer.shift();
    if (answer.length > 0) arriving.schedule(BYTE_NANOS);
  });
  let motion = null;
  const asked = clock.createAlarm(() => {
    if (!driven || motion.fault === ABSENT) return; // or the driver was switched off within the byte
    let word = motion.latch();
    word |= (oddParity(word & 0x2aaa) << 15) | (oddParity(word & 0x1555) << 14);
    if (motion.fault === BAD_CHECK) word ^= 4;
    answer = [word & 0xff, word >> 8];
    arriving.schedule(TURN_AROUND_NANOS + BYTE_NANOS);
  });
  uart.onByte = (byte) => {
    sendingUntil = clock.nanos + BYTE_NANOS;
    motion = (byte - FIRST_ADDRESS) % 4 === 0 ? motions[(byte - FIRST_ADDRESS) / 4] : undefined;
    if (driven && motion) asked.schedule(BYTE_NANOS - 8);
  };
}

module.exports = { amt21 };
