// The page in the operator's language, and with a decimal comma where that is wanted.
// The server writes English; texts of the catalogue (languages.tsv) are replaced here,
// before they are drawn. {1} of a row stands for any text, which is looked up, too, {#1}
// for a number; a text of several sentences is looked up sentence by sentence. What is not in the
// catalogue stays English. Names that people gave are in elements with translate="no".
window.traverse_language = {
  ATTRIBUTES: ["aria-label", "placeholder", "title"], MOST_KNOWN: 5000,
  code: "en", has_comma: false, names: {}, columns: {},
  words: new Map(), patterns: [], known: new Map(), missing: new Set(),
  sources: new WeakMap(), // of a text or an element: what the server wrote

  async begin(url) {
    const rows = (await (await fetch(url)).text()).trimEnd().split("\n").map((row) => row.split("\t"));
    const codes = rows[0];
    codes.forEach((code, column) => { this.names[code] = rows[1][column]; this.columns[code] = column; });
    this.rows = rows.slice(2);
    const wanted = localStorage.traverse_language ?? navigator.language.slice(0, 2);
    this.has_comma = localStorage.traverse_comma === "true";
    new MutationObserver((changes) => this.follow(changes)).observe(document.body, {
      subtree: true, childList: true, characterData: true, attributes: true, attributeFilter: this.ATTRIBUTES,
    });
    // The framework writes its own language there once it is loaded.
    const root = document.documentElement, set_lang = () => { if (root.lang !== this.code) root.lang = this.code; };
    new MutationObserver(set_lang).observe(root, { attributeFilter: ["lang"] });
    this.use(wanted in this.columns ? wanted : "en", this.has_comma);
  },
  use(code, has_comma) {
    [this.code, this.has_comma] = [code, has_comma];
    [localStorage.traverse_language, localStorage.traverse_comma] = [code, has_comma];
    document.documentElement.lang = code;
    this.words.clear(); this.known.clear(); this.missing.clear(); this.patterns = [];
    if (code !== "en")
      for (const row of this.rows) {
        const into = row[this.columns[code]];
        if (!/\{#?1\}/.test(row[0])) { this.words.set(row[0], into); continue; }
        const escaped = row[0].replace(/[.*+?^$()|[\]\\]/g, "\\$&");
        const form = escaped.replace(/\{#\d\}/g, "([-+\\d.,]+)").replace(/\{\d\}/g, "(.*?)");
        // The longer its own text, the earlier it is tried.
        const fixed = row[0].replace(/\{#?\d\}/g, "").length;
        this.patterns.push({ fixed, into, form: new RegExp(`^${form}$`, "s") });
      }
    this.patterns.sort((one, other) => other.fixed - one.fixed);
    this.show(document.body);
  },
  follow(changes) {
    for (const change of changes)
      if (change.type === "characterData") this.show_text(change.target);
      else if (change.type === "attributes") this.show_attribute(change.target, change.attributeName);
      else for (const node of change.addedNodes) this.show(node);
  },
  show(root) {
    if (root.nodeType === Node.TEXT_NODE) return this.show_text(root);
    if (root.nodeType !== Node.ELEMENT_NODE) return;
    const texts = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) this.show_text(texts.currentNode);
    for (const element of [root, ...root.querySelectorAll("*")])
      for (const name of this.ATTRIBUTES) if (element.hasAttribute(name)) this.show_attribute(element, name);
  },
  show_text(node) {
    const is_plain = this.code === "en" && !this.has_comma;
    if ((is_plain || !/[A-Za-z]{2}|\d\.\d/.test(node.data)) && !this.sources.has(node)) return;
    if (node.parentElement?.closest("[translate=no], script, style, noscript, textarea")) return;
    const shown = this.replaced(node, "", node.data);
    if (shown !== node.data) node.data = shown;
  },
  show_attribute(element, name) {
    if (element.closest("[translate=no]")) return;
    const value = element.getAttribute(name), shown = this.replaced(element, name, value);
    if (shown !== value) element.setAttribute(name, shown);
  },
  // What was written here is kept, so that another language can be chosen.
  replaced(node, name, text) {
    if (!this.sources.has(node)) this.sources.set(node, {});
    const kept = this.sources.get(node);
    if (kept[name]?.shown !== text) kept[name] = { source: text };
    kept[name].shown = this.with_comma(this.translated(kept[name].source));
    return kept[name].shown;
  },
  with_comma(text) {
    return this.has_comma ? text.replace(/(?<![\d.])(\d+)\.(\d+)(?![\d.])/g, "$1,$2") : text;
  },
  has_words(text) {
    return /[A-Za-z]{2}/.test(text.replace(/\b(mm|ms|MB|inch|CSV|DXF|JSON|PLY|QIF)\b/g, ""));
  },
  translated(text) {
    const inner = text.trim();
    if (this.code === "en" || !this.has_words(inner)) return text;
    let into = this.known.get(inner);
    if (into === undefined) {
      into = this.in_parts(inner);
      if (into === undefined) { this.missing.add(inner); into = inner; }
      if (this.known.size >= this.MOST_KNOWN) this.known.clear();
      this.known.set(inner, into);
    }
    return text.replace(inner, () => into);
  },
  in_parts(text) {
    return this.with_end(text) ?? this.by_sentences(text);
  },
  with_end(text) {
    const into = this.looked_up(text);
    if (into !== undefined || !/[.?!:;,]$/.test(text)) return into;
    const without = this.looked_up(text.slice(0, -1));
    return without === undefined ? undefined : without + text.slice(-1);
  },
  looked_up(text) {
    if (!text) return undefined;
    const lower = text[0].toLowerCase() + text.slice(1), upper = text[0].toUpperCase() + text.slice(1);
    let into = this.words.get(text);
    if (into !== undefined) return into;
    into = this.words.get(lower);
    if (into !== undefined) return into[0].toUpperCase() + into.slice(1);
    into = this.words.get(upper);
    if (into !== undefined) return into[0].toLowerCase() + into.slice(1);
    for (const { form, into } of this.patterns) {
      const values = form.exec(text);
      if (values) return into.replace(/\{(\d)\}/g, (_, n) => this.part(values[n]));
    }
  },
  // A value: number, name or text; it may be in the catalogue.
  part(text) {
    return this.has_words(text) ? this.in_parts(text) ?? text : text;
  },
  by_sentences(text) {
    const sentences = text.split(/(?<=[.?!:;,]) /);
    if (sentences.length < 2) return undefined;
    const into = sentences.map((sentence) => this.with_end(sentence));
    if (into.every((sentence) => sentence === undefined)) return undefined;
    sentences.forEach((sentence, n) => { if (into[n] === undefined && this.has_words(sentence)) this.missing.add(sentence); });
    return into.map((sentence, n) => sentence ?? sentences[n]).join(" ");
  },
};
