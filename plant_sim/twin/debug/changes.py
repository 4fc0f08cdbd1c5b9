"""Changes of a branch: a terminal, button, command, set-point, device or fault of the twin."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.core.devices import device_name
from controller.debug.machine import OutsideEntry
from controller.program.set_points import SetPointError
from plant_sim.machine.terminals import BUTTONS
from plant_sim.twin.debug.plant_changes import BranchAct, End, fault_begins, fault_ends, level_of
from plant_sim.twin.lock_step import Twin

if TYPE_CHECKING:
    from plant_sim.twin.debug.machine import TwinMachine

_X: Final = re.compile("[Xx][0-7]{1,3}")
_KINDS: Final = "write X1=on, start=on, command=hold, fault=KIND:TARGET, mend=KIND:TARGET, or SET-POINT=NUMBER"


def change_of(twin: Twin, name: str, value: str) -> tuple[OutsideEntry, End | None]:
    """Return the entry that begins a change, and a function that returns the entry that ends it.

    The function is called in the state of the recorded run to which the end returns; None = the change has no end.

    Args:
        twin: The twin.
        name: Terminal (X1), tag of an input, button, set-point, or ``command``, ``fault`` or ``mend``.
        value: Level, number, command, or fault.

    Raises:
        InputError: There is no such change.
    """
    text = f"{name}={value}"
    if name == "command":
        return _command(twin, value, text), None
    if name == "fault":
        return fault_begins(twin.plant, value)
    if name == "mend":
        return fault_ends(twin.plant, value), None
    if name in BUTTONS and name in twin.io_map:
        return _button(twin, name, text, level=level_of(name, value))
    if _X.fullmatch(name) or (name in twin.io_map and twin.io_map[name].device == "X"):
        number, level = _terminal(twin, name, text, level=level_of(name, value))
        return _bridge(number, text, level=level)
    return _set_point(twin, name, value, text)


def _command(twin: Twin, value: str, text: str) -> OutsideEntry:
    try:
        twin.machine.tags.commands[value]
    except KeyError:
        known = [command.name for command in twin.machine.tags.commands]
        raise InputError(f"{text}: no such command; {suggestion(value, known)}") from None

    def order(machine: TwinMachine) -> None:
        machine.twin.command(value)

    return BranchAct(text, order)


def _button(twin: Twin, name: str, text: str, *, level: bool) -> tuple[OutsideEntry, End]:
    def press(machine: TwinMachine) -> None:
        machine.twin.releases.pop(name, None)
        setattr(machine.plant.box, name, level)

    def recorded() -> OutsideEntry:
        before, release_ms = getattr(twin.plant.box, name), twin.releases.get(name)

        def let_go(machine: TwinMachine) -> None:
            setattr(machine.plant.box, name, before)
            if release_ms is not None:
                machine.twin.releases[name] = release_ms

        return BranchAct(f"end of {text}", let_go)

    return BranchAct(text, press), recorded


def _bridge(number: int, text: str, *, level: bool) -> tuple[OutsideEntry, End]:
    def bridge(machine: TwinMachine) -> None:
        machine.plant.terminals.bridged[number] = level

    def remove(machine: TwinMachine) -> None:
        machine.plant.terminals.bridged.pop(number, None)

    return BranchAct(text, bridge), lambda: BranchAct(f"end of {text}", remove)


def _set_point(twin: Twin, name: str, value: str, text: str) -> tuple[OutsideEntry, End]:
    set_points = twin.machine.tags.sp
    try:
        word, number = set_points.checked(name, value)
    except SetPointError as error:
        raise InputError(f"{text}: {error}; {_KINDS}") from None
    if word in set_points.constants:
        raise InputError(f"{text}: a machine constant does not change during a run; record another run with --set")

    def setting(number: int) -> Callable[[TwinMachine], None]:
        return lambda machine: machine.twin.plc.write(word, number)

    def recorded() -> OutsideEntry:
        return BranchAct(f"end of {text}", setting(twin.plc.read(word)))

    return BranchAct(text, setting(number)), recorded


def _terminal(twin: Twin, name: str, text: str, *, level: bool) -> tuple[int, bool]:
    """Return the X number and the raw level of a terminal."""
    point = twin.io_map.get(name)
    if point is not None and point.device == "X":
        return point.number, level != point.inverted
    number = int(name[1:], 8)
    if number >= twin.io_map.input_count:
        last = device_name("X", twin.io_map.input_count - 1)
        raise InputError(f"{text}: the machine has no such terminal; choose one from X0 to {last}")
    return number, level
