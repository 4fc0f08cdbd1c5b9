"""The parts of a machine that a fault can strike, by the names of the targets."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plant_sim.crop.seedling import Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.cups import Cups
from plant_sim.devices.sensor import Sensor
from plant_sim.faults.kind import Breakable

_PORTS = ("plus", "minus")


class Wire:
    """The wire of an input."""

    def __init__(self, broken_wires: set[str], tag: str) -> None:
        """Look at the wire of a tag; the set of all broken ones is the machine's."""
        self._broken_wires = broken_wires
        self._tag = tag

    @property
    def broken(self) -> bool:
        """Whether its terminal is off whatever the sensor says."""
        return self._tag in self._broken_wires

    @broken.setter
    def broken(self, broken: bool) -> None:
        if broken:
            self._broken_wires.add(self._tag)
        else:
            self._broken_wires.discard(self._tag)


class Flags:
    """The flags of a carousel, which its cup counter sees."""

    def __init__(self, cups: Cups, make: Any) -> None:
        """Look at the flags of a carousel and of its record."""
        self._cups = cups
        self._make = make

    @property
    def kinds(self) -> np.ndarray:
        """What each flag is; may be set to such an array, or to what part of them is of which kind, drawn at random."""
        return np.array(self._make["kind"])

    @kinds.setter
    def kinds(self, kinds: np.ndarray | tuple[int, float]) -> None:
        if isinstance(kinds, tuple):
            self._cups.spoil(*kinds)
        else:
            self._make["kind"] = kinds


class Tray:
    """A tray before the run."""

    def __init__(self, seedlings: Seedlings, number: int) -> None:
        """Look at a tray, counted from 0."""
        self._seedlings = seedlings
        self._number = number

    @property
    def empty_cells(self) -> int:
        """How many cells hold no seedling; more of them are drawn at random."""
        return self._seedlings.empty_cells(self._number)

    @empty_cells.setter
    def empty_cells(self, cells: int) -> None:
        self._seedlings.leave_out(self._number, cells - self.empty_cells)


def moved_sensors(machine: Breakable) -> Mapping[str, Sensor]:
    """Every sensor that sees something move or change, by the tag of its wire."""
    return {tag: sensor for tag, sensor in machine.sensors.items() if tag != "magazine_empty"}


def sensors(machine: Breakable) -> Mapping[str, Sensor]:
    """Every sensor, by the tag of its wire."""
    return machine.sensors


def wires(machine: Breakable) -> Mapping[str, Wire]:
    """Every input that has a wire."""
    return {tag: Wire(machine.broken_wires, tag) for tag in machine.wired}


def drives(machine: Breakable, *names: str) -> dict[str, Any]:
    """The records of some drives of both arms."""
    return {
        f"{side}.{name}": make[name]
        for side, make in zip(machine.arms, machine.make[0]["arms"], strict=True)
        for name in names
    }


def cylinders(machine: Breakable) -> Mapping[str, Any]:
    """Every cylinder with its valve."""
    return drives(machine, "slide", "lift", "claws")


def movers(machine: Breakable) -> Mapping[str, Any]:
    """Everything that moves and can stand dead."""
    rest = drives(machine, "spreader", "cups")
    return {**cylinders(machine), **rest, "conveyor": machine.make[0]["conveyor"]}


def chambers(machine: Breakable) -> Mapping[str, Any]:
    """Both ends of every cylinder, each with its throttle."""
    return _ends(cylinders(machine))


def leaky(machine: Breakable) -> Mapping[str, Any]:
    """Everything that holds air under pressure and can have a hole."""
    return {**chambers(machine), "supply": machine.make[0]["air"]["network"]}


def check_valves(machine: Breakable) -> Mapping[str, Any]:
    """Every check valve: two a slide and lift, one of the claws' reservoir."""
    return {**_ends(drives(machine, "slide", "lift")), "claw_reservoir": machine.make[0]["air"]["network"]}


def slides(machine: Breakable) -> Mapping[str, Any]:
    """Both slides."""
    return drives(machine, "slide")


def lifts(machine: Breakable) -> Mapping[str, Any]:
    """Both lifts."""
    return drives(machine, "lift")


def spreaders(machine: Breakable) -> Mapping[str, Any]:
    """Both spreaders."""
    return drives(machine, "spreader")


def regulator(machine: Breakable) -> Mapping[str, Any]:
    """The main regulator."""
    return {"supply": machine.make[0]["air"]["network"]}


def compressor(machine: Breakable) -> Mapping[str, Any]:
    """The compressor."""
    return {"compressor": machine.make[0]["air"]["network"]}


def stepper(machine: Breakable) -> Mapping[str, Any]:
    """The motor of the conveyor."""
    return {"conveyor": machine.make[0]["conveyor"]}


def magazine(machine: Breakable) -> Mapping[str, Conveyor]:
    """The magazine."""
    return {"magazine": machine.conveyor}


def trays(machine: Breakable) -> Mapping[str, Tray]:
    """Every tray, counted from 1."""
    return {f"tray_{number + 1}": Tray(machine.seedlings, number) for number in range(machine.seedlings.trays)}


def flags(machine: Breakable) -> Mapping[str, Flags]:
    """The flags of both carousels, by the tag of the cup counter."""
    makes = drives(machine, "cups")
    return {f"{side}.cup_pulse": Flags(arm.cups, makes[f"{side}.cups"]) for side, arm in machine.arms.items()}


def _ends(makes: Mapping[str, Any]) -> dict[str, Any]:
    """Both ends of some cylinders."""
    return {f"{name}.{port}": make[port] for name, make in makes.items() for port in _PORTS}
