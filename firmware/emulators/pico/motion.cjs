// Positions of modelled encoders: at rest or turning steadily, in emulated time.
"use strict";

class Motion {
  // `modulus` counts are a turn.
  constructor(clock, modulus) {
    Object.assign(this, { clock, modulus, fault: 0, latchedAt: null });
    this.move(0.5, 0);
  }
  move(position, countsPerS, inStep = false) {
    Object.assign(this, { start: position, since: this.clock.nanos, countsPerS, inStep });
  }
  get position() {
    return this.start + ((this.clock.nanos - this.since) * this.countsPerS) / 1e9;
  }
  get count() {
    return ((Math.floor(this.position) % this.modulus) + this.modulus) % this.modulus;
  }
  // Latch now: the count.
  latch() {
    this.latchedAt ??= this.clock.nanos;
    return this.count;
  }
  // Where it turns in step with the samples: keep its phase far from a change of count.
  keepInStep() {
    if (!this.inStep) return;
    const fraction = this.position - Math.floor(this.position);
    if (fraction < 0.2) this.start += 0.3;
    if (fraction > 0.8) this.start -= 0.3;
  }
}

module.exports = { Motion };
