// The firmware of a Pico, run by rp2040js, with its line on a descriptor that it is given:
// the master of a pty, not blocking. The chip's ROM is not there: it begins at the vector table in flash, as
// after the boot stage.
//
//   node emulator.cjs --line 3 --image pico.bin --encoders quadrature|ssi --channels 7 --bits 19
//       --counts-per-turn 8192
//
// It prints `ready`, and obeys the commands of emulators/mega, as far as they are in
// `commands` below. Emulated time keeps the pace of the computer's clock, or falls behind.
"use strict";

const fs = require("fs");
const readline = require("readline");
const { Simulator } = require("rp2040js");

const NANOS_PER_CYCLE = 8; // 125 MHz
const SLICE_NANOS = 500_000;
const LONGEST_LAG_NANOS = 50_000_000;
const BYTE_NANOS = 10_000; // ten bits at 1 Mbit/s
const FLASH_VECTORS = 0x10000100;
const ROSC = 0x40060; // place among the peripherals
const RANDOMBIT = 0x1c;
const MONOFLOP_NANOS = 15_000;
const [FIRST_LINE, CLOCK, FIRST_INPUT, MARK] = [2, 9, 16, 18];
const INDEX_PINS = [19, 20, 21, 22, 26, 27, 28];

const options = { line: "3", image: "pico.bin", encoders: "quadrature", channels: "7", bits: "19", "counts-per-turn": "0" };
for (let i = 2; i < process.argv.length; i += 2) options[process.argv[i].slice(2)] = process.argv[i + 1];
const modulus = Number(options["counts-per-turn"]) || 2 ** Number(options.bits);
const nChannels = Number(options.channels);

const { clock, rp2040: chip } = new Simulator();
chip.logger = { debug() {}, info() {}, warn() {}, error: (_, text) => console.error(text) };
chip.peripherals[ROSC] = {
  // rp2040js has no ring oscillator.
  readUint32: (offset) => (offset === RANDOMBIT && Math.random() < 0.5 ? 1 : 0),
  writeUint32Atomic() {},
};

// ---- encoders ------------------------------------------------------------------------------

const encoders = Array.from({ length: 7 }, () => ({ position: 0.5, since: 0, speed: 0, inStep: false, absent: false }));
const positionOf = (encoder) => encoder.position + ((clock.nanos - encoder.since) * encoder.speed) / 1e9;
const countOf = (encoder) => ((Math.floor(positionOf(encoder)) % modulus) + modulus) % modulus;
const setLine = (pin, level) => chip.gpio[pin].setInputValue(level);

const quadrature = {
  begin() {
    this.shown = encoders.map(() => 0);
    this.alarms = encoders.map((_, n) => clock.createAlarm(() => this.step(n)));
    for (let pin = FIRST_LINE; pin < FIRST_LINE + 14; pin++) setLine(pin, false);
  },
  show(n, count) {
    this.shown[n] = count;
    const state = count % 4; // A leads B: 00, 01, 11, 10 as B A
    setLine(INDEX_PINS[n], count === 0);
    setLine(FIRST_LINE + 2 * n, state === 1 || state === 2);
    setLine(FIRST_LINE + 2 * n + 1, state >= 2);
  },
  step(n) {
    const encoder = encoders[n];
    this.show(n, countOf(encoder));
    if (encoder.speed === 0) return;
    const position = positionOf(encoder);
    const left = encoder.speed > 0 ? Math.floor(position) + 1 - position : position - (Math.ceil(position) - 1);
    this.alarms[n].schedule((left / Math.abs(encoder.speed)) * 1e9 + 1);
  },
  moved(n) {
    // A hand turns it there step by step.
    while (this.shown[n] !== countOf(encoders[n])) {
      this.show(n, (this.shown[n] + 1) % modulus);
      run(clock.nanos + 20_000);
    }
    this.step(n);
  },
};

const ssi = {
  begin() {
    this.running = false;
    this.end = clock.createAlarm(() => this.release());
    this.release();
    chip.gpio[CLOCK].addListener((state) => this.clocked(state === 1));
  },
  release() {
    this.running = false;
    encoders.forEach((_, n) => setLine(FIRST_LINE + n, true));
  },
  clocked(level) {
    this.end.schedule(MONOFLOP_NANOS);
    if (!level && !this.running) {
      this.running = true;
      this.left = Number(options.bits);
      this.words = encoders.map(countOf);
      encoders.forEach((encoder) => (encoder.latchedAt ??= clock.nanos));
    } else if (level && this.running) {
      this.left--;
      this.words.forEach((word, n) => setLine(FIRST_LINE + n, encoders[n].absent || (this.left >= 0 && ((word >> this.left) & 1) === 1)));
    }
  },
  moved() {},
};
const model = { quadrature, ssi }[options.encoders];

// ---- the line ------------------------------------------------------------------------------

let sent = []; // [when it is over, byte]
let sendingUntil = 0;
chip.uart[0].onByte = (byte) => {
  sendingUntil = Math.max(sendingUntil, clock.nanos) + BYTE_NANOS;
  sent.push([sendingUntil, byte]);
};
let received = [];
const feeding = clock.createAlarm(feed);

function feed() {
  if (received.length === 0) return;
  chip.uart[0].feedByte(received.shift());
  if (received.length > 0) feeding.schedule(BYTE_NANOS);
}

function exchange() {
  const n = sent.findIndex(([when]) => when > clock.nanos);
  const over = n < 0 ? sent : sent.slice(0, n);
  sent = n < 0 ? [] : sent.slice(n);
  try {
    if (over.length > 0) fs.writeSync(Number(options.line), Buffer.from(over.map(([, byte]) => byte)));
  } catch (error) {
    if (error.code !== "EAGAIN" && error.code !== "EIO") throw error; // nobody reads it
  }
  const buffer = Buffer.alloc(4096);
  try {
    const nRead = fs.readSync(Number(options.line), buffer);
    const idle = received.length === 0;
    received.push(...buffer.subarray(0, nRead));
    if (idle) feed();
  } catch (error) {
    if (error.code !== "EAGAIN" && error.code !== "EIO") throw error;
  }
}

// ---- time ------------------------------------------------------------------------------------

function run(until) {
  const { core } = chip;
  while (clock.nanos < until) {
    if (core.waiting) {
      const next = clock.nextAlarm ? clock.nanosToNextAlarm : until - clock.nanos;
      clock.tick(Math.min(Math.max(next, 0), until - clock.nanos) || 1);
    } else {
      clock.tick(core.executeInstruction() * NANOS_PER_CYCLE);
    }
  }
}

let origin = 0n;
let originNanos = 0;
let lagNanos = 0;
function beginPace() {
  origin = process.hrtime.bigint();
  originNanos = clock.nanos;
}

function live() {
  let target = originNanos + Number(process.hrtime.bigint() - origin);
  if (target - clock.nanos > LONGEST_LAG_NANOS) {
    lagNanos += target - clock.nanos;
    beginPace();
    target = clock.nanos + SLICE_NANOS;
  }
  while (clock.nanos < target) {
    run(Math.min(target, clock.nanos + SLICE_NANOS));
    exchange();
  }
  exchange();
  setTimeout(live, 1);
}

// ---- commands ----------------------------------------------------------------------------------

let changedAt = 0;
let markedAt = null;
let countsThen = [];

function input(number, level, changes = 1) {
  changedAt = clock.nanos;
  markedAt = null;
  encoders.forEach((encoder) => delete encoder.latchedAt);
  countsThen = encoders.map(countOf);
  let now = level;
  setLine(FIRST_INPUT + number, !now); // a contact to ground
  for (let i = 1; i < changes || now !== level; i++) {
    run(clock.nanos + 44_000 * i);
    now = !now;
    setLine(FIRST_INPUT + number, !now);
  }
  run(clock.nanos + SLICE_NANOS);
}

function move(n, position, speed, inStep = false) {
  Object.assign(encoders[n], { position, since: clock.nanos, speed, inStep });
  model.moved(n);
}

const commands = {
  count: (n, count) => move(n, count + 0.5, 0),
  turn: (n, speed) => move(n, positionOf(encoders[n]), speed),
  step: (n, speed) => move(n, positionOf(encoders[n]), speed, true),
  fail: (n, fault) => (encoders[n].absent = fault === 3),
  input: (n, level) => input(n, level !== 0),
  bounce: (n, level, changes) => input(n, level !== 0, changes),
  latency: () =>
    `mark ${Math.round((markedAt - changedAt) / NANOS_PER_CYCLE)} counts ${countsThen.join(" ")} channels ` +
    encoders.filter((e) => e.latchedAt).map((e) => Math.round((e.latchedAt - changedAt) / NANOS_PER_CYCLE)).join(" "),
  show: () => `lag_ms ${Math.round(lagNanos / 1e6)}`,
  quit: () => process.exit(0),
};

chip.flash.set(fs.readFileSync(options.image));
chip.core.SP = chip.readUint32(FLASH_VECTORS);
chip.core.PC = chip.readUint32(FLASH_VECTORS + 4) & ~1;
chip.core.VTOR = FLASH_VECTORS;
encoders.length = nChannels;
for (const pin of [FIRST_INPUT, FIRST_INPUT + 1]) setLine(pin, true);
model.begin();
chip.gpio[MARK].addListener((state) => {
  if (state !== 1) return;
  markedAt ??= clock.nanos;
  for (const encoder of encoders.filter((e) => e.inStep)) {
    const fraction = positionOf(encoder) - Math.floor(positionOf(encoder));
    if (fraction < 0.2) encoder.position += 0.3;
    if (fraction > 0.8) encoder.position -= 0.3;
  }
});
run(50_000_000);
console.log("ready");
beginPace();
live();
readline.createInterface({ input: process.stdin }).on("line", (text) => {
  const [command, ...numbers] = text.split(" ");
  if (command in commands) {
    const answer = commands[command](...numbers.map(Number));
    console.log(typeof answer === "string" ? answer : "done");
  } else {
    console.log(`error: '${text}' is no command; expected ${Object.keys(commands).join(", ")}`);
  }
}).on("close", () => process.exit(0));
