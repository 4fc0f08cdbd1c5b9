"""Specification of the machine: requirements, the invariants that support them, and a way out of every situation."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from functools import partial

from controller.core.expr import FALSE, Expr, Word, all_of, any_of
from controller.core.program import Program
from controller.core.sequence import Sequence
from controller.core.specification import ComputedProperty, Invariant, PropertyResult, Requirement, Specification
from controller.program.machine import Transplanter
from controller.program.places import devices
from controller.program.requirements.limits import assumptions, limits
from controller.program.requirements.positions import PositionMonitor
from controller.program.requirements.presses import of_presses
from controller.program.requirements.safety import ArmMonitor, Safety
from controller.program.requirements.time_limit import bounded
from controller.program.requirements.travel_times import MachineData, fits
from controller.program.requirements.ways_out import ways_out
from controller.program.states import MOVING, RUNNING, Mode, State
from controller.program.tags import FORGOTTEN, IN_PLACE, IN_PROGRESS, NO_TRAY, ROWS, SIDES, TAKEN, Side

_NAMES = {"lift": ("down", "up"), "slide": ("feed", "pick 1", "pick 2", "pick 3"), "belt": ("spread", "converged")}


def specification(machine: Transplanter, data: MachineData | None = None) -> Specification:
    """Return the specification to be proved for the machine's program.

    Args:
        machine: Program of the machine.
        data: Data of the machine; None = those of the delivered one.
    """
    data = data or MachineData()
    tags = machine.tags
    safety = Safety(machine, busy_steps(machine))
    invariants = dict(_of_machine(machine, safety))
    for side in SIDES:
        of_arm = _of_arm(machine, side, safety.arms[side])
        invariants |= {f"{side}: {name}": holds for name, holds in of_arm.items()}
    return Specification(
        program=machine.program,
        monitors=safety.monitors,
        remembered=safety.remembered,
        requirements=(*safety.requirements, *of_presses(machine), _of_limits(machine)),
        invariants=tuple(Invariant(name, holds) for name, holds in invariants.items()),
        ways_out=ways_out(machine),
        ranges=tags.sp.limits,
        assumptions=assumptions(data.times),
        limits=tuple(limits(tags, safety)),
        checks=_checks(machine, data),
    )


def busy_steps(machine: Transplanter) -> Expr:
    """Return the condition that a step moves something or lasts a fixed time; other steps wait for an event."""
    steps = (row for sequence in machine.program.sequences() for row in sequence)
    return any_of(*(bit for bit, step in steps if step.hold or step.dwell is not None))


def _checks(machine: Transplanter, data: MachineData) -> tuple[ComputedProperty, ...]:
    """Return the checks of the times of the program, that homing ends, and that it arrives in Idle."""

    def arrives() -> PropertyResult:
        from controller.program.requirements.homing import explored  # noqa: PLC0415 - requires llvmlite

        return explored(machine, data.times)

    def timed(program: Program) -> PropertyResult:
        return fits(program, machine.tags, data)

    rests_on = tuple(name for name, _ in _homing_ends(machine))
    return (
        ComputedProperty("times fit the machine", partial(timed, machine.program), of_program=timed),
        ComputedProperty("homing ends within T", partial(bounded, machine), rests_on),
        ComputedProperty("homing arrives in Idle", arrives, explores=True),
    )


def _of_limits(machine: Transplanter) -> Requirement:
    """Return the requirement that a step whose time limit has elapsed has its alarm, as long as the step lasts."""
    watches = [
        (bit, step.watch)
        for sequence in machine.program.sequences()
        for bit, step in sequence
        if step.watch is not None
    ]
    return Requirement(
        "a time limit elapsed without its alarm",
        "a step that takes longer than its device can is reported as long as it lasts",
        any_of(*(bit & watch.timer.done & ~watch.alarm for bit, watch in watches)),
    )


def _implies(one: Expr, other: Expr) -> Expr:
    return ~one | other


def _one_of(word: Word, values: Iterable[int]) -> Expr:
    return any_of(*(word.equals(value) for value in values))


def _of_machine(machine: Transplanter, safety: Safety) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants about machine states, register values and steps."""
    tags = machine.tags
    control = tags.machine
    yield "the state is a PackML state", _one_of(control.state, State)
    yield "the mode is valid", _one_of(control.mode, Mode)
    yield "the tray phase is valid", _one_of(tags.tray.phase, range(5))
    rows = [row for arm in tags.arms.values() for row in arm.rows.values()]
    yield "every row state is valid", all_of(*(_one_of(row, range(4)) for row in rows))
    yield "motion is allowed only in moving states", _implies(control.motion, _one_of(control.state, MOVING))
    yield (
        "the resetting relay is on only in Resetting",
        _implies(control.resetting, control.state.equals(State.RESETTING)),
    )
    yield "the resetting relay is on in Resetting", _implies(control.state.equals(State.RESETTING), control.resetting)
    for sequence in machine.program.sequences():
        bits = [bit for bit, _ in sequence]
        yield f"{sequence.name}: one step at a time", all_of(*(~(a & b) for a, b in itertools.combinations(bits, 2)))
    guarded = tags.x.guard_open is not FALSE
    ends = all_of(control.state.equals(State.STOPPING), control.guard_open) if guarded else FALSE  # for one scan
    yield "moving states allow motion", _implies(_one_of(control.state, MOVING), control.motion | ends)
    moved = safety.machine.moved
    yield "the monitor records that motion is allowed", _implies(control.motion, moved)
    yield "the monitor records the jog", _implies(control.jog.differs(0), safety.machine.jogged)
    yield from _of_presses(machine, safety)
    yield "the manual relay is on only in manual mode", _implies(control.manual, control.mode.equals(Mode.MANUAL))
    yield "the manual relay is on in manual mode", _implies(control.mode.equals(Mode.MANUAL), control.manual)
    zero_return = control.mode.equals(Mode.ZERO_RETURN)
    yield "the machine does not run in zero return mode", _implies(_one_of(control.state, RUNNING), ~zero_return)
    jogs = control.mode.equals(Mode.MANUAL) & control.state.equals(State.EXECUTE)
    yield "jogging is active only in manual mode and Execute", _implies(control.jogging, jogs)
    steps = [_any_step(sequence) for sequence in machine.program.sequences()]
    yield "no step is active in manual mode", _implies(control.mode.equals(Mode.MANUAL), ~any_of(*steps))
    yield "tray feeder: steps are active only in moving states", _implies(_any_step(machine.feeder), control.motion)
    yield from (*_of_guard(machine, safety), *_of_warning(machine, safety), *safety.declaration.records())
    yield from _of_tray(machine)
    in_place = tags.tray.phase.equals(IN_PLACE)
    for side in SIDES:
        over_tray = ("approach row", "settle at row", "return to row", "close claws")
        arm, cycle = tags.arms[side], machine.cycles[side]
        over = any_of(*(cycle[title] for title in over_tray))
        left = any_of(*(row.differs(TAKEN) for row in arm.rows.values()))
        yield f"{side} arm: picks only from a tray in place with a row left", _implies(over, in_place & left)
        empty = over & ~cycle["close claws"]
        yield f"{side} arm: moves in only when empty", _implies(empty, ~arm.loaded)
        slide = arm.coils["slide_inward"] | arm.coils["slide_outward"]
        yield f"{side} arm: closes its claws only with the slide at rest", _implies(cycle["close claws"], ~slide)
    for side in SIDES:
        cycle, home = machine.cycles[side], machine.homings[side]
        moves = all_of(control.motion, ~control.resetting)
        arm, active = tags.arms[side], any_of(_any_step(cycle), _any_step(home))
        yield f"{cycle.name}: no step is active while out of service", _implies(arm.out_of_service, ~active)
        busy = any_of(*(bit for bit, step in cycle if step.title not in {"wait at feed", "parked"}))
        yield (
            f"{cycle.name}: a cycle in progress is recorded, or has its permit",
            _implies(busy, arm.cycling | arm.permit),
        )
        yield (
            f"{cycle.name}: steps are active only in moving states except Resetting",
            _implies(_any_step(cycle), moves),
        )
        yield f"{home.name}: steps are active only in Resetting", _implies(_any_step(home), control.resetting)
    yield from _homing_ends(machine)


def _of_guard(machine: Transplanter, safety: Safety) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants about an open guard, after which the machine waits for a fresh order; none without guard."""
    tags = machine.tags
    if tags.x.guard_open is FALSE:
        return
    waits = safety.machine.after_guard
    steps = [_any_step(sequence) for sequence in machine.program.sequences()]
    working = _one_of(tags.machine.state, {*MOVING, State.IDLE} - {State.STOPPING})
    yield "an open guard ends all steps", _implies(waits, ~any_of(*steps))
    yield "after an open guard, the machine waits for an order", _implies(waits, ~working)
    yield from safety.guarded_presses.records()


def _of_warning(machine: Transplanter, safety: Safety) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants about orders that wait for the start warning; none without the horn."""
    tags, control, monitor = machine.tags, machine.tags.machine, safety.machine
    if not tags.warns:
        return
    suspended = control.state.equals(State.SUSPENDED)
    ends = _one_of(control.state, (State.STOPPING, State.HOLDING))
    waits = control.home_waits | control.go_waits
    yield "an order that waits was given", _implies(waits, monitor.ordered)
    yield "an order that waits was given after the guard closed", _implies(waits, ~monitor.after_guard)
    yield (
        "without a warning, the machine rests, stops or stands in Suspended",
        _implies(monitor.unwarned & ~control.manual, any_of(~control.motion, ends, suspended)),
    )
    yield (
        "in Suspended without a warning, all steps wait",
        _implies(all_of(monitor.unwarned, ~control.manual, suspended), ~busy_steps(machine)),
    )


def _of_tray(machine: Transplanter) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants about the tray in place and the tray being fed."""
    tags = machine.tags
    control = tags.machine
    in_place = tags.tray.phase.equals(IN_PLACE)
    feeding = any_of(
        *(machine.feeder[title] for title in ("move tray out", "index", "tray in the gap", "creep", "no tray"))
    )
    yield (
        "a tray is fed only after its question is answered",
        _implies(feeding | machine.feeder["settle"], ~tags.tray.ask),
    )
    yield (
        "a tray being fed is not in place",
        _implies(any_of(feeding, tags.tray.t_jam.done, tags.tray.met), ~in_place),
    )
    forgotten = tags.tray.phase.equals(FORGOTTEN)
    yield "a tray that is unknown has no time of leaving", _implies(forgotten, tags.tray.exit_time.equals(0))
    yield (
        "without motion, no tray arrives unexpectedly",
        _implies(~control.motion, ~(tags.tray.met | tags.tray.t_jam.done)),
    )
    settle = machine.feeder["settle"]
    ends = _one_of(control.state, (State.STOPPING, State.HOLDING))  # with the alarm of a lost tray
    yield "a tray that has arrived is in a known place", _implies(settle & in_place, tags.tray.place_known | ends)
    yield "a tray that is ready is in a known place", _implies(tags.tray.ready & in_place, tags.tray.place_known)
    lost = all_of(_one_of(control.state, RUNNING), control.fault)
    yield "a tray that is lost while the machine runs stops it", _implies(tags.tray.t_lost.done, lost)
    working = ~control.manual & _one_of(control.state, (State.IDLE, *RUNNING))
    yield "work is done on a tray whose place is known", _implies(working & in_place, tags.tray.place_known)


def _of_presses(machine: Transplanter, safety: Safety) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants that relate armed presses to the buttons."""
    control, monitor = machine.tags.machine, safety.machine
    belt = machine.tags.tray.driven["tray_forward"]
    yield (
        "the monitor records that the belt is driven",
        _implies(belt & ~control.mode.equals(Mode.MANUAL), monitor.tray_fed),
    )
    yield "a tray whose place is known was fed or confirmed", _implies(machine.tags.tray.place_known, monitor.tray_fed)
    yield "a press that may clear is one of X24", _implies(control.clear_armed, monitor.stop_on)
    yield "a press that may reset is one of the reset button", _implies(control.reset_armed, monitor.reset_on)
    yield "a press that confirms the constants is one of X25", _implies(control.confirming, monitor.emergency_on)
    yield "constants that are not confirmed are open", _implies(monitor.unconfirmed, control.constants_open)


def _homing_ends(machine: Transplanter) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants by which homing has no wait without a limit or a question; see `time_limit`."""
    tags = machine.tags
    control, tray, wait = tags.machine, tags.tray, machine.feeder["wait for an empty tray"]
    for side in SIDES:
        home = machine.homings[side]
        homes = all_of(control.resetting, ~control.manual, ~tags.arms[side].out_of_service)
        yield f"{home.name}: a step is active", _implies(homes, _any_step(home))
        yield f"{home.name}: waits only for an answer", _implies(home["decide"], tags.arms[side].ask)
    jam, lost = machine.alarms.tray_jam, machine.alarms.tray_lost
    yield "a tray in the wrong place has its alarm", _implies(any_of(tray.met, tray.t_jam.done, tray.overdue), jam)
    unknown = all_of(control.resetting, ~control.manual, _one_of(tray.phase, (NO_TRAY, FORGOTTEN)))
    yield "an unknown tray is asked about in homing", _implies(unknown, any_of(tray.ask, jam, lost))
    yield (
        "tray feeder: a permitted motion of homing begins at once",
        _implies(all_of(control.resetting, wait, tray.permit), any_of(tray.phase.equals(IN_PLACE), jam, lost)),
    )


def _any_step(sequence: Sequence) -> Expr:
    return any_of(*(bit for bit, _ in sequence))


def _of_arm(machine: Transplanter, side: Side, monitor: ArmMonitor) -> dict[str, Expr]:
    """Return the invariants that relate the program memory of one arm to the effect of its coils."""
    a, cycle, home = machine.tags.arms[side], machine.cycles[side], machine.homings[side]
    in_progress = any_of(*(a.rows[row].equals(IN_PROGRESS) for row in ROWS))
    discarding = home["discard, spread"] | home["discard, lower"]
    working = any_of(*(bit for bit, step in cycle if step.title not in {"wait at feed", "parked"}))
    driven = a.coils["slide_inward"] | a.coils["slide_outward"]
    return {
        "claws that are not closed are open": _implies(~a.claws_closed, monitor.open),
        "claws that may hold seedlings count as loaded": _implies(monitor.holds, a.loaded),
        "loaded claws are closed": _implies(a.loaded, a.claws_closed),
        "claws that have gripped are closed": _implies(a.clamped, a.claws_closed),
        "a discard is of a load": _implies(a.discard, a.loaded),
        "the monitor records cycles, rows and tray": monitor.counts.records(),
        "claws known to the monitor are known": _implies(monitor.counts.known, a.claws_known),
        "clamped claws have closed for their dwell time": _implies(a.clamped, monitor.gripped),
        "with claws closed at a row, the slide has not moved": _implies(a.on_row, monitor.unmoved),
        "the slide has not left a row in progress": _implies(in_progress & monitor.holds, monitor.unmoved | driven),
        **dict(_of_positions(machine, side, monitor.positions)),
        "an arrival at the next row is stored": _implies(monitor.arrived, a.passed),
        "the release delay of a load starts only after a cup": _implies(
            cycle["release delay"], monitor.released | ~monitor.holds
        ),
        "in the cycle, loaded claws open only after a cup": _implies(
            cycle["open claws"] & a.coils["claws_open"], monitor.released | ~monitor.holds
        ),
        "a load is discarded only by command": _implies(a.discard, monitor.discarded),
        "discard steps with a load follow a discard command": _implies(discarding, a.discard | ~a.loaded),
        "an arm moving out low is empty": _implies(home["out low"], ~a.loaded),
        "homing opens loaded claws at feed only to discard": _implies(home["open at feed"], a.discard | ~a.loaded),
        "an arm in the centre is known to be there, or is neither home nor cycling": _implies(
            monitor.in_centre, a.in_centre | ~any_of(a.at_feed, a.cycling, working)
        ),
    }


def _of_positions(machine: Transplanter, side: Side, monitor: PositionMonitor) -> Iterator[tuple[str, Expr]]:
    """Yield the invariants that relate the confirmed places of an arm to the places where it certainly is."""
    a = machine.tags.arms[side]
    for device in devices(a):
        travelled = {"lift": a.lift_travelled, "slide": a.slide_travelled, "belt": a.belt_travelled}[device.name]
        last = [place.was_here for place in device.places.values()]
        yield f"the {device.name} has one last place", all_of(*(~(p & q) for p, q in itertools.combinations(last, 2)))
        yield (
            f"the {device.name} is under way only between places",
            _implies(a.under_way[device.name] & device.coils, monitor.between[device.name]),
        )
        for name, place in zip(_NAMES[device.name], device.places.values(), strict=True):
            if place.towards is None:
                passing = _implies(place.reached & place.away, a.under_way[device.name])
                yield f"a driven slide passes the row it has reached: {name}", passing
            yield (
                f"the device is certainly at a place it has reached: {name}",
                _implies(place.reached, monitor.verified[name]),
            )
            passing = monitor.between[device.name] if place.towards is None else FALSE
            yield (
                f"no coil has driven away from a place that is reached: {name}",
                _implies(place.reached & monitor.driven_away(name), passing),
            )
            yield f"the last place is near: {name}", _implies(monitor.near[name], place.was_here & ~travelled)
    yield "the time between rows has not elapsed near a row", _implies(a.slide_hopped, ~monitor.near_row)
    for coil, on in monitor.driven.items():
        yield f"the monitor records the coil: {coil}", _implies(a.coils[coil], on) & _implies(on, a.coils[coil])
