// Incremental encoders: A and B from GPIO 2 onwards, in pairs, and an index each.
"use strict";

const INDEX_PINS = [19, 20, 21, 22, 26, 27, 28];
const STEP_NANOS = 20_000;

// `pins`: setLine and run of the emulator.
function quadrature(motions, pins, clock) {
  const shown = motions.map(() => 0);
  const alarms = motions.map((_, n) => clock.createAlarm(() => step(n)));

  function show(n, count) {
    shown[n] = count;
    const state = count % 4; // A leads B: 00, 01, 11, 10 as B A
    pins.setLine(INDEX_PINS[n], count === 0);
    pins.setLine(pins.firstLine + 2 * n, state === 1 || state === 2);
    pins.setLine(pins.firstLine + 2 * n + 1, state >= 2);
  }

  function step(n) {
    const { count, position, countsPerS } = motions[n];
    show(n, count);
    if (countsPerS === 0) return;
    const left = countsPerS > 0 ? Math.floor(position) + 1 - position : position - Math.floor(position);
    alarms[n].schedule((left / Math.abs(countsPerS)) * 1e9 + 1);
  }

  for (let pin = pins.firstLine; pin < pins.firstLine + 2 * motions.length; pin++) pins.setLine(pin, false);
  return function moved(n) {
    // A hand turns it there step by step.
    while (shown[n] !== motions[n].count) {
      show(n, (shown[n] + 1) % motions[n].modulus);
      pins.run(clock.nanos + STEP_NANOS);
    }
    step(n);
  };
}

module.exports = { quadrature };
