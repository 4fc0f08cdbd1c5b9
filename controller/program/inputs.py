"""Inputs of the program: conditions on the X terminals, and the relays that the runtime writes before a scan."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap, Point
from controller.core.expr import FALSE, Bit, Expr
from controller.program.areas import Area


class Inputs:
    """Conditions on the X terminals: true while the point is active, regardless of the wiring polarity."""

    def __init__(self, io_map: IoMap) -> None:
        self._map = io_map
        self.start = self["start"]
        self.stop = self["stop"]
        self.emergency_stop = self["emergency_stop"]
        self.tray_front_edge = self["tray_front_edge"]
        self.guard_open = FALSE if io_map.get("guard") is None else self["guard"]
        """Condition that the guard is open; never true without the input."""

    def __getitem__(self, tag: str) -> Expr:
        __tracebackhide__ = True
        return _condition(self._map[tag])

    def optional(self, tag: str) -> Expr | None:
        """Return the condition of an optional input, or None if it is not wired."""
        point = self._map.get(tag)
        return None if point is None else _condition(point)

    def optional_off(self, tag: str) -> Expr | None:
        """Return the condition that an optional input is not active, or None if it is not wired."""
        condition = self.optional(tag)
        return None if condition is None else ~condition


def _condition(point: Point) -> Expr:
    name = f"{point.tag} (n.c.)" if point.inverted else point.tag
    contact = Bit("X", point.number, name, point.meaning)
    return ~contact if point.inverted else contact


def driven(point: Point) -> Expr:
    """Return the condition that an output is active in the Y image of the last scan."""
    contact = Bit("Y", point.number, point.tag, point.meaning)
    return ~contact if point.inverted else contact


class System:
    """Bits that the runtime writes before each scan."""

    def __init__(self) -> None:
        m = Area("M", 0, 9)
        self.link_lost = m.bit("link lost", "no successful exchange with the field I/O within the timeout")
        self.scan_fault = m.bit("scan fault", "a scan exceeded its time limit or failed")
        self.memory_lost = m.bit("memory lost", "retentive memory could not be restored")
        self.outputs_held = m.bit("outputs held", "outputs are delayed until retentive memory is stored")
        self.store_fault = m.bit("store fault", "retentive memory cannot be stored")
        self.panel_silent = m.bit("panel silent", "no message from the operator panel within its timeout")
        self.outputs_taken = m.bit("outputs taken", "another master writes the outputs, or owns them")
        self.outputs_contested = m.bit("outputs contested", "a write of another master was refused by the field I/O")
        self.panel_shown = m.bit("panel shown", "an operator panel that shows the questions reads the controller")

    def bits(self) -> tuple[Bit, ...]:
        """Return all system bits."""
        return (
            self.link_lost,
            self.scan_fault,
            self.memory_lost,
            self.outputs_held,
            self.store_fault,
            self.panel_silent,
            self.outputs_taken,
            self.outputs_contested,
            self.panel_shown,
        )
