// Creation of elements, texts by key, and requests; independent of the program.

let texts = {};
let selected = "en";
const STORED = "ladder-language";

/** Create an element: attributes by name, `text`, `on: {event: handler}`, followed by the children. */
export function make(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") node.textContent = value;
    else if (name === "on") Object.entries(value).forEach(([event, handler]) => node.addEventListener(event, handler));
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

/** Create an element of a picture. */
export function draw(tag, attributes = {}) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  Object.entries(attributes).forEach(([name, value]) => node.setAttribute(name, value));
  return node;
}

/** Set the text of a node only if it differs. */
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

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

/** Return a text from the server in the selected language. */
export function localized(text) {
  return text[selected];
}

/** Return the text of a key with its placeholders replaced. */
export function t(key, values = {}) {
  return localized(texts[key]).replace(/\{(\w+)\}/g, (all, name) => (name in values ? String(values[name]) : all));
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
