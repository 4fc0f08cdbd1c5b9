"""Presses at the wrong time, and long rests of a machine that nobody has started.

A machine moves after a fresh press of start and after nothing else. A press of stop, a broken wire of a normally closed
contact and the emergency stop have precedence over start.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator
from functools import partial
from typing import Final

from plant_sim.hil.answers import answer
from plant_sim.hil.bench import Bench
from plant_sim.hil.cases import (
    AT_REST_MS,
    REST_MS,
    WARNING_MS,
    Case,
    home,
    press_start,
    rest,
    rest_after_stop,
    stop_and_clear,
)
from plant_sim.hil.procedure import NotRunError, Procedure, Wait
from plant_sim.hil.selection import EDGE, PRESS, REST

HOMING_MS: Final = (100, 500, 1_500, 4_000)
"""Times after the press of start at which homing is interrupted by the emergency stop, ms."""
FIRST_CYCLE_MS: Final = (200, 1_500, 3_000, 5_000, 8_000)
"""Times after the press of start at which the first cycle is interrupted by the emergency stop, ms."""
HELD_MS: Final = 3_000
"""Time for which an emergency stop is held before something is pressed, ms."""
NO_AIR: Final = "low_supply:supply=0MPa"
HORN: Final = "horn"
LEAST_WARNING_MS: Final = 2_000
"""Shortest time from the first pulse of the horn to the first motion, ms (ADR 62)."""
LONGEST_PULSE_MS: Final = 1_500
"""Longest pulse of a start warning, ms: a longer tone is that of an alarm (assumed)."""


def press_cases() -> Iterator[Case]:
    """Return the cases of presses at the wrong time."""
    yield Case(PRESS, "clear and start under a held emergency stop", press_under_emergency_stop, starts=True)
    yield Case(PRESS, "start held while the emergency stop is released and cleared", hold_start_and_clear, starts=True)
    yield Case(PRESS, "start while homing", start_while_homing, starts=True)
    yield Case(PRESS, "stop while homing", stop_while_homing, starts=True)
    yield Case(PRESS, "a start contact that sticks", stuck_start, starts=True)
    yield Case(PRESS, "start with stop held", start_with_stop_held, starts=True)
    yield Case(PRESS, "start held while the air returns", hold_start_and_return_air, starts=True)
    yield Case(PRESS, "broken wire of stop", break_stop, starts=True)
    yield Case(PRESS, "broken wire of the emergency stop", break_emergency_stop, starts=True)


def warning_cases(bench: Bench) -> Iterator[Case]:
    """Return the case of the start warning; none without a horn."""
    if HORN in bench.module.plant.indicators:
        yield Case(PRESS, "start warning before the first motion", start_warning, starts=True)


def first_motion_cases() -> Iterator[Case]:
    """Return an emergency stop at several times of homing and of the first cycle."""
    for after_ms in HOMING_MS:
        yield Case(EDGE, f"homing, {after_ms} ms after start", partial(interrupt_homing, after_ms), starts=True)
    for after_ms in FIRST_CYCLE_MS:
        yield Case(
            EDGE, f"first cycle, {after_ms} ms after start", partial(interrupt_first_cycle, after_ms), starts=True
        )


def rest_cases() -> Iterator[Case]:
    """Return one long watch for every kind of rest; those of power-up and stop belong to the cases of these names."""
    yield Case(REST, "emergency stop held", rest_held, starts=True)
    yield Case(REST, "emergency stop released", rest_released, starts=True)
    yield Case(REST, "emergency stop cleared", rest_cleared, starts=True)
    yield Case(REST, "homed", rest_homed, starts=True)
    yield Case(REST, "after a fault and its repair", rest_after_fault, starts=True)


# --- presses


def press_under_emergency_stop(bench: Bench) -> Procedure:
    """Clear and start while the emergency stop is pressed, and start before clearing; nothing may switch on."""
    bench.press_emergency_stop()
    yield from bench.pause(HELD_MS)
    yield from _clear_and_start(bench)
    bench.release_emergency_stop()
    yield from bench.hold("start", 200)
    yield from bench.pause(HELD_MS)
    yield from _clear_and_home(bench)


def hold_start_and_clear(bench: Bench) -> Procedure:
    """Hold start from before the release of the emergency stop until after clearing; it is no fresh press."""
    bench.press_emergency_stop()
    yield from bench.pause(HELD_MS)
    bench.module.plant.box.start = True
    yield from bench.pause(1_000)
    bench.release_emergency_stop()
    yield from bench.pause(HELD_MS)
    yield from bench.hold("stop", bench.limits.clear_ms)
    yield from bench.pause(HELD_MS)
    bench.module.plant.box.start = False
    yield from bench.pause(HELD_MS)
    yield from _clear_and_home(bench)


def start_warning(bench: Bench) -> Procedure:
    """Press start at rest; require pulses of the horn for 2 s before the first motion, and that a stop cancels them."""
    yield from _ready_to_home(bench)
    lit, reason = bench.module.plant.indicators, "before a start warning of 2 s"
    for is_cancelled in (True, False):
        bench.forbid(reason, resting=bench.view.on)
        bench.module.plant.box.start = True
        yield from bench.until(lambda: lit[HORN], WARNING_MS, "horn after a press of start")
        begun_ms = bench.now_ms
        yield from bench.until(lambda: not lit[HORN], LONGEST_PULSE_MS, "end of the first pulse of the horn")
        bench.release_buttons()
        yield from bench.pause(begun_ms + LEAST_WARNING_MS // (2 if is_cancelled else 1) - bench.now_ms)
        if is_cancelled:
            bench.forbid("after a stop in the start warning", resting=bench.view.on)
            yield from bench.hold("stop", 200)
            yield from bench.pause(HELD_MS)
    bench.forbidden = ""
    yield from bench.until(lambda: bool(bench.view.on), WARNING_MS, "motion after the start warning")
    yield from _require_home(bench)


def start_while_homing(bench: Bench) -> Procedure:
    """Press start again while the machine homes; require that it homes, and then rests."""
    rows = yield from _press_while_homing("start", bench)
    yield from _require_home(bench)
    yield from rest(bench, "after a press of start while homing", AT_REST_MS)
    _forbid_rows_since(rows, bench, "after a press of start while homing")


def stop_while_homing(bench: Bench) -> Procedure:
    """Press stop while the machine homes; require that it rests, and takes no seedlings."""
    rows = yield from _press_while_homing("stop", bench)
    yield from rest_after_stop(bench, rows)
    _forbid_rows_since(rows, bench, "after a press of stop while homing")
    yield from home(bench)


def stuck_start(bench: Bench) -> Procedure:
    """Hold start for a minute; require that the machine homes at most, and that the release moves nothing."""
    rows = yield from _ready_to_home(bench)
    yield from bench.hold("start", REST_MS)
    _forbid_rows_since(rows, bench, "by one press of start that lasted a minute")
    yield from rest(bench, "after the release of start", HELD_MS)
    yield from home(bench)


def start_with_stop_held(bench: Bench) -> Procedure:
    """Press start while stop is held, with the arms away from their places; require that nothing switches on."""
    yield from stop_and_clear(bench)
    bench.forbid("by start while stop was held", resting=bench.view.on)
    bench.module.plant.box.stop = True
    yield from bench.pause(500)
    yield from bench.hold("start", 200)
    yield from bench.pause(500)
    bench.module.plant.box.stop = False
    yield from bench.pause(HELD_MS)
    yield from home(bench)


def hold_start_and_return_air(bench: Bench) -> Procedure:
    """Take the air away until the machine rests, and let it return while start is held; it is no fresh press."""
    bench.set_fault(NO_AIR)
    yield from _rest_or_not_run(bench)
    bench.forbidden = ""
    bench.module.plant.box.start = True
    yield from bench.pause(HELD_MS)
    rested = "rest without air, with start held"
    yield from bench.until(lambda: bench.view.quiet_for(AT_REST_MS), bench.limits.home_ms, rested)
    bench.forbid("by the return of the air while start was held", resting=bench.view.on)
    bench.repair()
    yield from bench.pause(HELD_MS)
    bench.module.plant.box.start = False
    yield from bench.pause(HELD_MS)
    yield from _clear_and_home(bench, after_fault=True)


def break_stop(bench: Bench) -> Procedure:
    """Break the wire of stop; require the rest of a stop, and no motion by start before or after the repair."""
    rows = bench.view.rows.copy()
    bench.set_fault("broken_wire:stop")
    yield from rest_after_stop(bench, rows)
    bench.forbid("with the wire of stop broken", resting=bench.view.on)
    yield from bench.hold("start", 200)
    yield from bench.pause(HELD_MS)
    bench.repair()
    yield from bench.pause(HELD_MS)
    yield from _clear_and_home(bench)


def break_emergency_stop(bench: Bench) -> Procedure:
    """Break the wire of the emergency stop; require that it acts as a press that is held."""
    bench.set_fault("broken_wire:emergency_stop")
    bench.expect_off()
    yield from bench.pause(HELD_MS)
    yield from _clear_and_start(bench)
    bench.repair()
    bench.forbid_start()
    yield from bench.pause(HELD_MS)
    yield from _clear_and_home(bench)


# --- emergency stop in the first motions


def interrupt_homing(after_ms: int, bench: Bench) -> Procedure:
    """Press the emergency stop at a time of homing."""
    yield from _ready_to_home(bench)
    yield from _start_and_interrupt(bench, after_ms)


def interrupt_first_cycle(after_ms: int, bench: Bench) -> Procedure:
    """Press the emergency stop at a time of the first cycle."""
    yield from stop_and_clear(bench)
    yield from home(bench)
    yield from _start_and_interrupt(bench, after_ms)


def _start_and_interrupt(bench: Bench, after_ms: int) -> Procedure:
    bench.module.plant.box.start = True
    yield from bench.pause(min(after_ms, 200))
    bench.module.plant.box.start = False
    yield from bench.pause(max(0, after_ms - 200))
    yield from bench.reached(lambda: bool(bench.view.on), bench.limits.begin_ms)  # a loaded arm may wait for cups
    yield from stop_and_clear(bench)
    yield from home(bench)


# --- rests


def rest_held(bench: Bench) -> Procedure:
    """Hold the emergency stop."""
    bench.press_emergency_stop()
    yield from bench.pause(REST_MS)
    bench.release_emergency_stop()
    yield from _clear_and_home(bench)


def rest_released(bench: Bench) -> Procedure:
    """Release the emergency stop and do not clear it."""
    bench.press_emergency_stop()
    yield from bench.pause(HELD_MS)
    bench.release_emergency_stop()
    yield from bench.pause(REST_MS)
    yield from _clear_and_home(bench)


def rest_cleared(bench: Bench) -> Procedure:
    """Clear the emergency stop and do not press start."""
    yield from stop_and_clear(bench)
    yield from bench.pause(REST_MS)
    yield from home(bench)


def rest_homed(bench: Bench) -> Procedure:
    """Home and do not press start again."""
    yield from stop_and_clear(bench)
    yield from home(bench)
    yield from rest(bench, "after homing, before start was pressed")


def rest_after_fault(bench: Bench) -> Procedure:
    """Repair a fault that has stopped the machine, and press nothing."""
    bench.set_fault("jammed:right.lift")
    yield from _rest_or_not_run(bench)
    bench.forbid("after the repair, before start was pressed", resting=bench.view.on)
    bench.repair()
    yield from bench.pause(REST_MS)
    yield from _clear_and_home(bench, after_fault=True)


# --- parts


def _press_while_homing(button: str, bench: Bench) -> Generator[Wait, bool, Counter[str]]:
    """Press start, and a button while the machine homes; return `MachineView.rows` at the press of start."""
    rows = yield from _ready_to_home(bench)
    yield from press_start(bench)
    yield from bench.pause(800)
    yield from bench.hold(button, 200)
    return rows


def _ready_to_home(bench: Bench) -> Generator[Wait, bool, Counter[str]]:
    """Press and clear the emergency stop, and answer what the next press of start asks; the one after it homes.

    Returns:
        `MachineView.rows` before this press.
    """
    yield from stop_and_clear(bench)
    bench.forbidden = ""
    if (yield from press_start(bench)):
        yield from stop_and_clear(bench)  # a controller that asks nothing
        bench.forbidden = ""
    else:
        yield from answer(bench)
    return bench.view.rows.copy()


def _clear_and_start(bench: Bench) -> Procedure:
    """Hold stop as for clearing, and press start twice, as to home and to start."""
    yield from bench.hold("stop", bench.limits.clear_ms)
    for _ in range(2):
        yield from bench.hold("start", 200)
        yield from bench.pause(HELD_MS)


def _clear_and_home(bench: Bench, *, after_fault: bool = False) -> Procedure:
    yield from bench.hold("stop", bench.limits.clear_ms)
    yield from bench.pause(1_000)
    yield from home(bench, after_fault=after_fault)


def _require_home(bench: Bench) -> Procedure:
    yield from bench.until(lambda: bench.is_home, bench.limits.home_ms, "both arms at feed")


def _rest_or_not_run(bench: Bench) -> Procedure:
    """Wait until the machine rests after a fault.

    Raises:
        NotRunError: The machine goes on.
    """
    if not (yield from bench.reached(lambda: bench.view.quiet_for(AT_REST_MS), 2 * bench.limits.cycle_ms)):
        raise NotRunError("the machine does not stop for the fault")


def _forbid_rows_since(before: Counter[str], bench: Bench, reason: str) -> None:
    if rows := (bench.view.rows - before).total():
        bench.violate("unexpected start", f"{rows} rows taken {reason}")
