// DS18B20 thermometers on GPIO 26 onwards, from their data sheet.
"use strict";

const FIRST_WIRE = 26;
const WIRES = 3;
const US = 1000;
const CONVERSION_NANOS = 750e6;
const POWER_UP_RAW = 0x0550;
const ABSENT = -32768;

// x^8 + x^5 + x^4 + 1, the lowest bit first.
function checkOf(bytes) {
  let rest = 0;
  for (const byte of bytes) {
    for (let place = 0; place < 8; place++) {
      const differs = ((byte >> place) ^ rest) & 1;
      rest = (rest >> 1) ^ (differs ? 0x8c : 0);
    }
  }
  return rest;
}

class Thermometer {
  constructor(clock, setLine) {
    Object.assign(this, { clock, setLine, phase: "silent", bits: [], masterLow: false, pulled: false, fellAt: 0 });
    Object.assign(this, { hundredthsC: 2000, raw: POWER_UP_RAW, convertedAt: 0 });
    this.released = clock.createAlarm(() => this.pull(false));
    this.answering = clock.createAlarm(() => {
      this.pull(true);
      this.released.schedule(120 * US);
    });
    setLine(true);
  }
  pull(low) {
    this.pulled = low;
    this.setLine(!this.masterLow && !low);
  }
  masterSets(low) {
    if (low === this.masterLow) return;
    this.masterLow = low;
    if (this.hundredthsC !== ABSENT) low ? this.fell() : this.rose(this.clock.nanos - this.fellAt);
    this.setLine(!low && !this.pulled);
  }
  fell() {
    this.fellAt = this.clock.nanos;
    if (this.phase === "sending" && this.bits.length > 0 && this.bits.shift() === 0) {
      this.pulled = true;
      this.released.schedule(30 * US);
    }
  }
  rose(lowNanos) {
    if (lowNanos >= 480 * US) {
      Object.assign(this, { phase: "addressed", bits: [] });
      this.answering.schedule(30 * US);
    } else if (this.phase === "addressed" || this.phase === "commanded") {
      this.bits.push(lowNanos < 15 * US ? 1 : 0);
      if (this.bits.length === 8) this.obey(this.bits.reduce((byte, bit, place) => byte | (bit << place), 0));
    }
  }
  obey(command) {
    this.bits = [];
    if (this.phase === "addressed") {
      this.phase = command === 0xcc ? "commanded" : "silent";
    } else if (command === 0xbe) {
      this.phase = "sending";
      this.bits = this.scratchpad().flatMap((byte) => Array.from({ length: 8 }, (_, place) => (byte >> place) & 1));
    } else {
      this.phase = "silent";
      if (command !== 0x44) return;
      this.raw = Math.round(this.hundredthsC * 0.16);
      this.convertedAt = this.clock.nanos + CONVERSION_NANOS;
    }
  }
  scratchpad() {
    const raw = this.clock.nanos >= this.convertedAt ? this.raw : POWER_UP_RAW;
    const bytes = [raw & 0xff, (raw >> 8) & 0xff, 0x4b, 0x46, 0x7f, 0xff, 0x0c, 0x10];
    return [...bytes, checkOf(bytes)];
  }
}

function thermometers(pins, clock) {
  return Array.from({ length: WIRES }, (_, n) => {
    const thermometer = new Thermometer(clock, (level) => pins.setLine(FIRST_WIRE + n, level));
    pins.watch(FIRST_WIRE + n, (level) => thermometer.masterSets(!level));
    return thermometer;
  });
}

module.exports = { thermometers };
