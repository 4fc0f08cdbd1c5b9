"""Faults of terminals, rows that yield inputs tell, and interruptions of the power and the link of the controller."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

from plant_sim.crop.seedling import COLUMNS, Location, Seedling
from plant_sim.hil.bench import Bench, ControllerSupply, Figure
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.cases import AT_REST_MS, Case, home, rest_after_stop, run, stop_and_clear
from plant_sim.hil.machine_view import SIDES
from plant_sim.hil.procedure import NotRunError, Procedure
from plant_sim.hil.selection import FAULT, SUPPLY, WIRES

SHORTS: Final = (
    ("left.lift_up", "left.lift_down"),
    ("right.slide_at_feed", "right.slide_at_pick_1"),
    ("left.claws_spread", "left.claws_converged"),
    ("start", "stop"),
    ("start", "emergency_stop"),
)
"""Inputs that share a cable, of which a program can notice that they are shorted. The two normally closed contacts
X24 and X25 shorted to each other hide a press of either: only inputs with test pulses reveal it."""
WELDS: Final = ("left.slide_outward", "right.lift_retract", "left.spread", "right.converge")
"""Outputs whose welded contact drives an actuator to an end without harm. Not judged, because no
program can prevent the harm: welded claws, which no input shows, a welded tray stepper, and a lift that goes down by
itself."""
YIELD_INPUTS: Final = ("seedling_beam", "cup_filled")
"""Optional inputs of an arm that tell missing seedlings (ADR 63); a pressure switch tells only the air of the claws."""
OFF_MS: Final = 2_000
"""Duration of an interruption, ms."""
HELD_MS: Final = 3_000
"""Time for which nothing may move after an interruption with start held, ms."""


def wire_cases() -> Iterator[Case]:
    """Return the shorted inputs and the welded outputs."""
    for tags in SHORTS:
        yield Case(WIRES, f"{tags[0]} shorted to {tags[1]}", partial(short, tags), starts=True)
    for tag in WELDS:
        yield Case(WIRES, f"{tag} welded", partial(weld, tag), starts=True)


def yield_cases(bench: Bench) -> Iterator[Case]:
    """Return one case for every arm with an input that tells missing seedlings."""
    wired = {point.tag for point in bench.module.io_map.inputs}
    for side in SIDES:
        if any(f"{side}.{name}" in wired for name in YIELD_INPUTS):
            yield Case(FAULT, f"{side} arm: a row without seedlings", partial(miss_row, side), starts=True)


def supply_cases() -> Iterator[Case]:
    """Return the interruptions of the power and of the link in mid-cycle, without and with start held."""
    for name, attribute in (("power", "is_on"), ("link", "is_linked")):
        for held in (False, True):
            title = f"{name} returns in mid-cycle" + (", start held" if held else "")
            yield Case(SUPPLY, title, partial(interrupt, attribute, held), starts=True)


def miss_row(side: str, bench: Bench) -> Procedure:
    """Take the next row of an arm out of the tray; require that the machine stops by itself, and works again."""
    bench.end_work()
    yield from bench.until(lambda: bool(_next_row(side, bench)), 3 * bench.limits.cycle_ms, f"{side} arm before a row")
    for seedling in _next_row(side, bench):
        bench.module.plant.seedlings.move(seedling, Location.LOST_PICK)
    begun_ms = bench.now_ms
    if not (yield from bench.reached(lambda: bench.view.quiet_for(AT_REST_MS), 2 * bench.limits.cycle_ms)):
        bench.violate("missing seedlings", f"the machine goes on after an empty row of the {side} arm")
        return
    bench.findings.figures["at rest since"] = Figure(
        (bench.view.moved_ms - begun_ms) / 1_000, "s after the row was taken"
    )
    yield from home(bench, after_fault=True)
    yield from run(bench)


def _next_row(side: str, bench: Bench) -> list[Seedling]:
    """Return the seedlings of the row that an arm at feed takes next; none if it is away, or the tray moves or ends."""
    plant, view = bench.module.plant, bench.view
    tray = plant.conveyor.placed_tray
    if tray is None or not view.at_feed(side) or f"{side}.slide_inward" in view.on or "tray_run" in view.on:
        return []
    rows = [plant.seedlings.column(tray, n if side == "left" else COLUMNS - 1 - n) for n in range(COLUMNS // 2)]
    full = [row for row in rows if all(each.location is Location.STANDING for each in row)]
    return full[0] if full else []


def short(tags: tuple[str, str], bench: Bench) -> Procedure:
    """Short two inputs; require no damage, rest after a press of stop, and work after the repair."""
    module = _module(bench)
    bench.end_work()
    module.shorted = tags
    try:
        yield from bench.reached(lambda: bench.view.quiet_for(AT_REST_MS), bench.limits.cycle_ms)
        rows = bench.view.rows.copy()
        bench.module.plant.box.stop = True
        yield from bench.pause(200)
        yield from rest_after_stop(bench, rows)
        bench.press_emergency_stop()
        yield from bench.pause(OFF_MS)
    finally:
        module.shorted = ()
        bench.module.plant.box.stop = False
    yield from _recover(bench)


def weld(tag: str, bench: Bench) -> Procedure:
    """Weld an output; require no damage, outputs off by the emergency stop, and work after the repair.

    The machine may go on if the actuator is where it belongs. The emergency stop also cuts the welded coil, because
    the safety relay is behind the contact.
    """
    module = _module(bench)
    bench.end_work()
    module.welded = tag
    try:
        yield from bench.reached(lambda: bench.view.quiet_for(AT_REST_MS), bench.limits.cycle_ms)
        bench.press_emergency_stop()
        yield from bench.pause(OFF_MS)
    finally:
        module.welded = ""
    yield from _recover(bench)


def interrupt(attribute: str, held: bool, bench: Bench) -> Procedure:
    """Interrupt the power or the link while an arm carries seedlings; require that nothing moves by its return."""
    supply = _supply(bench)
    carries = {"left.slide_outward", "left.lift_retract"}
    yield from bench.until(
        lambda: bench.view.on >= carries and bench.view.holds("left"), bench.limits.cycle_ms, "the left arm carries"
    )
    bench.end_work()
    bench.expect_off(bench.module.watchdog_ms)
    try:
        setattr(supply, attribute, False)
        bench.is_interrupted = True
        yield from bench.pause(OFF_MS // 2)
        bench.module.plant.box.start = held
        yield from bench.pause(OFF_MS // 2)
        setattr(supply, attribute, True)
        yield from bench.pause(500)
        bench.is_interrupted = False
        bench.forbid_start()
        yield from bench.pause(HELD_MS if held else AT_REST_MS)
        bench.release_buttons()
        yield from bench.pause(HELD_MS)
    finally:
        bench.is_interrupted = False
        supply.is_on = supply.is_linked = True
        bench.release_buttons()
    yield from _recover(bench)


def _recover(bench: Bench) -> Procedure:
    """Press and clear the emergency stop, home, and let the machine work."""
    yield from stop_and_clear(bench)
    yield from home(bench, after_fault=True)
    yield from run(bench)


def _module(bench: Bench) -> BenchModule:
    if not isinstance(bench.module, BenchModule):
        raise NotRunError("the terminals of this I/O module cannot be faulty")
    return bench.module


def _supply(bench: Bench) -> ControllerSupply:
    if bench.supply is None:
        raise NotRunError("the bench cannot interrupt the power or the link of this controller; do it by hand")
    return bench.supply
