// Touch on a plot: one finger moves the time, two fingers stretch it. The mouse is handled by uPlot.

/**
 * Report gestures of fingers on the plotting area of a chart.
 *
 * @param area element of the plotting area
 * @param begin called when a finger goes down, with its x in the area, px
 * @param change called with the places of the fingers before and after a move, as shares of the width: [[from, to], ...]
 */
export function followFingers(area, begin, change) {
  const fingers = new Map();
  const share = (event) => {
    const box = area.getBoundingClientRect();
    return (event.clientX - box.left) / box.width;
  };
  area.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    fingers.set(event.pointerId, share(event));
    begin(share(event) * area.clientWidth);
  });
  area.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = [...fingers.entries()];
    fingers.set(event.pointerId, share(event));
    change(before.slice(0, 2).map(([id, from]) => [from, fingers.get(id)]));
  });
  for (const end of ["pointerup", "pointercancel"]) area.addEventListener(end, (event) => fingers.delete(event.pointerId));
}
