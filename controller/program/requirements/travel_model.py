"""Kinematic model of the arms and of the tray as rungs, for the exploration of homing.

A coil moves its device at constant speed between its ends; a switch is on within a band around its place. The position
of a device is the time in which it travels there from its near end at its nominal speed, in ms. Air, seedlings and
collisions are not modelled.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from controller.common.modbus.io_map import IoMap
from controller.core.expr import FALSE, TRUE, Bit, Expr, Word
from controller.core.program import Block
from controller.core.rungs import Add, Out, Rst, Rung, Subtract
from controller.program.areas import Area
from controller.program.inputs import driven
from controller.program.requirements.travel_times import TravelTimes
from controller.program.tags import ROWS, SIDES

LIFT_BAND_MS, SLIDE_BAND_MS, BELT_BAND_MS = 30, 40, 30
"""Half of the travel time through the band of a switch, ms: 6 mm at the speed of the device."""
TRAY_MS, TRAY_AND_GAP_MS = 2_700, 2_900
"""Travel time of a tray, and of a tray and the gap behind it, ms: 540 mm and 40 mm at 0.2 m/s."""


@dataclass(frozen=True, slots=True)
class Travel:
    """One device that two coils move.

    Attributes:
        position: Register of the position, ms of travel.
        end: Position of the far end, ms.
        band: Half of the band of a switch, ms.
        to: Condition that the coil to the far end is on.
        fro: Condition that the coil to the near end is on.
        switches: Position of each switch by the name of its place, ms.
        inputs: X number of the switch of each place.
    """

    position: Word
    end: int
    band: int
    to: Expr
    fro: Expr
    switches: dict[str, int]
    inputs: dict[str, int]


class TravelModel:
    """Rungs that move the devices, and the levels of the X terminals that follow.

    Attributes:
        devices: Devices by side and name.
        tray_sensor: X number of the front edge sensor.
        tray: Register of the way of the tray, ms: 0 as its front edge is at the sensor.
        scan_ms: Register of the scan time, ms.
        stuck_on: Relays that force an input on, by X number.
        stuck_off: Relays that force an input off, by X number.
        levels: Relays with the levels of the X terminals, by X number.
        block: Rungs of the model; they follow the outputs in the scan.
    """

    def __init__(self, io_map: IoMap, times: TravelTimes, *, active_at_rest: Collection[int]) -> None:
        """Declare the devices and rungs of the model.

        Args:
            io_map: I/O map of the machine.
            times: Travel times of the machine.
            active_at_rest: X numbers of the inputs without a device in the model that are active; the others are not.
        """
        d, count = Area("D", 7_900, 7_999, "travel model"), io_map.input_count
        m = Area("M", 2_500, 2_500 + 3 * count - 1, "travel model")
        self.levels = [m.bit(f"level of X{number:o}", "level of the terminal") for number in range(count)]
        self.stuck_on = [m.bit(f"X{number:o} stuck on", "input forced on") for number in range(count)]
        self.stuck_off = [m.bit(f"X{number:o} stuck off", "input forced off") for number in range(count)]
        self.scan_ms = d.word("scan ms", "scan time")
        self.tray_sensor = io_map["tray_front_edge"].number
        self.tray = d.word("tray", "way of the tray")
        self.devices = {side: _devices(io_map, times, d, side) for side in SIDES}
        self.block = Block("travel model", tuple(self._rungs(io_map, active_at_rest)))

    @property
    def inputs(self) -> frozenset[Bit | Word]:
        """Devices that determine the levels of the terminals: positions and forced states."""
        positions = (device.position for table in self.devices.values() for device in table.values())
        return frozenset((*positions, self.tray, *self.stuck_on, *self.stuck_off))

    def _rungs(self, io_map: IoMap, active_at_rest: Collection[int]) -> Iterator[Rung]:
        run = driven(io_map["tray_run"])
        yield Add(self.tray, self.scan_ms, self.tray, when=run)
        yield Rst(self.tray, when=self.tray >= TRAY_AND_GAP_MS)
        sensed: dict[int, Expr] = {self.tray_sensor: self.tray < TRAY_MS}
        for device in (device for table in self.devices.values() for device in table.values()):
            position = device.position
            yield Add(position, self.scan_ms, position, when=device.to & ~device.fro & (position < device.end))
            yield Subtract(position, self.scan_ms, position, when=device.fro & ~device.to & (position > 0))
            for place, at in device.switches.items():
                near, far = position >= at - device.band, position <= at + device.band
                sensed[device.inputs[place]] = far if at == 0 else near if at == device.end else near & far
        for point in io_map.inputs:
            number = point.number
            at_rest = TRUE if number in active_at_rest else FALSE
            active = (sensed.get(number, at_rest) | self.stuck_on[number]) & ~self.stuck_off[number]
            yield Out(self.levels[number], when=~active if point.inverted else active)


def _devices(io_map: IoMap, times: TravelTimes, d: Area, side: str) -> dict[str, Travel]:
    """Return the devices of one arm: end, band, coils to the far and to the near end, and switches with their input."""
    rows = {f"pick {row}": (f"slide_at_pick_{row}", times.row_1_ms + n * times.row_ms) for n, row in enumerate(ROWS)}
    table = {
        "lift": (
            (times.lift_ms, LIFT_BAND_MS),
            ("lift_retract", "lift_extend"),
            {"down": ("lift_down", 0), "up": ("lift_up", times.lift_ms)},
        ),
        "slide": (
            (times.slide_ms + SLIDE_BAND_MS, SLIDE_BAND_MS),
            ("slide_inward", "slide_outward"),
            {"feed": ("slide_at_feed", 0), **rows},
        ),
        "belt": (
            (times.belt_ms, BELT_BAND_MS),
            ("spread", "converge"),
            {"converged": ("claws_converged", 0), "spread": ("claws_spread", times.belt_ms)},
        ),
    }
    return {
        name: Travel(
            d.word(f"{side} {name}", "position, ms of travel"),
            end,
            band,
            driven(io_map[f"{side}.{to}"]),
            driven(io_map[f"{side}.{fro}"]),
            {place: at for place, (_, at) in switches.items()},
            {place: io_map[f"{side}.{tag}"].number for place, (tag, _) in switches.items()},
        )
        for name, ((end, band), (to, fro), switches) in table.items()
    }
