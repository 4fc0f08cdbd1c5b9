// Texts by key, and requests.

import { write } from "./dom.js";

let texts = {};
let selected = "en";
const STORED = "ladder-language";

/** Take the table of texts; the language is the stored one, else that of the browser. */
export function useTexts(table) {
  texts = table;
  let wanted = null;
  try {
    wanted = window.localStorage.getItem(STORED);
  } catch { /* no storage */ }
  choose(wanted ?? (window.navigator.language.startsWith("zh") ? "zh" : "en"));
}

/** Show the other language. */
export function otherLanguage() {
  choose(selected === "en" ? "zh" : "en");
  try {
    window.localStorage.setItem(STORED, selected);
  } catch { /* no storage */ }
}

function choose(language) {
  selected = language === "zh" ? "zh" : "en";
  document.documentElement.lang = selected === "zh" ? "zh-CN" : "en";
  document.querySelectorAll("[data-text]").forEach((node) => write(node, t(node.dataset.text)));
  document.querySelectorAll("[data-label]").forEach((node) => node.setAttribute("aria-label", t(node.dataset.label)));
  document.querySelectorAll("[data-hint]").forEach((node) => {
    node.placeholder = t(node.dataset.hint);
    node.setAttribute("aria-label", node.placeholder);
  });
}

/** Return the selected language. */
export function language() {
  return selected;
}

/** Return a text from the server in the selected language. */
export function localized(text) {
  return text[selected];
}

/** Return the text of a key with its placeholders replaced. */
export function t(key, values = {}) {
  return localized(texts[key]).replace(/\{(\w+)\}/g, (all, name) => (name in values ? String(values[name]) : all));
}

/** Return why a scan is not known as executed. */
export function unknown({ hidden, differing }) {
  if (hidden.length > 0) return t("hidden", { instructions: hidden.join(", ") });
  return differing.length > 0 ? t("differs", { devices: differing.join(", ") }) : t("few");
}

/** Return the answer to a request as {status, body}; status 0 = no answer in time. */
export async function ask(path, values = {}, options = {}) {
  try {
    const answer = await fetch(`${path}?${new URLSearchParams(values)}`, { signal: AbortSignal.timeout(5000), ...options });
    return { status: answer.status, body: await answer.json() };
  } catch {
    return { status: 0, body: { state: "lost" } };
  }
}
