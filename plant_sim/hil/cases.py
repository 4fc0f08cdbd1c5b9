"""Cases of the bench, in the order in which one machine can go through them."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from functools import partial
from typing import Final, NamedTuple

from plant_sim.crop.seedling import CELLS_ALONG, TRAY_CELLS
from plant_sim.hil.answers import LAMP, answer, has_lamp
from plant_sim.hil.bench import Bench
from plant_sim.hil.delaying_module import DelayingModule
from plant_sim.hil.figure import Figure
from plant_sim.hil.procedure import CaseError, NotRunError, Procedure, Wait
from plant_sim.hil.situations import OutputSituation

TRIAL_TRAYS: Final = 2
"""Trays of a trial. Source: docs/sources/machine.md 5."""
ROWS_OF_A_CYCLE: Final = 2
FAULTS: Final = (
    "broken_wire:stop",
    "broken_wire:left.lift_up",
    "broken_wire:right.lift_down",
    "broken_wire:left.slide_at_feed",
    "stuck_on:left.lift_up",
    "stuck_on:right.slide_at_feed",
    "stuck_off:left.claws_spread",
    "stuck_off:right.claws_converged",
    "stuck_off:left.cup_pulse",
    "stuck_off:tray_front_edge",
    "jammed:left.slide",
    "jammed:right.lift",
    "jammed:left.spreader",
    "jammed:conveyor",
    "stuck_valve:right.slide",
    "low_supply:supply=0.2MPa",
)
"""One fault of every class that a program can detect by its inputs without damage (docs/fault-matrix.md)."""
ASKED_AFTER: Final = frozenset({"jammed:conveyor"})
"""Faults after which the reference program asks the operator."""
DEAD_TIMES_MS: Final = (0, 5, 10, 15, 20, 30, 40, 60, 80)
"""Dead times of the margin in each direction, ms."""
AT_REST_MS: Final = 20_000
"""Time without motion after which a machine counts as stopped, ms: twelve cups at 45 cups per minute take 16 s."""


class Case(NamedTuple):
    """One case.

    Attributes:
        group: Group of the case in the report.
        name: Name of the case, unique in its group.
        procedure: Function that returns the procedure of the case.
        starts: True if the machine must run at the beginning.
    """

    group: str
    name: str
    procedure: Callable[[Bench], Procedure]
    starts: bool = False


def first_cases(reference_lost: int | None) -> Iterator[Case]:
    """Return the cases up to the complete trial, whose situations define the cases that follow.

    Args:
        reference_lost: Seedlings that the machine's own program loses in the same trial; None = not compared.
    """
    yield Case("power-up", "nothing moves without a press", power_up)
    yield Case("homing", "from power-up to the initial state", homing)
    yield Case("cycle", "both arms throw their first row", one_cycle)
    yield Case("trial", f"{TRIAL_TRAYS * TRAY_CELLS} seedlings", lambda bench: trial(bench, reference_lost))
    yield Case("stop", "the machine finishes its cycle and rests", stop)


def stop_cases(situations: dict[OutputSituation, int]) -> Iterator[Case]:
    """Return an emergency stop in every situation, at half of its usual duration."""
    for situation, usual_ms in situations.items():

        def procedure(bench: Bench, situation: OutputSituation = situation, at_ms: int = usual_ms // 2) -> Procedure:
            yield from emergency_stop(bench, situation, at_ms)

        yield Case("emergency stop", situation.title, procedure, starts=True)


def fault_cases() -> Iterator[Case]:
    """Return one case for every class of faults."""
    for fault in FAULTS:

        def procedure(bench: Bench, fault: str = fault) -> Procedure:
            yield from fault_class(bench, fault)

        yield Case("fault", fault, procedure, starts=True)


def margin_cases() -> Iterator[Case]:
    """Return the search for the dead time that the controller tolerates."""
    yield Case("scan-time margin", f"{TRAY_CELLS} seedlings at each dead time", margin, starts=True)


def no_case(group: str, only: str) -> Case:
    """Return a case that states that a group has none, so that this cannot be taken for a success."""

    def procedure(bench: Bench) -> Procedure:
        yield from bench.pause(0)
        text = f"whose name contains {only!r}" if only else "because no situation recurred in the trial"
        raise NotRunError(f"no case {text}")

    return Case(group, only or "every situation", procedure)


# --- procedures


def power_up(bench: Bench) -> Procedure:
    """Require that the controller writes its outputs, and switches nothing on for 3 s."""
    yield from bench.until(lambda: bench.view.is_driven, 60_000, "first write of the outputs")
    bench.forbid("before start was pressed")
    yield from bench.pause(3_000)


def homing(bench: Bench) -> Procedure:
    """Press start; require the initial state, and that no seedling is picked; after power-up the claws are empty."""
    plant = bench.module.plant
    in_tray, works = plant.counts().in_tray, bool(bench.view.on)  # it works if it was brought back after a failure
    yield from home(bench)
    if not works and (picked := in_tray - plant.counts().in_tray) > 0:
        bench.violate("unexpected start", f"{picked} seedlings picked while homing")


def home(bench: Bench) -> Procedure:
    """Press start until both arms rest at feed; three presses are permitted, as after an alarm.

    If the first press switches nothing on, the emergency stop is pressed, released and cleared first: a PLC that ran
    before the plant was connected has seen it, and a program whose machine constants differ waits for it.
    """
    begun_ms = bench.now_ms
    for attempt in range(3):
        bench.forbidden = ""
        pressed_ms = bench.now_ms
        yield from bench.hold("start", 200)
        yield from bench.pause(1_500)
        if attempt == 0 and bench.view.changed_ms < pressed_ms:
            yield from stop_and_clear(bench)
            continue
        if (yield from bench.reached(lambda: bench.is_home, bench.limits.home_ms)):
            bench.findings.figures["homing"] = _seconds_since(bench, begun_ms)
            return
        yield from answer(bench)
    raise CaseError(f"both arms at feed: not within {bench.limits.home_ms / 1000:g} s of a press of start")


def run(bench: Bench) -> Procedure:
    """Press start until the machine works; the first press may home it."""
    bench.forbidden = ""
    for _ in range(4):
        in_tray = bench.module.plant.counts().in_tray
        yield from bench.hold("start", 200)
        if (yield from bench.reached(partial(_picked_since, bench, in_tray), bench.limits.begin_ms)):
            return
        yield from answer(bench)
    raise CaseError(f"no seedling picked within {bench.limits.begin_ms / 1000:g} s of a press of start")


def one_cycle(bench: Bench) -> Procedure:
    """Press start; require the first 24 seedlings out of the tray and out of the claws."""
    begun_ms = bench.now_ms
    yield from bench.hold("start", 200)
    plant = bench.module.plant
    total = plant.counts().total
    yield from bench.until(
        lambda: not plant.counts().in_claw and plant.counts().in_tray <= total - ROWS_OF_A_CYCLE * CELLS_ALONG,
        bench.limits.cycle_ms,
        "24 seedlings picked and thrown",
    )
    bench.findings.figures["first cycle"] = _seconds_since(bench, begun_ms)


def trial(bench: Bench, reference_lost: int | None) -> Procedure:
    """Let the machine work until the seedlings of two trays are gone; judge the losses."""
    begun_ms = bench.now_ms
    gone = ("IN_CUP", "LOST_PICK", "LOST_CARRY", "LOST_THROW")
    counts: dict[str, int] = {}

    def is_done() -> bool:
        if bench.now_ms % 100 == 0:
            counts.update(dict.fromkeys(gone, 0) | dict(bench.view.counts_of(range(TRIAL_TRAYS))))
        return sum(counts.get(name, 0) for name in gone) == TRIAL_TRAYS * TRAY_CELLS

    limit_ms = 12 * bench.limits.cycle_ms
    yield from bench.until(is_done, limit_ms, f"{TRIAL_TRAYS * TRAY_CELLS} seedlings thrown or lost")
    figures = bench.findings.figures
    for name, label in zip(gone, ("in cups", "P", "D", "T"), strict=True):
        figures[label] = Figure(counts[name])
    figures["trial"] = _seconds_since(bench, begun_ms)
    figures["missed cups"] = Figure(sum(bench.module.plant.missed_cups.values()))
    lost = TRIAL_TRAYS * TRAY_CELLS - counts["IN_CUP"]
    if reference_lost is not None:
        figures["lost by the reference program"] = Figure(reference_lost)
        most = most_lost(reference_lost)
        if lost > most:
            bench.violate("losses", f"{lost} seedlings lost; {reference_lost} with the reference program, limit {most}")


def most_lost(reference_lost: int) -> int:
    """Return the largest number of lost seedlings that passes: three standard deviations of a Poisson count more."""
    return round(reference_lost + 3 * math.sqrt(max(1, reference_lost)))


def stop(bench: Bench) -> Procedure:
    """Press stop while the machine works; require that it comes to rest without letting seedlings fall."""
    yield from run(bench)
    bench.findings.mark_ms = bench.now_ms
    yield from bench.hold("stop", 200)
    yield from bench.until(lambda: bench.view.quiet_for(AT_REST_MS), 2 * bench.limits.cycle_ms, "rest after stop")
    bench.forbid("after stop, before start was pressed", resting=bench.view.on)
    yield from bench.pause(2_000)
    bench.forbidden = ""


def emergency_stop(bench: Bench, situation: OutputSituation, at_ms: int) -> Procedure:
    """Press the emergency stop in a situation; require outputs off, no start by itself, and homing afterwards."""
    yield from bench.until(
        lambda: bench.situations.lasts(situation, at_ms), 3 * bench.limits.cycle_ms, f"situation {situation.title}"
    )
    yield from stop_and_clear(bench)
    yield from home(bench)


def stop_and_clear(bench: Bench) -> Procedure:
    """Press the emergency stop, release it, and hold the stop button."""
    bench.press_emergency_stop()
    yield from bench.pause(2_000)
    bench.release_emergency_stop()
    yield from bench.pause(2_000)
    yield from bench.hold("stop", bench.limits.clear_ms)
    yield from bench.pause(1_000)


def fault_class(bench: Bench, fault: str) -> Procedure:
    """Start a fault while the machine works; require no damage, and work again once it has been repaired.

    The machine may stop or go on. If it has not stopped within two cycles, the fault counts as tolerated.
    """
    if fault in ASKED_AFTER and not has_lamp(bench):
        raise NotRunError(f"{LAMP} is not wired, so that the operator cannot be asked for the tray")
    begun_ms = bench.now_ms
    bench.set_fault(fault)
    stopped = yield from bench.reached(lambda: bench.view.quiet_for(AT_REST_MS), 2 * bench.limits.cycle_ms)
    if stopped:
        bench.findings.figures["at rest since"] = Figure((bench.view.moved_ms - begun_ms) / 1_000, "s after the fault")
    bench.repair()
    yield from bench.pause(2_000)
    if stopped:
        yield from bench.hold("stop", bench.limits.clear_ms)
        yield from home(bench)
    yield from run(bench)


def margin(bench: Bench) -> Procedure:
    """Increase the dead time until the machine stops, does damage or loses more seedlings; judge the last good one.

    A dead time in both directions has the effect of a scan that is longer by twice this time at most.
    """
    module = bench.module
    if not isinstance(module, DelayingModule):
        raise NotRunError("the I/O module has no dead time")
    figures = bench.findings.figures
    tolerated_ms, usual_lost = 0, 0
    try:
        for dead_time_ms in DEAD_TIMES_MS:
            if shortage := shortage_of_trays(bench):
                raise NotRunError(shortage)
            module.dead_time_ms = dead_time_ms
            lost = yield from _lost_of_a_tray(bench)
            if not dead_time_ms:
                usual_lost = lost
                if lost == TRAY_CELLS or bench.findings.violations:
                    raise CaseError("does not transplant 72 seedlings without additional dead time")
            figures[f"lost at {dead_time_ms} ms"] = Figure(lost)
            if lost > most_lost(usual_lost) or bench.findings.violations:
                break
            tolerated_ms = dead_time_ms
    finally:
        module.dead_time_ms = 0
    figures["dead time tolerated"] = Figure(tolerated_ms, "ms")
    figures["longer scan tolerated"] = Figure(2 * tolerated_ms, "ms")
    bench.findings.violations.clear()  # of a machine beyond its margin
    if 2 * tolerated_ms < bench.limits.margin_ms:
        raise CaseError(f"tolerates a scan longer by {2 * tolerated_ms} ms only; {bench.limits.margin_ms} ms required")


def shortage_of_trays(bench: Bench) -> str:
    """Return the reason if the trays in the magazine do not suffice for another case; empty = they do."""
    left = bench.module.plant.counts().in_tray
    return "" if left >= 2 * TRAY_CELLS else "too few trays in the magazine; give more with --trays"


def _lost_of_a_tray(bench: Bench) -> Generator[Wait, bool, int]:
    """Return the number of seedlings lost until 72 have been picked; all of them if the machine stops before."""
    plant = bench.module.plant
    begin = plant.counts()

    def is_over() -> bool:
        picked = begin.in_tray - plant.counts().in_tray >= TRAY_CELLS
        return picked or bool(bench.findings.violations) or bench.view.quiet_for(AT_REST_MS)

    yield from bench.reached(is_over, 8 * bench.limits.cycle_ms)
    end = plant.counts()
    if begin.in_tray - end.in_tray < TRAY_CELLS:
        return TRAY_CELLS
    return sum((end.P - begin.P, end.D - begin.D, end.T - begin.T))


def _seconds_since(bench: Bench, begun_ms: int) -> Figure:
    return Figure((bench.now_ms - begun_ms) / 1_000, "s")


def _picked_since(bench: Bench, in_tray: int) -> bool:
    return bench.module.plant.counts().in_tray < in_tray
