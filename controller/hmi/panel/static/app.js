// Shared state and functions of all pages: description, link, I/O points by tag, orders.

import { localized, sentence, t } from "./texts.js";

export const app = { describe: null, link: null, points: new Map(), alarms: new Map(), notice: () => {}, pressed: () => {} };

const RANK = { none: 0, view: 1, operate: 2, maintain: 3 };

export function useDescription(description) {
  app.describe = description;
  app.points = new Map(description.points.map((point) => [point.tag, point]));
  app.alarms = new Map(description.alarms.map((alarm) => [alarm.number, alarm]));
}

/** Return whether the access level of this browser is at least the given one. */
export function hasLevel(level) {
  return RANK[app.link.level] >= RANK[level];
}

/** Return the reason why an order is unavailable, as text; null if it is available. */
export function obstacle(level, command = null) {
  if (!app.link.live) return t("why.stale");
  if (!hasLevel(level)) return t(`why.${level}`);
  if (command === null) return null;
  const state = app.link.view.commands[command];
  if (state === undefined || state.free) return null;
  return sentence(localized(state.why)) || t("why.unknown");
}

let presses = 0;

/** Return a new press of a control, with the number that orders the replies of presses; the control's last notice ends. */
export function newPress(control = null) {
  presses += 1;
  app.pressed(control);
  return { number: presses, control };
}

/** Show why a press of a control has no effect, until it is pressed again or `holds` returns false. */
export function refuse(reason, control = null, holds = null) {
  app.notice(reason, false, newPress(control), holds);
}

/** Send an order and show the reply to its press, or `done` in place of a positive one; returns whether it is positive. */
export async function order(message, press = newPress(), done = null) {
  const reply = await app.link.order(message);
  app.notice(reply.ok && done !== null ? done : replyText(reply), reply.ok, press);
  return reply.ok;
}

/** Return the text of a reply: from the server, or by key from the link. */
export function replyText(reply) {
  return reply.key === undefined ? sentence(localized(reply.text)) : t(reply.key);
}

/** Return whether an I/O point is active, regardless of its polarity; null if the tag is unknown. */
export function active(view, tag) {
  const point = app.points.get(tag);
  const level = point === undefined ? undefined : view.io[point.address];
  return level === undefined ? null : Boolean(level) !== point.inverted;
}

/** Return a telemetry value, or null if it is not available. */
export function measured(view, name) {
  const value = view.telemetry?.[name];
  return view.link.telemetry && typeof value === "number" ? value : null;
}

/** Return the active step of a list of steps, or null. */
export function activeStep(view, steps) {
  return steps.find((step) => view.steps[step.s]) ?? null;
}

/** Get JSON from the server; null on any error. */
export async function get(path) {
  try {
    const response = await fetch(path);
    return response.ok ? await response.json() : null;
  } catch {
    return null;
  }
}

/** Get rows of the history; null if there is no history. */
export async function getHistory(query) {
  return app.link.view?.link.history ? get(`/api/history/${query}`) : null;
}

/** Post JSON to the server; returns {ok, body}. */
export async function post(path, body = {}) {
  try {
    const response = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
    });
    return { ok: response.ok, body: await response.json().catch(() => ({})) };
  } catch {
    return { ok: false, body: {} };
  }
}
