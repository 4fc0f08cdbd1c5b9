"""Cases of the bench, in the order in which one machine can go through them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterator
from functools import partial
from typing import Final, NamedTuple

from plant_sim.crop.seedling import CELLS_ALONG, TRAY_CELLS
from plant_sim.hil.answers import answer, has_lamp
from plant_sim.hil.bench import Bench, Figure
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.procedure import CaseError, NotRunError, Procedure, Wait
from plant_sim.hil.reference import TRIAL_SEEDLINGS, TRIAL_TRAYS, TrialQuantities, excesses, most
from plant_sim.hil.selection import EDGE, FAULT, WORK
from plant_sim.hil.situations import OutputSituation
from plant_sim.twin.ladder.question_lamp import LAMP

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
GONE: Final = ("IN_CUP", "LOST_PICK", "LOST_CARRY", "LOST_THROW")
"""Places of the seedlings that have left the machine."""
WORK_MS: Final = 300_000
"""Time for which the machine works undisturbed, so that rare faults of a program are seen, ms."""
WORK_AGAIN_MS: Final = 120_000
"""Time for which the machine works undisturbed after a stop, ms: more than two trays at 45 cups per minute."""
REST_MS: Final = 60_000
"""Time for which a machine at rest is watched once for each kind of rest, ms."""
WARNING_MS: Final = 5_000
"""Longest time from a press of start to the first motion, ms: a start warning takes 2 s. Else a question is asked."""
PRESSES_TO_WORK: Final = 5
"""Presses of start by which the machine must work: a refused one, two questions, homing, and the start."""
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


def first_cases() -> Iterator[Case]:
    """Return the cases up to the complete trial, whose situations define the cases that follow."""
    yield Case("power-up", "nothing moves without a press", power_up)
    yield Case("homing", "from power-up to the initial state", homing)
    yield Case("cycle", "both arms throw their first row", one_cycle)
    yield Case("trial", f"{TRIAL_SEEDLINGS} seedlings", trial)
    yield Case("stop", "the machine finishes its cycle and rests", stop)


def stop_cases(situations: dict[OutputSituation, int]) -> Iterator[Case]:
    """Return an emergency stop in every situation, at half of its usual duration and at its beginning."""
    for group, share in (("emergency stop", 0.5), (EDGE, 0.0)):
        for situation, usual_ms in situations.items():
            yield Case(group, situation.title, partial(emergency_stop, situation, round(share * usual_ms)), starts=True)


def fault_cases() -> Iterator[Case]:
    """Return one case for every class of faults."""
    for fault in FAULTS:
        yield Case(FAULT, fault, partial(fault_class, fault), starts=True)


def work_cases() -> Iterator[Case]:
    """Return a long span of undisturbed work, and one after each kind of stop that is no fault."""
    yield Case(WORK, f"{WORK_MS // 1_000} s undisturbed", partial(Bench.pause, for_ms=WORK_MS), starts=True)
    yield Case(WORK, "after an emergency stop", work_after_emergency_stop, starts=True)
    yield Case(WORK, "after a stop and a rest", work_after_rest, starts=True)


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
    """Require that the controller writes its outputs, and switches nothing on."""
    yield from bench.until(lambda: bench.view.is_driven, 60_000, "first write of the outputs")
    bench.forbid("before start was pressed")
    yield from bench.pause(REST_MS)


def homing(bench: Bench) -> Procedure:
    """Press start; require the initial state, and that no seedling is picked; after power-up the claws are empty."""
    plant = bench.module.plant
    in_tray, works = plant.counts().in_tray, bool(bench.view.on)  # it works if it was brought back after a failure
    yield from home(bench)
    if not works and (picked := in_tray - plant.counts().in_tray) > 0:
        bench.violate("unexpected start", f"{picked} seedlings picked while homing")


def home(bench: Bench, *, after_fault: bool = False) -> Procedure:
    """Press start until both arms rest at feed.

    The first press that moves the machine must suffice; after a fault, three presses are permitted, because the first
    ones may end with an alarm. If the first press switches nothing on and asks nothing, the emergency stop is pressed
    and cleared: a PLC may have seen it off before the plant was connected, or wait for it because its constants differ.
    """
    begun_ms = bench.now_ms
    for attempt in range(3):
        bench.forbidden = ""
        pressed_ms = bench.now_ms
        moves = yield from press_start(bench)
        if not moves and (yield from answer(bench)):
            continue
        if attempt == 0 and not moves:
            yield from stop_and_clear(bench)
            continue
        if (yield from bench.reached(lambda: bench.is_home, bench.limits.home_ms)):
            bench.findings.figures["homing"] = _seconds_since(bench, begun_ms)
            return
        if moves and not after_fault:
            bench.violate("homing", "a press of start moved the machine, but did not bring both arms to feed")
        yield from answer(bench)
    limit = f"{bench.limits.home_ms / 1000:g} s of a press of start"
    raise CaseError(f"both arms at feed: not within {limit}{_silence(bench, pressed_ms)}")


def press_start(bench: Bench) -> Generator[Wait, bool, bool]:
    """Press start, and wait until an actuator is switched; return whether one was, also after a start warning."""
    pressed_ms = bench.now_ms
    yield from bench.hold("start", 200)
    return (yield from bench.reached(partial(_switched_since, bench, pressed_ms), WARNING_MS))


def run(bench: Bench) -> Procedure:
    """Press start until the machine works, after an answer and homing; stop one that refuses start, to home it."""
    bench.forbidden = ""
    for _ in range(PRESSES_TO_WORK):
        in_tray, pressed_ms = bench.module.plant.counts().in_tray, bench.now_ms
        if not (yield from press_start(bench)) and (yield from answer(bench)):
            continue
        yield from bench.reached(partial(_picked_or_homed, bench, in_tray, pressed_ms), bench.limits.begin_ms)
        if _picked_since(bench, in_tray):
            bench.work.begin()
            return
        if not _switched_since(bench, pressed_ms):
            yield from bench.hold("stop", 200)
        elif not bench.is_home:
            yield from answer(bench)
    raise CaseError(f"no seedling picked by {PRESSES_TO_WORK} presses of start{_silence(bench, pressed_ms)}")


def one_cycle(bench: Bench) -> Procedure:
    """Press start, again after an answer and homing; require the first row of each arm picked and thrown."""
    begun_ms = bench.now_ms
    if not (yield from press_start(bench)) and (yield from answer(bench)):
        yield from home(bench)
        yield from press_start(bench)
    plant = bench.module.plant
    total = plant.counts().total
    yield from bench.until(
        lambda: not plant.counts().in_claw and plant.counts().in_tray <= total - ROWS_OF_A_CYCLE * CELLS_ALONG,
        bench.limits.cycle_ms,
        "24 seedlings picked and thrown",
    )
    bench.findings.figures["first cycle"] = _seconds_since(bench, begun_ms)


def trial(bench: Bench) -> Procedure:
    """Let the machine work until the seedlings of two trays are gone; judge its quantities."""
    bench.work.begin()
    plant = bench.module.plant
    begun_ms, switched = bench.now_ms, bench.view.switched.copy()
    counts: dict[str, int] = {}

    def is_done() -> bool:
        if bench.now_ms % 100 == 0:
            counts.update(dict.fromkeys(GONE, 0) | dict(bench.view.counts_of(range(TRIAL_TRAYS))))
        return sum(counts.get(name, 0) for name in GONE) == TRIAL_SEEDLINGS

    limit_ms = 12 * bench.limits.cycle_ms
    yield from bench.until(is_done, limit_ms, f"{TRIAL_SEEDLINGS} seedlings thrown or lost")
    figures = bench.findings.figures
    for name, label in zip(GONE, ("in cups", "P", "D", "T"), strict=True):
        figures[label] = Figure(counts[name])
    figures["trial"] = _seconds_since(bench, begun_ms)
    lost = TRIAL_SEEDLINGS - counts["IN_CUP"]
    missed_cups = sum(plant.missed_cups.values())
    figures["missed cups"] = Figure(missed_cups)
    bench.trial = TrialQuantities(lost, missed_cups, bench.now_ms - begun_ms, bench.view.switched - switched)
    if bench.reference is not None:
        figures["lost by the reference program"] = Figure(bench.reference.lost)
        for name, text in excesses(bench.trial, bench.reference):
            bench.violate(name, text)


def stop(bench: Bench) -> Procedure:
    """Press stop while the machine works; require that it finishes the rows it has begun, and then rests."""
    yield from run(bench)
    bench.findings.mark_ms = bench.now_ms
    rows = bench.view.rows.copy()
    yield from bench.hold("stop", 200)
    yield from rest_after_stop(bench, rows)
    yield from rest(bench, "after stop, before start was pressed")


def rest_after_stop(bench: Bench, rows: Counter[str]) -> Procedure:
    """Wait for the rest after a press of stop; each arm may take the row towards which it moves, and no other.

    Args:
        bench: Bench.
        rows: `MachineView.rows` at the press.
    """
    yield from bench.until(lambda: bench.view.quiet_for(AT_REST_MS), 2 * bench.limits.cycle_ms, "rest after stop")
    for side, more in (bench.view.rows - rows).items():
        if more > 1:
            bench.violate("late stop", f"the {side} arm took {more} rows after the press of stop; 1 is permitted")


def rest(bench: Bench, reason: str, for_ms: int = REST_MS) -> Procedure:
    """Forbid for a time that an actuator is switched on; those that are on now may stay on."""
    bench.forbid(reason, resting=bench.view.on)
    yield from bench.pause(for_ms)
    bench.forbidden = ""


def emergency_stop(situation: OutputSituation, at_ms: int, bench: Bench) -> Procedure:
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


def fault_class(fault: str, bench: Bench) -> Procedure:
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
        yield from home(bench, after_fault=True)
    yield from run(bench)


def margin(bench: Bench) -> Procedure:
    """Increase the dead time until the machine stops, does damage or loses more seedlings; judge the last good one.

    A dead time in both directions has the effect of a scan that is longer by twice this time at most.
    """
    module = bench.module
    if not isinstance(module, BenchModule):
        raise NotRunError("the I/O module has no dead time")
    bench.end_work()
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
            if lost > most(usual_lost) or bench.findings.violations:
                break
            tolerated_ms = dead_time_ms
    finally:
        module.dead_time_ms = 0
    figures["dead time tolerated"] = Figure(tolerated_ms, "ms")
    figures["longer scan tolerated"] = Figure(2 * tolerated_ms, "ms")
    bench.findings.violations.clear()  # of a machine beyond its margin
    if 2 * tolerated_ms < bench.limits.margin_ms:
        raise CaseError(f"tolerates a scan longer by {2 * tolerated_ms} ms only; {bench.limits.margin_ms} ms required")


def work_after_emergency_stop(bench: Bench) -> Procedure:
    """Interrupt the work by the emergency stop, and home; require normal work afterwards."""
    yield from stop_and_clear(bench)
    yield from home(bench)
    yield from run(bench)
    yield from bench.pause(WORK_AGAIN_MS)


def work_after_rest(bench: Bench) -> Procedure:
    """Press stop, and let the machine rest; require normal work afterwards."""
    rows = bench.view.rows.copy()
    yield from bench.hold("stop", 200)
    yield from rest_after_stop(bench, rows)
    yield from rest(bench, "after stop, before start was pressed")
    yield from run(bench)
    yield from bench.pause(WORK_AGAIN_MS)


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


def _silence(bench: Bench, pressed_ms: int) -> str:
    """Return the addition to a message if no actuator has been switched since a press."""
    silent = not _switched_since(bench, pressed_ms)
    return "; no output since the press: the controller may wait for an answer" if silent else ""


def _seconds_since(bench: Bench, begun_ms: int) -> Figure:
    return Figure((bench.now_ms - begun_ms) / 1_000, "s")


def _switched_since(bench: Bench, pressed_ms: int) -> bool:
    return bench.view.changed_ms >= pressed_ms


def _picked_or_homed(bench: Bench, in_tray: int, pressed_ms: int) -> bool:
    return _picked_since(bench, in_tray) or (_switched_since(bench, pressed_ms) and bench.is_home)


def _picked_since(bench: Bench, in_tray: int) -> bool:
    return bench.module.plant.counts().in_tray < in_tray
