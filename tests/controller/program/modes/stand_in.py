"""Fast substitute for the machine with cups, trays, and switches that follow the coils after plausible times.

Air, seedlings and collisions are not modelled. Inputs without a model keep their state at power-up of the plant. The
substitute is used where a program must run through its states many times.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from controller.common.modbus.io_map import IoMap
from controller.program.tags import SIDES
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant

BAND_MM = 6.0
"""Half-width of a switch band, mm."""
LIFT_MM, BELT_MM = 150.0, 187.0
MACHINE = load_machine()
PICKS_MM = tuple(1_000 * pick_m for pick_m in MACHINE.picks_m)
TRAY_MM, GAP_MM = 540.0, 40.0
SPEED_MM_MS = {"slide": 0.15, "lift": 0.2, "belt": 0.2, "tray": 0.2}
CUP_MS = 800
"""Cup period, ms; much shorter than on the machine, because the scenarios are short."""


@cache
def at_power_up(io_map: IoMap) -> tuple[bool, ...]:
    """Return the logical state of each input, by X number, at power-up of the plant."""
    states, levels = [False] * io_map.input_count, Plant(io_map, MACHINE, seed=1).x
    for point in io_map.inputs:
        states[point.number] = point.active(levels[point.number])
    return tuple(states)


@dataclass(slots=True)
class Axis:
    """Device that two coils move between its end positions.

    Attributes:
        end_mm: Position of the far end, mm; the near end is at 0.
        speed_mm_ms: Speed, mm/ms.
        to: Y number of the coil that moves the device to the far end.
        fro: Y number of the coil that moves the device to the near end.
        switches: X number and position, mm, of each switch.
        at_mm: Position, mm.
    """

    end_mm: float
    speed_mm_ms: float
    to: int
    fro: int
    switches: tuple[tuple[int, float], ...]
    at_mm: float = 0.0

    def move(self, ms: int, coils: list[bool], sensed: list[bool]) -> None:
        """Move the device for a given time according to its coils, and update its switches."""
        way_mm = (coils[self.to] - coils[self.fro]) * self.speed_mm_ms * ms
        self.at_mm = min(max(self.at_mm + way_mm, 0.0), self.end_mm)
        for number, place_mm in self.switches:
            sensed[number] = abs(self.at_mm - place_mm) <= BAND_MM


class StandIn:
    """Simulated machine with two arms at home and a full magazine.

    Attributes:
        stuck: Forced switch states by X number.
        pressed: Tags of the buttons that are pressed.
        cups_come: True while the carousels turn.
        trays_come: True while the magazine supplies trays.
    """

    def __init__(self, io_map: IoMap) -> None:
        self.stuck: dict[int, bool] = {}
        self.pressed: set[str] = set()
        self.cups_come = self.trays_come = True
        self._inputs = [(point.number, point.inverted) for point in io_map.inputs]
        self._outputs = [(point.number, point.inverted) for point in io_map.outputs]
        self._buttons = [(tag, io_map[tag].number) for tag in ("start", "stop", "emergency_stop")]
        self._cups = [io_map[f"{side}.cup_pulse"].number for side in SIDES]
        self._beam, self._run = io_map["tray_front_edge"].number, io_map["tray_run"].number
        self._sensed, self._coils = [False] * io_map.input_count, [False] * io_map.output_count
        self._at_rest = at_power_up(io_map)
        self._tray_mm = TRAY_MM  # the rear edge of a tray has just passed
        self._turned_ms = 0

        def x(side: str, tag: str) -> int:
            return io_map[f"{side}.{tag}"].number

        self._axes: list[Axis] = []
        for side in SIDES:
            rows = ((x(side, f"slide_at_pick_{row}"), place_mm) for row, place_mm in enumerate(PICKS_MM, 1))
            slide, lift, belt = (
                ((x(side, "slide_at_feed"), 0.0), *rows),
                ((x(side, "lift_down"), 0.0), (x(side, "lift_up"), LIFT_MM)),
                ((x(side, "claws_converged"), 0.0), (x(side, "claws_spread"), BELT_MM)),
            )
            for name, end_mm, to, fro, switches in (
                ("slide", PICKS_MM[-1] + BAND_MM, "slide_inward", "slide_outward", slide),
                ("lift", LIFT_MM, "lift_retract", "lift_extend", lift),
                ("belt", BELT_MM, "spread", "converge", belt),
            ):
                self._axes.append(Axis(end_mm, SPEED_MM_MS[name], x(side, to), x(side, fro), switches))

    def advance(self, ms: int, image: list[bool]) -> list[bool]:
        """Apply a Y image for a given time and return the raw X levels at the end."""
        coils, sensed = self._coils, self._sensed
        sensed[:] = self._at_rest
        for number, inverted in self._outputs:
            coils[number] = image[number] != inverted
        for axis in self._axes:
            axis.move(ms, coils, sensed)
        if coils[self._run] and (self.trays_come or self._tray_mm < TRAY_MM):
            self._tray_mm = (self._tray_mm + SPEED_MM_MS["tray"] * ms) % (TRAY_MM + GAP_MM)
        sensed[self._beam] = self._tray_mm < TRAY_MM
        self._turned_ms += ms * self.cups_come
        for number in self._cups:
            sensed[number] = self._turned_ms % CUP_MS < CUP_MS // 6
        for tag, number in self._buttons:
            sensed[number] = tag in self.pressed
        for number, level in self.stuck.items():
            sensed[number] = level
        levels = [False] * len(sensed)
        for number, inverted in self._inputs:
            levels[number] = sensed[number] != inverted
        return levels
