"""Ways out of every situation: commands that take effect regardless of all other inputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from controller.core.expr import Bit, Expr, Not, all_of, any_of
from controller.core.specification import WayOut
from controller.program.machine import Transplanter
from controller.program.requirements.safety import any_coil
from controller.program.states import HOMED_FROM, State
from controller.program.tags import FULL, SIDES, TAKEN

Presses = Mapping[Bit, bool]


def ways_out(machine: Transplanter) -> tuple[WayOut, ...]:
    """Return the ways out of every situation; they show that no state, step or mode is a dead end.

    An emergency stop leads from any state to Aborted, the clear command leads from there to Stopped, and in Stopped
    every mode and homing can be selected.
    """
    return (
        *_to_stopped(machine),
        *_from_stopped(machine),
        *_to_work(machine),
        *_of_service(machine),
        *_of_rows(machine),
        *_emptying(machine),
    )


class _OperatorPresses:
    """Input levels for single commands: no other command, no fault of link, scan or memory file, and one master."""

    def __init__(self, machine: Transplanter) -> None:
        tags = machine.tags
        x, system = tags.x, tags.system
        optional = (x.optional("reset"), x.optional("guard"))
        buttons = [x.start, x.stop, x.emergency_stop, *(each for each in optional if each is not None)]
        self._nothing = {
            **dict(_terminal(button, active=False) for button in buttons),
            **{command.bit: False for command in tags.commands},
            **dict.fromkeys(
                (
                    system.link_lost,
                    system.scan_fault,
                    system.store_fault,
                    system.panel_silent,
                    system.outputs_taken,
                ),
                False,
            ),
        }

    def off(self) -> Presses:
        """Return the levels when no command is given."""
        return self._nothing

    def press(self, command: Bit) -> Presses:
        """Return the levels when only one command is given."""
        return {**self._nothing, command: True}


def _ordered(machine: Transplanter, name: str, start: Expr, command: Bit, target: State) -> Iterator[WayOut]:
    """Yield the ways from an order to the state in which it is executed.

    With the horn, an order outside manual mode waits for the start warning first.
    """
    tags, operator, begun = machine.tags, _OperatorPresses(machine), _is(machine, target)
    control = tags.machine
    if not tags.warns:
        yield WayOut(name, start, (operator.press(command),), begun)
        return
    waits, over = control.home_waits, control.t_warning.done
    if command is not tags.commands.reset:
        waits, start = control.go_waits, all_of(start, ~control.home_waits, ~control.reset_armed)  # homing goes first
    automatic = start & ~control.manual
    yield WayOut(f"{name}: warning", automatic, ({**operator.press(command), over: False},), waits)
    yield WayOut(name, automatic & waits, ({**operator.off(), over: True},), begun)
    yield WayOut(f"{name}, manual mode", start & control.manual, (operator.press(command),), begun)


def _terminal(condition: Expr, *, active: bool) -> tuple[Bit, bool]:
    """Return the terminal of an input condition and the level that makes it active or inactive."""
    inverted = isinstance(condition, Not)
    bit = condition.operand if isinstance(condition, Not) else condition
    assert isinstance(bit, Bit)  # noqa: S101 - narrows the union for the type checker
    return bit, active is not inverted


def _is(machine: Transplanter, *states: State) -> Expr:
    return any_of(*(machine.tags.machine.state.equals(state) for state in states))


def _stopped(machine: Transplanter) -> Expr:
    """Return the condition of Stopped while no homing is about to begin, by the release of reset or after a warning."""
    control = machine.tags.machine
    stopped = _is(machine, State.STOPPED) & ~control.reset_armed
    return stopped & ~control.home_waits if machine.tags.warns else stopped


def _to_stopped(machine: Transplanter) -> Iterator[WayOut]:
    tags, operator = machine.tags, _OperatorPresses(machine)
    stop = dict([_terminal(tags.x.emergency_stop, active=True)])
    steps = any_of(*(bit for sequence in machine.program.sequences() for bit, _ in sequence))
    dead = all_of(_is(machine, State.ABORTED), ~steps, ~any_coil(tags))
    anywhere = _is(machine, *State)
    yield WayOut("emergency stop: from any state to Aborted, all steps and coils off", anywhere, (stop, stop), dead)
    clear = (operator.press(tags.commands.clear), operator.off())
    yield WayOut("clear: from Aborted to Stopped", _is(machine, State.ABORTED), clear, _is(machine, State.STOPPED))


def _from_stopped(machine: Transplanter) -> Iterator[WayOut]:
    tags, operator = machine.tags, _OperatorPresses(machine)
    stopped = _stopped(machine)
    for mode, command in tags.commands.modes.items():
        wanted = tags.machine.mode.equals(mode)
        yield WayOut(
            f"mode {mode.name.lower()}: selected in Stopped from any mode", stopped, (operator.press(command),), wanted
        )
    unconfirmed = tags.machine.constants_open
    stop = {**operator.off(), **dict([_terminal(tags.x.emergency_stop, active=True)])}
    ready = tags.machine.confirm_ready
    yield WayOut("X25 released: its press confirms the constants", unconfirmed, (operator.off(),), ready | ~unconfirmed)
    yield WayOut(
        "X25 pressed and released: constants confirmed", unconfirmed & ready, (stop, operator.off()), ~unconfirmed
    )
    for state in HOMED_FROM:
        name = f"reset: from {state.name.title()} to Resetting"
        yield from _ordered(machine, name, _is(machine, state) & ~unconfirmed, tags.commands.reset, State.RESETTING)


def _to_work(machine: Transplanter) -> Iterator[WayOut]:
    tags, operator = machine.tags, _OperatorPresses(machine)
    control = tags.machine
    for state, name, command, target in (
        (State.IDLE, "start", tags.commands.start, State.STARTING),
        (State.HELD, "unhold", tags.commands.unhold, State.UNHOLDING),
    ):
        start = all_of(_is(machine, state), machine.orders.free(command))
        title = f"{name}: from {state.name.title()} to {target.name.title()}, arms ready"
        yield from _ordered(machine, title, start, command, target)
    manual = all_of(_is(machine, State.IDLE), control.manual, machine.orders.free(tags.commands.start))
    run = (operator.press(tags.commands.start), operator.off())
    yield WayOut("start: from Idle to jogging in manual mode", manual, run, control.jogging | control.fault)


def _of_service(machine: Transplanter) -> Iterator[WayOut]:
    """Yield the ways to go on with one arm, and back to both."""
    tags, operator = machine.tags, _OperatorPresses(machine)
    for side, arm in tags.arms.items():
        out, back = tags.commands.out_of_service[side], tags.commands.in_service[side]
        stopped = _stopped(machine)
        yield WayOut(
            f"{side} arm: out of service from Stopped, at feed, other arm in service",
            all_of(stopped, arm.at_feed, ~tags.other(side).out_of_service),
            (operator.press(out),),
            arm.out_of_service,
        )
        yield WayOut(f"{side} arm: in service from Stopped", stopped, (operator.press(back),), ~arm.out_of_service)


def _of_rows(machine: Transplanter) -> Iterator[WayOut]:
    """Yield the ways to state that a row of the tray in place is empty."""
    tags, operator = machine.tags, _OperatorPresses(machine)
    for side in SIDES:
        for row, command in tags.commands.row_empty[side].items():
            full = tags.arms[side].rows[row].equals(FULL)
            start = all_of(_is(machine, State.STOPPED), full, machine.orders.free(command), ~tags.machine.motion)
            empty = tags.arms[side].rows[row].equals(TAKEN)
            seen = dict([_terminal(tags.tray.edge, active=True)])
            yield WayOut(
                f"{side} row {row}: stated as empty in Stopped", start, ({**operator.press(command), **seen},), empty
            )


def _emptying(machine: Transplanter) -> Iterator[WayOut]:
    """Yield the way to empty the line: no new row is taken, and the tray leaves once the arms are empty."""
    tags, operator = machine.tags, _OperatorPresses(machine)
    running = all_of(_is(machine, State.EXECUTE), ~tags.machine.manual, ~tags.machine.fault)
    emptying = all_of(tags.machine.emptying, tags.machine.complete_ordered)
    command = tags.commands.empty_line
    yield WayOut("empty_line: no new row from Execute", running, (operator.press(command),), emptying)
