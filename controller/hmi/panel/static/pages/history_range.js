// Time range of the history: all, the last minutes, or some minutes around a time. Times are ms since 1970 UTC.

const MINUTE_MS = 60_000;
export const SPANS_MIN = [10, 60, 720];
export const AROUND_MIN = 5;

/** Return the limits of a range for a query: `minutes` before now, around `utcMs`, or none. */
export function limits(minutes, utcMs) {
  if (utcMs !== null) return { since: utcMs - AROUND_MIN * MINUTE_MS, until: utcMs + AROUND_MIN * MINUTE_MS };
  return minutes === null ? {} : { since: Date.now() - minutes * MINUTE_MS };
}
