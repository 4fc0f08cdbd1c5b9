// What every page needs: the description, the link, the points by tag, orders with their answer shown.

import { t, say } from "./texts.js";

export const app = { describe: null, link: null, points: new Map(), alarms: new Map(), notice: () => {} };

const RANK = { none: 0, view: 1, operate: 2, maintain: 3 };

export function useDescription(description) {
  app.describe = description;
  app.points = new Map(description.points.map((point) => [point.tag, point]));
  app.alarms = new Map(description.alarms.map((alarm) => [alarm.number, alarm]));
}

/** Return whether the level of this browser is at least the one wanted. */
export function mayAs(level) {
  return RANK[app.link.level] >= RANK[level];
}

/** Return why an order is not possible now, in words, or null where it is. */
export function obstacle(level, command = null) {
  if (!app.link.live) return t("why.stale");
  if (!mayAs(level)) return t(`why.${level}`);
  if (command === null) return null;
  const state = app.link.view.commands[command];
  if (state === undefined || state.free) return null;
  return say(state.why) || t("why.unknown");
}

/** Send an order and show its answer; returns whether it was done. */
export async function order(message) {
  const reply = await app.link.order(message);
  app.notice(reply.key === undefined ? say(reply.text) : t(reply.key), reply.ok);
  return reply.ok;
}

/** Return whether the thing that a wire names is so, whatever the wire's polarity; null: there is no such wire. */
export function active(view, tag) {
  const point = app.points.get(tag);
  const level = point === undefined ? undefined : view.io[point.address];
  return level === undefined ? null : Boolean(level) !== point.inverted;
}

/** Return a telemetry value, or null where there is none. */
export function measured(view, name) {
  const value = view.telemetry?.[name];
  return view.link.telemetry && typeof value === "number" ? value : null;
}

/** Return the step that is on in a list of steps, or null. */
export function activeStep(view, steps) {
  return steps.find((step) => view.steps[step.s]) ?? null;
}

/** Get JSON of the server; null where it has none to give. */
export async function get(path) {
  try {
    const response = await fetch(path);
    return response.ok ? await response.json() : null;
  } catch {
    return null;
  }
}

/** Get something of the history; null where there is none. */
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
