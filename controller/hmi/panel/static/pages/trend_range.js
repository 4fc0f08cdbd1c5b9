// Time range of the trends: a span that ends now (live) or at a fixed time. Times are ms since 1970 UTC.

const MINUTE_MS = 60_000;
export const SPANS_MIN = [10, 60, 240, 720];
const LONGEST_MS = SPANS_MIN.at(-1) * MINUTE_MS;
const SHORTEST_MS = 10_000;
const LIVE_SHARE = 0.03; // of the span: a range that ends this shortly before now is live

export class TrendRange {
  constructor() {
    this.spanMs = SPANS_MIN[0] * MINUTE_MS;
    this.nowMs = Date.now(); // of the panel, with the latest answer
    this.keptMs = LONGEST_MS;
    this.endMs = null; // null: live
  }

  get live() {
    return this.endMs === null;
  }

  get toMs() {
    return this.endMs ?? this.nowMs;
  }

  get fromMs() {
    return this.toMs - this.spanMs;
  }

  /** Take the time of the panel, and for how long it keeps trends. */
  took(nowMs, keptMs) {
    this.nowMs = nowMs;
    this.keptMs = keptMs;
  }

  /** Show a span of minutes with the same end. */
  span(minutes) {
    this.#show(this.toMs, minutes * MINUTE_MS);
  }

  /** Show the range between two times. */
  show(fromMs, toMs) {
    this.#show(toMs, toMs - fromMs);
  }

  /** Multiply the span by a factor, about a time: by default the end if live, else the middle. */
  zoom(factor, aboutMs = this.live ? this.toMs : (this.fromMs + this.toMs) / 2) {
    const spanMs = bounded(this.spanMs * factor, SHORTEST_MS, LONGEST_MS);
    this.#show(aboutMs + (this.toMs - aboutMs) * (spanMs / this.spanMs), spanMs);
  }

  /** Move the range by ms; positive is later. */
  pan(ms) {
    this.#show(this.toMs + ms, this.spanMs);
  }

  follow() {
    this.endMs = null;
  }

  #show(toMs, spanMs) {
    this.spanMs = Math.round(bounded(spanMs, SHORTEST_MS, LONGEST_MS));
    const endMs = Math.max(toMs, this.nowMs - this.keptMs + this.spanMs);
    this.endMs = endMs >= this.nowMs - LIVE_SHARE * this.spanMs ? null : Math.round(endMs);
  }
}

function bounded(value, least, most) {
  return Math.min(most, Math.max(least, value));
}
