// Encoders that shift out a word on GPIO 2 onwards, with a common clock (GPIO 9) and chip
// select (GPIO 10): SSI, BiSS-C, AS5047, AMT22, from their data sheets.
"use strict";

const CLOCK = 9;
const SELECT = 10;
const MONOFLOP_NANOS = 15_000; // SSI, BiSS-C: so long without a clock ends the word
const BISS_ACKNOWLEDGE = [0, 0, 0];
const [WEAK, NO_MAGNET, ABSENT, BAD_CHECK] = [1, 2, 3, 4];

const bitsOf = (value, n) => Array.from({ length: n }, (_, place) => (value >> (n - 1 - place)) & 1);
const parityOf = (bits) => bits.reduce((sum, bit) => sum ^ bit, 0);

// The remainder of bits and six zeros, divided by x^6 + x + 1.
function bissCheck(bits) {
  let rest = 0;
  for (const bit of [...bits, 0, 0, 0, 0, 0, 0]) {
    rest = (rest << 1) | bit;
    if (rest & 0x40) rest ^= 0x43;
  }
  return rest;
}

class ShiftLines {
  constructor(motions, pins) {
    Object.assign(this, { motions, pins, words: motions.map(() => []) });
    motions.forEach((_, n) => this.set(n, 1));
  }
  // An absent encoder leaves its line to the pull-up.
  set(n, bit) {
    this.pins.setLine(this.pins.firstLine + n, bit === 1 || this.motions[n].fault === ABSENT);
  }
  load(wordOf) {
    this.words = this.motions.map(wordOf);
  }
  // Put each encoder's next bit on its line; after the last one, `rest`.
  shift(rest) {
    this.words.forEach((word, n) => this.set(n, word.length > 0 ? word.shift() : rest));
  }
  release() {
    this.motions.forEach((_, n) => this.set(n, 1));
  }
}

// The clock rests high: its first fall latches, each rise brings a bit.
function restingHigh(wordOf, rest) {
  return (motions, pins, clock) => {
    const lines = new ShiftLines(motions, pins);
    let running = false;
    const end = clock.createAlarm(() => {
      running = false;
      lines.release();
    });
    pins.watch(CLOCK, (level) => {
      end.schedule(MONOFLOP_NANOS);
      if (!level && !running) {
        running = true;
        lines.load(wordOf);
      } else if (level && running) {
        lines.shift(rest);
      }
    });
  };
}

const bitsPerTurn = (motion) => Math.round(Math.log2(motion.modulus));

// SSI holds the line low until the pause has ended.
const ssi = restingHigh((motion) => bitsOf(motion.latch(), bitsPerTurn(motion)), 0);

const biss = restingHigh((motion) => {
  const data = bitsOf(motion.latch(), bitsPerTurn(motion));
  data.push(motion.fault === NO_MAGNET ? 0 : 1, motion.fault === WEAK ? 0 : 1); // error, warning: low is raised
  const check = bitsOf(~bissCheck(data) & 0x3f, 6);
  if (motion.fault === BAD_CHECK) check[5] ^= 1;
  return [...BISS_ACKNOWLEDGE, 1, 0, ...data, ...check];
}, 1);

function as5047(motions, pins) {
  const lines = new ShiftLines(motions, pins);
  let answers = motions.map(() => bitsOf(0, 16));
  pins.watch(SELECT, (level) => {
    if (!level) {
      lines.load((_, n) => [...answers[n]]);
      return;
    }
    // The command has come: the angle is read, for the next frame.
    answers = motions.map((motion) => {
      const word = [motion.fault === NO_MAGNET ? 1 : 0, ...bitsOf(motion.latch(), 14)];
      const answer = [parityOf(word), ...word];
      if (motion.fault === BAD_CHECK) answer[15] ^= 1;
      return answer;
    });
  });
  pins.watch(CLOCK, (level) => level && lines.shift(1)); // mode 1
}

function amt22(motions, pins) {
  const lines = new ShiftLines(motions, pins);
  pins.watch(SELECT, () => {
    lines.load((motion) => {
      const word = bitsOf(motion.latch(), 14);
      const odd = 1 ^ parityOf(word.filter((_, place) => place % 2 === 0)); // bits 13, 11 .. 1
      const even = 1 ^ parityOf(word.filter((_, place) => place % 2 === 1));
      if (motion.fault === BAD_CHECK) word[11] ^= 1;
      return [odd, even, ...word];
    });
    lines.shift(1); // the first bit is there before the clock
  });
  pins.watch(CLOCK, (level) => level || lines.shift(1)); // mode 0
}

module.exports = { ssi, biss, as5047, amt22 };
