// The firmware of a Pico, run by rp2040js, with its line on a descriptor that it is given:
// the master of a pty, not blocking. The chip's ROM is not there: it begins at the vector table in flash, as
// after the boot stage.
//
//   node emulator.cjs --line 3 --image pico.bin --encoders KIND --channels 7 --bits 19
//       --counts-per-turn 8192
//
// Kinds of encoders are quadrature, ssi, biss, as5047, amt22, amt21, as5600, as5600-multiplexer.
// It prints `ready`, and obeys the commands of emulators/mega, as far as they are in
// `commands` below. Emulated time keeps the pace of the computer's clock, or falls behind.
"use strict";

const fs = require("fs");
const readline = require("readline");
const { GPIOPinState, Simulator } = require("rp2040js");
const { Motion } = require("./motion.cjs");
const { quadrature } = require("./quadrature.cjs");
const { ssi, biss, as5047, amt22 } = require("./shift.cjs");
const { amt21 } = require("./bus.cjs");
const { as5600, multiplexer } = require("./i2c.cjs");
const { thermometers } = require("./thermometers.cjs");

const NANOS_PER_CYCLE = 8; // 125 MHz
const SLICE_NANOS = 500_000;
const LONGEST_LAG_NANOS = 50_000_000;
const BYTE_NANOS = 10_000; // ten bits at 1 Mbit/s
const FLASH_VECTORS = 0x10000100;
const ROSC = 0x40060; // place among the peripherals
const RANDOMBIT = 0x1c;
const [FIRST_LINE, FIRST_INPUT, MARK] = [2, 16, 18];

const options = { line: "3", image: "pico.bin", encoders: "quadrature", channels: "7", bits: "19", "counts-per-turn": "0" };
for (let i = 2; i < process.argv.length; i += 2) options[process.argv[i].slice(2)] = process.argv[i + 1];
const modulus = Number(options["counts-per-turn"]) || 2 ** Number(options.bits);

const { clock, rp2040: chip } = new Simulator();
chip.logger = { debug() {}, info() {}, warn() {}, error: (_, text) => console.error(text) };
chip.peripherals[ROSC] = {
  // rp2040js has no ring oscillator.
  readUint32: (offset) => (offset === RANDOMBIT && Math.random() < 0.5 ? 1 : 0),
  writeUint32Atomic() {},
};

// ---- encoders ------------------------------------------------------------------------------

const motions = Array.from({ length: Number(options.channels) }, () => new Motion(clock, modulus));
const pins = {
  firstLine: FIRST_LINE,
  setLine: (pin, level) => chip.gpio[pin].setInputValue(level),
  // Have `changed` called with the level of a pin: low, or high as well as released.
  watch: (pin, changed) => chip.gpio[pin].addListener((state) => changed(state !== GPIOPinState.Low)),
  run,
};
const kinds = { quadrature, ssi, biss, as5047, amt22, amt21, as5600, "as5600-multiplexer": multiplexer };

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
  for (const motion of motions) motion.latchedAt = null;
  countsThen = motions.map((motion) => motion.count);
  let now = level;
  pins.setLine(FIRST_INPUT + number, !now); // a contact to ground
  for (let i = 1; i < changes || now !== level; i++) {
    run(clock.nanos + 44_000 * i);
    now = !now;
    pins.setLine(FIRST_INPUT + number, !now);
  }
  run(clock.nanos + SLICE_NANOS);
}

function move(n, position, countsPerS, inStep = false) {
  motions[n].move(position, countsPerS, inStep);
  moved?.(n);
}

const commands = {
  count: (n, count) => move(n, count + 0.5, 0),
  turn: (n, speed) => move(n, motions[n].position, speed),
  step: (n, speed) => move(n, motions[n].position, speed, true),
  fail: (n, fault) => (motions[n].fault = fault),
  temperature: (n, hundredthsC) => (wires[n].hundredthsC = hundredthsC),
  input: (n, level) => input(n, level !== 0),
  bounce: (n, level, changes) => input(n, level !== 0, changes),
  latency: () =>
    `contact ${Math.round(changedAt / NANOS_PER_CYCLE)} ` +
    `mark ${Math.round((markedAt - changedAt) / NANOS_PER_CYCLE)} counts ${countsThen.join(" ")} channels ` +
    motions.filter((motion) => motion.latchedAt).map((motion) => Math.round((motion.latchedAt - changedAt) / NANOS_PER_CYCLE)).join(" "),
  show: () => `lag_ms ${Math.round(lagNanos / 1e6)}`,
  quit: () => process.exit(0),
};

chip.flash.set(fs.readFileSync(options.image));
chip.core.SP = chip.readUint32(FLASH_VECTORS);
chip.core.PC = chip.readUint32(FLASH_VECTORS + 4) & ~1;
chip.core.VTOR = FLASH_VECTORS;
for (const pin of [FIRST_INPUT, FIRST_INPUT + 1]) pins.setLine(pin, true);
const moved = kinds[options.encoders](motions, pins, clock, chip.uart[1]);
// Their pins are index lines, too.
const wires = options.encoders === "quadrature" ? [] : thermometers(pins, clock);
chip.gpio[MARK].addListener((state) => {
  if (state !== 1) return;
  markedAt ??= clock.nanos;
  for (const motion of motions) motion.keepInStep();
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
