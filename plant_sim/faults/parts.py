"""Parts of a machine that faults can affect, by target name."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plant_sim.crop.seedling import Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.cups import Cups
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.yield_sensors import YieldSensor
from plant_sim.faults.kind import FaultableMachine

_PORTS = ("plus", "minus")


class Wire:
    """Wire of an input."""

    def __init__(self, broken_wires: set[str], tag: str) -> None:
        """Create a view of the wire of a tag; `broken_wires` belongs to the machine."""
        self._broken_wires = broken_wires
        self._tag = tag

    @property
    def broken(self) -> bool:
        """True if the terminal is off regardless of the sensor."""
        return self._tag in self._broken_wires

    @broken.setter
    def broken(self, broken: bool) -> None:
        if broken:
            self._broken_wires.add(self._tag)
        else:
            self._broken_wires.discard(self._tag)


class Flags:
    """Flags of a carousel, which trigger its cup counter."""

    def __init__(self, cups: Cups, params: Any) -> None:
        """Create a view of the flags from a carousel and its parameter record."""
        self._cups = cups
        self._params = params

    @property
    def kinds(self) -> np.ndarray:
        """Kind of each flag; may be set to an array of kinds, or to a kind and a fraction of random flags."""
        return np.array(self._params["kind"])

    @kinds.setter
    def kinds(self, kinds: np.ndarray | tuple[int, float]) -> None:
        if isinstance(kinds, tuple):
            self._cups.set_flag_kinds(*kinds)
        else:
            self._params["kind"] = kinds


class Tray:
    """Tray whose cells can be emptied before the run."""

    def __init__(self, seedlings: Seedlings, number: int) -> None:
        """Create a view of a tray, counted from 0."""
        self._seedlings = seedlings
        self._number = number

    @property
    def empty_cells(self) -> int:
        """Number of cells without a seedling; additional empty cells are chosen at random."""
        return self._seedlings.empty_cells(self._number)

    @empty_cells.setter
    def empty_cells(self, cells: int) -> None:
        self._seedlings.leave_out(self._number, cells - self.empty_cells)


def delayable_sensors(machine: FaultableMachine) -> Mapping[str, Sensor]:
    """Return the sensors whose edges can be delayed, by I/O tag."""
    return {tag: sensor for tag, sensor in machine.sensors.items() if tag not in {"magazine_empty", "guard"}}


def sensors(machine: FaultableMachine) -> Mapping[str, Sensor]:
    """Return all sensors by I/O tag."""
    return machine.sensors


def wires(machine: FaultableMachine) -> Mapping[str, Wire]:
    """Return the wires of all wired inputs."""
    return {tag: Wire(machine.broken_wires, tag) for tag in machine.wired}


def drives(machine: FaultableMachine, *names: str) -> dict[str, Any]:
    """Return the parameter records of the named drives of both arms."""
    return {
        f"{side}.{name}": params[name]
        for side, params in zip(machine.arms, machine.params[0]["arms"], strict=True)
        for name in names
    }


def cylinders(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return all cylinders with their valves."""
    return drives(machine, "slide", "lift", "claws")


def moving_parts(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return all moving parts that can jam."""
    rest = drives(machine, "spreader", "cups")
    return {**cylinders(machine), **rest, "conveyor": machine.params[0]["conveyor"]}


def chambers(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return both ends of every cylinder, with their throttles."""
    return _ends(cylinders(machine))


def pressurised_parts(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return all pressurised parts that can leak."""
    return {**chambers(machine), "supply": machine.params[0]["air"]["network"]}


def check_valves(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return all check valves: two per slide and lift, and that of the claw reservoir."""
    return {**_ends(drives(machine, "slide", "lift")), "claw_reservoir": machine.params[0]["air"]["network"]}


def slides(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return both slides."""
    return drives(machine, "slide")


def lifts(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return both lifts."""
    return drives(machine, "lift")


def spreaders(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return both spreaders."""
    return drives(machine, "spreader")


def regulator(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return the regulators."""
    return {"supply": machine.params[0]["air"]["network"]}


def compressor(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return the compressor."""
    return {"compressor": machine.params[0]["air"]["network"]}


def stepper(machine: FaultableMachine) -> Mapping[str, Any]:
    """Return the stepper motor of the conveyor."""
    return {"conveyor": machine.params[0]["conveyor"]}


def magazine(machine: FaultableMachine) -> Mapping[str, Conveyor]:
    """Return the magazine."""
    return {"magazine": machine.conveyor}


def trays(machine: FaultableMachine) -> Mapping[str, Tray]:
    """Return all trays, counted from 1."""
    return {f"tray_{number + 1}": Tray(machine.seedlings, number) for number in range(machine.seedlings.trays)}


def flags(machine: FaultableMachine) -> Mapping[str, Flags]:
    """Return the flags of both carousels, by the tag of the cup counter."""
    records = drives(machine, "cups")
    return {f"{side}.cup_pulse": Flags(arm.cups, records[f"{side}.cups"]) for side, arm in machine.arms.items()}


def yield_sensors(machine: FaultableMachine) -> Mapping[str, YieldSensor]:
    """Return the optional sensors of held and planted rows, by I/O tag."""
    return {f"{side}.{tag}": each for side, arm in machine.arms.items() for tag, each in arm.yield_sensors.items()}


def _ends(records: Mapping[str, Any]) -> dict[str, Any]:
    """Return both ends of the given cylinders."""
    return {f"{name}.{port}": params[port] for name, params in records.items() for port in _PORTS}
