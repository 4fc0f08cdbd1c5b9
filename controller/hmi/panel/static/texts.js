// Labels by key in the language chosen; the table comes from the server with the description.

const KEPT = "panel-language";
let table = {};
let chosen = remembered();

function remembered() {
  try {
    return window.localStorage.getItem(KEPT) ?? "en";
  } catch {
    return "en"; // storage is blocked: the choice lasts as long as the page
  }
}

export function useTexts(texts) {
  table = texts;
}

export function language() {
  return chosen;
}

export function chooseLanguage(name) {
  chosen = name;
  document.documentElement.lang = name === "zh" ? "zh-CN" : name;
  try {
    window.localStorage.setItem(KEPT, name);
  } catch {
    // storage is blocked: the choice lasts as long as the page
  }
}

export function has(key) {
  return key in table;
}

/** Return the text of a key, with `{name}` replaced by the values. */
export function t(key, values = {}) {
  const text = say(table[key] ?? key);
  return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));
}

/** Return a text of the server, `{en, zh}`, or a plain one, in the language chosen. */
export function say(text) {
  if (text === null || text === undefined) return "";
  return typeof text === "string" ? text : text[chosen] ?? text.en ?? "";
}

/** Return the text of a key, or the server's own words where the table has none. */
export function named(key, otherwise) {
  return has(key) ? t(key) : say(otherwise);
}

/** Return a duration in words of a clock: 5 s, 3 min 20 s, 2 h 5 min. */
export function duration(ms) {
  const seconds = Math.max(0, Math.round(ms / 1000));
  if (seconds < 60) return `${seconds} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${seconds % 60} s`;
  return `${Math.floor(seconds / 3600)} h ${Math.floor((seconds % 3600) / 60)} min`;
}

/** Return a time of the wall clock in the reader's zone. */
export function wallClock(utcMs) {
  return new Date(utcMs).toLocaleString(chosen === "zh" ? "zh-CN" : "en-GB");
}

/** Return ms as seconds with one digit, or a dash where there is none. */
export function seconds(ms) {
  return ms ? (ms / 1000).toFixed(1) : "–";
}
