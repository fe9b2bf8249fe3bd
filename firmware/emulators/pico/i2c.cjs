// AS5600 sensors on I2C, each with an SDA line of its own (GPIO 2 onwards) or all behind a
// TCA9548A on the first; SCL is GPIO 9. From their data sheets.
"use strict";

const CLOCK = 9;
const SENSOR = 0x36;
const MULTIPLEXER = 0x70;
const STATUS = 0x0b;
const RAW_ANGLE = 0x0c; // high byte, then low; the pointer goes to the low one and back
const STATUS_OF_FAULT = [0x20, 0x30, 0x10, 0x00, 0x20]; // none, weak, no magnet, absent, bad check
const ABSENT = 3;

class Sensor {
  constructor(motion) {
    Object.assign(this, { motion, pointer: 0, angle: 0 });
  }
  acknowledges(address) {
    return address === SENSOR && this.motion.fault !== ABSENT;
  }
  write(byte, place) {
    if (place === 0) this.pointer = byte;
  }
  read() {
    switch (this.pointer) {
      case STATUS:
        this.pointer = RAW_ANGLE;
        return STATUS_OF_FAULT[this.motion.fault];
      case RAW_ANGLE:
        this.angle = this.motion.latch();
        this.pointer = RAW_ANGLE + 1;
        return this.angle >> 8;
      case RAW_ANGLE + 1:
        this.pointer = RAW_ANGLE;
        return this.angle & 0xff;
      default:
        return 0;
    }
  }
  stop() {}
}

// A TCA9548A, and what is behind it. Its channels change at the stop.
class Multiplexer {
  constructor(sensors) {
    Object.assign(this, { sensors, addressed: false, channels: 0, next: 0 });
  }
  get sensor() {
    return this.sensors.find((_, n) => this.channels === 1 << n);
  }
  acknowledges(address) {
    this.addressed = address === MULTIPLEXER;
    return this.addressed || (this.sensor?.acknowledges(address) ?? false);
  }
  write(byte, place) {
    if (this.addressed) this.next = byte;
    else this.sensor.write(byte, place);
  }
  read() {
    return this.addressed ? this.channels : this.sensor.read();
  }
  stop() {
    this.channels = this.next;
  }
}

// One SDA line: what its slave has seen.
class Bus {
  constructor(slave, setLine) {
    Object.assign(this, { slave, setLine, phase: "idle", masterLow: false, pulled: false, seen: true });
    setLine(true);
  }
  get sda() {
    return !this.masterLow && !this.pulled;
  }
  pull(low) {
    this.pulled = low;
    this.setLine(this.sda);
  }
  masterSets(low, scl) {
    this.masterLow = low;
    this.setLine(this.sda);
    if (this.sda === this.seen) return;
    this.seen = this.sda;
    if (!scl) return;
    if (this.seen) {
      this.phase = "idle";
      this.slave.stop();
    } else {
      // The start: the first byte begins with the next fall of SCL.
      Object.assign(this, { phase: "address", nBits: 8, acknowledged: true, n: 0 });
    }
  }
  clockRises() {
    if (this.nBits < 8 && this.phase !== "reading") this.byte = (this.byte << 1) | (this.sda ? 1 : 0);
    if (this.nBits === 8 && this.phase === "reading" && !this.first) this.acknowledged = !this.sda;
    this.seen = this.sda;
  }
  clockFalls() {
    if (this.phase === "idle") return;
    if (this.nBits === 8) {
      this.pull(false); // the acknowledge is over
      if (this.acknowledged) this.beginByte();
      else this.phase = "idle";
    } else {
      this.nBits++;
      if (this.nBits < 8) this.sendBit();
      else this.endByte();
    }
    this.seen = this.sda;
  }
  beginByte() {
    Object.assign(this, { nBits: 0, byte: 0, first: false });
    if (this.phase === "reading") this.byte = this.slave.read();
    this.sendBit();
  }
  sendBit() {
    if (this.phase === "reading") this.pull(((this.byte >> (7 - this.nBits)) & 1) === 0);
  }
  endByte() {
    if (this.phase === "reading") {
      this.pull(false); // the master acknowledges
      return;
    }
    if (this.phase === "address") {
      this.acknowledged = this.slave.acknowledges(this.byte >> 1);
      this.phase = this.byte & 1 ? "reading" : "writing";
      this.first = true; // its own acknowledge comes before the first byte
    } else {
      this.slave.write(this.byte, this.n++);
    }
    this.pull(this.acknowledged);
  }
}

function connect(slaves, pins) {
  let scl = true;
  const buses = slaves.map((slave, n) => new Bus(slave, (level) => pins.setLine(pins.firstLine + n, level)));
  buses.forEach((bus, n) => pins.watch(pins.firstLine + n, (level) => bus.masterSets(!level, scl)));
  pins.watch(CLOCK, (level) => {
    if (level === scl) return;
    scl = level;
    for (const bus of buses) level ? bus.clockRises() : bus.clockFalls();
  });
}

const as5600 = (motions, pins) => connect(motions.map((motion) => new Sensor(motion)), pins);
const multiplexer = (motions, pins) => connect([new Multiplexer(motions.map((motion) => new Sensor(motion)))], pins);

module.exports = { as5600, multiplexer };
