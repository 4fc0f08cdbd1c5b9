// Values of the production that several pages show.

import { active, measured } from "../app.js";
import { list, t } from "../texts.js";

/** Return the tray at the pick position and its conveyor as text. */
export function trayWords(view) {
  return list([t(`phase.${view.tray.phase}`), t(active(view, "tray_run") ? "conveyor.runs" : "conveyor.stopped")]);
}

/** Return the number of trays until the target; a text if there is no target. */
export function traysLeft(view) {
  const target = view.set_points.trays_target;
  return target === 0 ? t("trays_left.unlimited") : Math.max(0, target - view.machine.trays_done);
}

/** Return the cups that passed both arms without a seedling. */
export function missedCups(view) {
  return view.arms.left.missed_cups + view.arms.right.missed_cups;
}

/** Return the seedlings in the cups of all that were thrown, as text; null without telemetry. */
export function seedlingsInCups(view) {
  const [inCups, total] = [measured(view, "in_cups"), measured(view, "total")];
  return inCups === null ? null : `${inCups} / ${total ?? "–"}`;
}
