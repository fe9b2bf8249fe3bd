// What the browser knows by itself: whether the page's server is there, and what became
// of each press. The server says its time a few times a second; a press states when it
// was made by that time, so that a server that was stopped does not execute it later.
window.traverse_watch = {
  SILENT_MS: 1000, FIRST_MS: 5000, // until the first beat of a page just opened
   LOST_MS: 2500, // after VALID_S of presses.py, and a moment for the answer
  beats: 0, heard_ms: performance.now(), ahead: [], pending: new Map(), n: 0, is_silent: false,

  beat(now_ms) {
    this.beats += 1;
    this.heard_ms = performance.now();
    this.ahead.push(now_ms - this.heard_ms);
    if (this.ahead.length > 8) this.ahead.shift();
    this.look();
  },
  // A beat was written before it arrived: the server's time is at least what the
  // quickest of them says.
  press() {
    const id = ++this.n, at = new Date();
    const now_ms = performance.now();
    this.pending.set(id, { at, now_ms });
    if (this.pending.size > 100) this.pending.delete(this.pending.keys().next().value);
    const ahead_ms = this.ahead.length ? Math.max(...this.ahead) : null;
    emitEvent("traverse_press", { id, at_ms: ahead_ms === null ? null : now_ms + ahead_ms });
  },
  answered(id, late_s) {
    const press = this.pending.get(id);
    this.pending.delete(id);
    if (!press) return;
    const what = `what was pressed at ${this.time(press.at)}`;
    if (late_s === Infinity) this.say(`Not carried out: ${what} was before this page had heard from its server. Press again.`);
    else if (late_s !== null) this.say(`Not carried out: ${what} reached the page's server ${late_s.toFixed(1)} s later. Press again.`);
    else this.say(press.is_lost ? `What was pressed at ${this.time(press.at)} did reach the page's server.` : "", "");
  },
  look() {
    const now_ms = performance.now(), silent_ms = now_ms - this.heard_ms;
    const is_silent = silent_ms > (this.beats ? this.SILENT_MS : this.FIRST_MS);
    if (is_silent !== this.is_silent) {
      this.is_silent = is_silent;
      document.body.classList.toggle("silent", is_silent);
      this.block();
      if (is_silent) window.traverse_sounds?.play("silent");
    }
    if (is_silent) {
      this.block();
      for (const notice of document.querySelectorAll(".silent-for"))
        notice.textContent = `Nothing has arrived from this page's server for ${Math.floor(silent_ms / 1000)} s.`;
    }
    for (const [id, press] of this.pending)
      if (now_ms - press.now_ms > this.LOST_MS && !press.is_lost) {
        press.is_lost = true; // an answer, should there ever be one, still finds it
        this.say(`Lost: what was pressed at ${this.time(press.at)} did not reach the page's server, and will not be carried out.`);
      }
  },
  // By an attribute alone: a button that is really disabled could not answer a click.
  block() {
    for (const button of document.querySelectorAll("button"))
      if (this.is_silent && !button.hasAttribute("aria-disabled")) {
        button.setAttribute("aria-disabled", "true");
        button.dataset.silent = "";
      } else if (!this.is_silent && "silent" in button.dataset) {
        button.removeAttribute("aria-disabled");
        delete button.dataset.silent;
      }
  },
  say(text, sound = "refused") {
    for (const notice of document.querySelectorAll(".press-outcome")) notice.textContent = text;
    if (text && sound) window.traverse_sounds?.play(sound);
  },
  time: (date) => date.toTimeString().slice(0, 8),
  // Before all other listeners of the page.
  take(event) {
    const is_key = event.type === "keydown";
    if (is_key && (event.repeat || event.ctrlKey || event.altKey || event.metaKey)) return;
    if (is_key && event.key.length > 1 && event.key !== "Enter") return;
    const is_text = event.target.closest?.("input, textarea, select");
    if (is_key ? is_text && event.key !== "Enter" : !event.target.closest?.("button")) return;
    if (!this.is_silent) return this.press();
    event.preventDefault();
    event.stopImmediatePropagation();
    this.say(`Not sent at ${this.time(new Date())}: this page's server is silent. Nothing was done.`);
  },
};
for (const kind of ["click", "keydown"])
  window.addEventListener(kind, (event) => window.traverse_watch.take(event), { capture: true });
setInterval(() => window.traverse_watch.look(), 100);
