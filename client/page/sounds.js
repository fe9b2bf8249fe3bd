// Short tones, told apart without looking: a good point, one in doubt, a refusal, an
// alarm, an alarm gone.
window.traverse_sounds = {
  context: null, muted: false, speaks: false, played: [],
  begin() { this.context ??= new AudioContext(); }, // browsers want a touch of the page before
  tones: {
    point: [[880, 0, 0.09]],
    doubt: [[880, 0, 0.09], [587, 0.1, 0.16]],
    retraction: [[660, 0, 0.08], [440, 0.09, 0.1]],
    refused: [[196, 0, 0.16], [196, 0.22, 0.16]],
    alarm: [[740, 0, 0.18], [494, 0.2, 0.18], [740, 0.4, 0.18], [494, 0.6, 0.18]],
    silent: [[587, 0, 0.2], [440, 0.22, 0.2], [330, 0.44, 0.3]],
    cleared: [[523, 0, 0.1], [784, 0.11, 0.14]],
  },
  speak(text) {
    if (!this.speaks || !window.speechSynthesis) return;
    speechSynthesis.cancel(); // the latest value, not all of them
    const spoken = new SpeechSynthesisUtterance(text);
    spoken.lang = document.documentElement.lang;
    speechSynthesis.speak(spoken);
  },
  play(kind) {
    const tones = this.tones[kind];
    if (!tones || this.muted) return;
    this.played.push(kind);
    if (this.played.length > 100) this.played.shift();
    if (!this.context) return;
    for (const [hertz, begin_s, long_s] of tones) {
      const at = this.context.currentTime + begin_s;
      const tone = this.context.createOscillator(), volume = this.context.createGain();
      tone.frequency.value = hertz;
      tone.type = kind === "refused" || kind === "alarm" ? "square" : "sine";
      volume.gain.setValueAtTime(0.0001, at);
      volume.gain.exponentialRampToValueAtTime(0.25, at + 0.01);
      volume.gain.exponentialRampToValueAtTime(0.0001, at + long_s);
      tone.connect(volume).connect(this.context.destination);
      tone.start(at);
      tone.stop(at + long_s + 0.02);
    }
  },
};
for (const touch of ["pointerdown", "keydown"])
  window.addEventListener(touch, () => window.traverse_sounds.begin(), { once: true });
