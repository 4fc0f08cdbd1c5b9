// Texts by key in the selected language; the server provides the table with the description.

import { store, stored } from "./storage.js";

const STORAGE_KEY = "panel-language";
export const LANGUAGE_NAMES = { en: "English", zh: "中文" };
let table = {};
let selected = "en";
let chosen = null; // by the user of this page

/** Take the texts, and the language from the user's choice, else the server's option, else the browser's settings. */
export function useTexts({ texts, languages, language: preset }) {
  table = texts;
  const preferred = window.navigator.languages.map((tag) => tag.toLowerCase().split("-")[0]);
  show([chosen, stored(STORAGE_KEY), preset, ...preferred, "en"].find((name) => languages.includes(name)));
}

function show(name) {
  selected = name;
  document.documentElement.lang = name === "zh" ? "zh-CN" : name;
}

export function language() {
  return selected;
}

/** Show and store the user's choice. */
export function chooseLanguage(name) {
  chosen = name;
  show(name);
  store(STORAGE_KEY, name);
}

export function has(key) {
  return key in table;
}

/** Return the text of a key with its `{name}` placeholders replaced by the values. */
export function t(key, values = {}) {
  const text = localized(table[key] ?? key);
  return text.replace(/\{(\w+)\}/g, (placeholder, name) => (name in values ? String(values[name]) : placeholder));
}

/** Return a text from the server, `{en, zh}` or plain, in the selected language. */
export function localized(text) {
  if (text === null || text === undefined) return "";
  return typeof text === "string" ? text : text[selected] ?? text.en ?? "";
}

/** Return the text of a key, or a default text from the server if the key is missing. */
export function named(key, defaultText) {
  return has(key) ? t(key) : localized(defaultText);
}

/** Return a text with an upper-case first letter, for messages that stand alone. */
export function sentence(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** Return "label: text" with the punctuation of the language. */
export function labelled(label, text) {
  return t("format.labelled", { label, text });
}

/** Return "text (note)" with the punctuation of the language. */
export function note(text, remark) {
  return t("format.note", { text, note: remark });
}

/** Return texts separated by the comma of the language. */
export function list(texts) {
  return texts.join(t("format.comma"));
}

/** Return a unit in the selected language; SI symbols are the same in all languages. */
export function unitText(unit) {
  return unit ? named(`unit.${unit}`, unit) : "";
}

/** Return a duration as text: 5 s, 3 min 20 s, 2 h 5 min. */
export function duration(ms) {
  const total = Math.max(0, Math.round(ms / 1000));
  if (total < 60) return t("duration.s", { s: total });
  if (total < 3600) return t("duration.min", { min: Math.floor(total / 60), s: total % 60 });
  return t("duration.h", { h: Math.floor(total / 3600), min: Math.floor((total % 3600) / 60) });
}

/** Return a wall-clock time in the local time zone, with its UTC offset. */
export function wallClock(utcMs) {
  return withOffset(new Date(utcMs).toLocaleString(selected === "zh" ? "zh-CN" : "en-GB"), utcMs);
}

/** Return a local time with its UTC offset, as in 02:30:00 +02:00: an hour is repeated when daylight saving time ends. */
export function withOffset(time, utcMs) {
  const minutes = -new Date(utcMs).getTimezoneOffset();
  const [hour, minute] = [Math.floor(Math.abs(minutes) / 60), Math.abs(minutes) % 60].map((part) => String(part).padStart(2, "0"));
  return `${time} ${minutes < 0 ? "-" : "+"}${hour}:${minute}`;
}

/** Return the time of day in the local time zone: hours and minutes. */
export function clock() {
  return new Date().toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
}

/** Return the time of day in the local time zone, or the date at midnight, to the minute or to the second. */
export function clockTime(utcMs, seconds) {
  const at = new Date(utcMs);
  const locale = selected === "zh" ? "zh-CN" : "en-GB";
  if (!seconds && at.getHours() === 0 && at.getMinutes() === 0) return at.toLocaleDateString(locale, { day: "2-digit", month: "2-digit" });
  return at.toLocaleTimeString(locale, { hour: "2-digit", minute: "2-digit", hourCycle: "h23", ...(seconds ? { second: "2-digit" } : {}) });
}

/** Return a number with a fixed number of decimals; a value that rounds to zero has no sign. */
export function fixed(value, decimals) {
  return (Number(value.toFixed(decimals)) || 0).toFixed(decimals);
}

/** Return the force of a finger as clamp force: the opening force clamps nothing. */
export function clampForce(force) {
  return force === null ? null : Math.max(0, force);
}

/** Return ms as seconds with one decimal and the unit, or a dash if there is no value. */
export function seconds(ms) {
  return ms ? `${(ms / 1000).toFixed(1)} ${unitText("s")}` : "–";
}
