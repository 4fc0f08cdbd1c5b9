"""Input terminals of the simulated machine: wires from sensors and push buttons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.common.modbus.io_map import IoMap
from plant_sim.devices.operator_box import OperatorBox
from plant_sim.devices.sensor import Sensor
from plant_sim.machine.kernel import SENSORS, read_sensors

BUTTONS = ("start", "stop", "emergency_stop", "reset", "guard")
"""I/O tags of the push buttons and of the guard, whose contact is a sensor that can fail."""


class Terminals:
    """Input terminals, connected once, so that a scan is fast.

    Attributes:
        levels: Raw levels by X number, as last read from the sensors of the kernel.
        arrays: X numbers and polarities of all sensors in kernel order, and `levels`; see `read_sensors`.
        wired: Tags of the wired inputs.
        optional: Tags of the wired inputs that a machine can run without.
        broken_wires: Tags of the inputs whose terminals are off regardless of their sensors.
        bridged: Levels by X number that are applied to terminals in place of their wires, in order to try something.
    """

    def __init__(self, io_map: IoMap, sensors: Mapping[str, Sensor], box: OperatorBox) -> None:
        """Connect the terminals of an I/O map.

        Args:
            io_map: I/O map.
            sensors: All sensors by I/O tag.
            box: Push buttons.

        Raises:
            ValueError: A wired input is not part of the machine.
        """
        for point in io_map.inputs:
            if point.tag not in sensors and point.tag not in BUTTONS:
                raise ValueError(f"{io_map.path}:{point.line}: {point.tag}: the machine has no such sensor or button")
        points = [io_map.get(tag) for tag in SENSORS]
        numbers = np.array([-1 if point is None else point.number for point in points])
        inverted = np.array([point is not None and point.inverted for point in points])
        self.levels = np.zeros(io_map.input_count, np.bool_)
        self.arrays = (numbers, inverted, self.levels)
        self._number_of = {point.tag: point.number for point in io_map.inputs}
        self.wired = tuple(self._number_of)
        self.optional = frozenset(point.tag for point in io_map.inputs if point.optional)
        self.broken_wires: set[str] = set()
        self.bridged: dict[int, bool] = {}
        self._box = box
        self._buttons = [(tag, io_map[tag].number, io_map[tag].inverted) for tag in BUTTONS if tag in io_map]
        self._contacts = {tag: sensors[tag] for tag in BUTTONS if tag in sensors}
        self._other_sensors = [
            (sensors[point.tag], point.number, point.inverted)
            for point in io_map.inputs
            if point.tag in sensors and point.tag not in (*SENSORS, *BUTTONS)
        ]

    @property
    def has_other_sensors(self) -> bool:
        """True if a sensor is wired that `read_sensors` does not read."""
        return bool(self._other_sensors)

    @property
    def fixed_levels(self) -> list[int]:
        """Raw level of every input that does not depend on motion, by X number; -1 for the others."""
        levels = [-1] * len(self.levels)
        for tag, number, inverted in self._buttons:
            levels[number] = self._pressed(tag) != inverted
        for tag in self.broken_wires:
            levels[self._number_of[tag]] = 0
        for number, level in self.bridged.items():
            levels[number] = int(level)
        return levels

    def _pressed(self, tag: str) -> bool:
        """Return the state of a button, as its contact reports it."""
        pressed: bool = getattr(self._box, tag)
        contact = self._contacts.get(tag)
        if contact is None:
            return pressed
        contact.detect(pressed)
        return contact.read()

    def read(self, state: Any, params: Any) -> list[bool]:
        """Return the raw X image, as a new list.

        Args:
            state: One `MACHINE` record.
            params: One `MACHINE_PARAMS` record.
        """
        read_sensors(state, params, *self.arrays)
        image: list[bool] = self.levels.tolist()
        for tag, number, inverted in self._buttons:
            image[number] = self._pressed(tag) != inverted
        for sensor, number, inverted in self._other_sensors:
            image[number] = sensor.read() != inverted
        for tag in self.broken_wires:
            image[self._number_of[tag]] = False
        for number, level in self.bridged.items():
            image[number] = level
        return image
