"""Physical cause of the level of an input: button, wire, switch, or the part of the plant that the switch detects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Final

from controller.common.modbus.io_map import IoMap, Point
from controller.core.devices import Memory, device_name
from controller.debug.search import device_changes, following
from controller.debug.timeline import RunTimeline
from controller.debug.why.answer import CauseKind, WhyCause
from controller.debug.why.chinese_names import terminal_name, terminal_names
from controller.debug.why.machine_program import SAFEGUARDS, MachineProgram
from controller.debug.why.program import ExplainedProgram
from controller.debug.why.texts import level, sentence
from controller.fx.language.instruction import Ladder
from controller.fx.language.operand_rules import Key
from controller.fx.observation.cross_reference import CrossReference
from controller.fx.observation.why import Reasons
from controller.program.texts.alarms.locations import LOCATIONS
from controller.program.texts.operator import SIDES, Text
from plant_sim.faults import FAULTS, Fault
from plant_sim.machine.plant import Plant
from plant_sim.machine.terminals import BUTTONS
from plant_sim.scope.columns import bands_of, numbers_of
from plant_sim.twin.lock_step import SCAN_MS, Twin

_AIR: Final = ("supply", "compressor", "claw_reservoir")
"""Targets of faults that affect all cylinders."""
_OUTPUTS: Final = {
    "lift_up": "lift_retract",
    "lift_down": "lift_extend",
    "slide_at_feed": "slide_outward",
    "slide_at_pick": "slide_inward",
    "claws_spread": "spread",
    "claws_converged": "converge",
}
"""Output that moves a part to its switch."""
_TRAYS: Final = ("conveyor", "magazine", "tray")
"""First words of the targets of faults that affect the trays."""
_PARTS: Final = {
    "lift": LOCATIONS["lift"].zh,
    "slide": LOCATIONS["slide"].zh,
    "spreader": LOCATIONS["spreader"].zh,
    "cups": "苗杯",
    "belt": LOCATIONS["conveyor"].zh,
    "manifold": LOCATIONS["air_supply"].zh,
}
"""Chinese names of the parts by the last word of their name."""
_INPUT_SCANS: Final = 3
"""Scans in which a press reaches its input."""
_DELAY_MS: Final = 100
"""Longest time between a fault and the scan in which an input has changed because of it, ms: bounce, filter, scan."""


class PlantCauses(ExplainedProgram):
    """Program with the state of the plant behind its inputs."""

    def connect(self, plant: Plant, io_map: IoMap, memory: Callable[[], Memory]) -> None:
        """Connect the program to a plant; called once.

        Args:
            plant: The plant.
            io_map: Its I/O map.
            memory: Function that returns the devices of the program that runs on it.
        """
        self._plant, self._io_map, self._memory = plant, io_map, memory
        self._bands = {band.sensor: band for band in bands_of(numbers_of(plant.params))}

    def input_causes(self, key: Key, line: RunTimeline, scan: int, changed: int | None, /) -> list[WhyCause]:
        """Return the physical causes of the level of an input; the plant is in the state after the scan."""
        plant = self._plant
        point = next((each for each in self._io_map.inputs if each.number == key[1]), None)
        if point is None:
            return []
        logical = point.active(self._memory().X[key[1]])
        since = line.first if changed is None else changed
        if key[1] in plant.terminals.bridged:
            return []
        faults = [*self._faults(self._sensor_targets(point.tag), scan, changed)]
        detected = self._detected(point)
        parts = self._part(point.tag)
        if point.tag in BUTTONS:
            parts = sentence("actuated" if detected else "not actuated", name=_point_name(point.tag))
        if faults and (detected is not logical or not any(each in plant.faults.active for each in faults)):
            return [self._fault(device_name(*key), fault, parts, line) for fault in faults]
        if point.tag in BUTTONS:
            return [self._button(key, point.tag, line, changed, logical=logical)]
        faults = [*self._faults(self._drive_targets(point.tag), scan, changed)]
        faults = faults or [*self._faults(_AIR, scan, changed)]
        text = sentence("plant", name=self.name(key), level=level(logical), plant=parts, **_when(line, since))
        change = self._flip(key, line)
        machine = WhyCause(CauseKind.MACHINE, device_name(*key), since, text, change)
        return [*(self._fault(device_name(*key), fault, parts, line) for fault in faults), machine]

    def _button(self, key: Key, tag: str, line: RunTimeline, changed: int | None, *, logical: bool) -> WhyCause:
        guarded, since = self.is_safeguard(key, key), line.first if changed is None else changed
        name = "safeguard" if guarded and logical else "button"
        text = sentence(name, name=self.name(key), level=level(logical), **_when(line, since))
        if guarded:
            kind = CauseKind.SAFEGUARD if logical else CauseKind.COMMAND
            return WhyCause(kind, device_name(*key), since, text)
        change = ""
        if logical and changed is not None:  # not pressed, until it is released
            again = following(line, device_changes(line, [line.machine.signal(device_name(*key))]), changed)
            change = f"{tag}=off@{max(line.first + 1, changed - _INPUT_SCANS)}..{'' if again is None else again}"
        return WhyCause(CauseKind.COMMAND, device_name(*key), since, text, change)

    def driver(self, key: Key, /) -> Key | None:
        """Return the output that moves a part to a position switch; None = none."""
        tag = next((each.tag for each in self._io_map.inputs if each.number == key[1]), "")
        side, _, switch = tag.partition(".")
        output = _OUTPUTS.get("slide_at_pick" if switch.startswith("slide_at_pick") else switch)
        point = None if output is None else self._io_map.get(f"{side}.{output}")
        return None if point is None else ("Y", point.number)

    def suspects(self, line: RunTimeline, /) -> list[WhyCause]:
        """Return the faults that are active in the present state of the plant."""
        found = []
        for fault in reversed(self._plant.faults.active):
            cause = self._fault("", fault, sentence("active"), line)
            found.append(replace(cause, kind=CauseKind.SUSPECT))
        return found

    def _fault(self, device: str, fault: Fault, plant: Text, line: RunTimeline) -> WhyCause:
        start = f"{fault.start_ms / 1000:.2f} s"
        end = "" if fault.end_ms is None else f"{fault.end_ms / 1000:.2f} s"
        span = Text(
            f"from {start} to {end}" if end else f"since {start}", f"{start} 至 {end}" if end else f"自 {start} 起"
        )
        named = Text(f"fault {fault.name}", f"故障 {fault.name}")
        scans = -(-(self._plant.time_ms - fault.start_ms) // SCAN_MS)
        begun = max(line.first + 1, line.scan - scans + 1)
        change = "" if FAULTS[fault.kind].permanent else f"mend={fault.name}@{begun}"
        text = sentence("fault", fault=named, span=span, plant=plant)
        return WhyCause(CauseKind.FAULT, device, begun, text, change)

    def _faults(self, targets: Iterable[str], scan: int, changed: int | None) -> Iterator[Fault]:
        """Yield the faults of some parts that act at this scan, or acted when the input changed."""
        plant = self._plant
        changed_ms = plant.time_ms - (scan - (scan if changed is None else changed)) * SCAN_MS
        for fault in reversed(plant.faults.activated):
            first = fault.target.rpartition(".")[0] or fault.target
            if not {fault.target, first} & {*targets}:
                continue
            acts = fault in plant.faults.active
            acted = fault.start_ms <= changed_ms <= (fault.end_ms or changed_ms) + _DELAY_MS
            if acts or acted:
                yield fault

    def _sensor_targets(self, tag: str) -> tuple[str, ...]:
        return (tag,)

    def _drive_targets(self, tag: str) -> tuple[str, ...]:
        side, _, name = tag.partition(".")
        for word, drive in (("lift", "lift"), ("slide", "slide"), ("claws", "spreader"), ("cup", "cups")):
            if name.startswith(word):
                return (f"{side}.{drive}", f"{side}.{drive}.plus", f"{side}.{drive}.minus")
        return _TRAYS if tag in ("tray_front_edge", "magazine_empty") else ()

    def _detected(self, point: Point) -> bool | None:
        """Return the level that a sound switch would have; None = unknown."""
        plant = self._plant
        if point.tag in BUTTONS:
            return bool(getattr(plant.box, point.tag))
        sensor = plant.sensors.get(point.tag)
        return None if sensor is None else sensor.detected

    def _part(self, tag: str) -> Text:
        """Return position and pressure of the part that an input detects."""
        signal = numbers_of(self._plant.state).__getitem__
        band, side = self._bands.get(tag), tag.partition(".")[0]
        if band is not None:
            name = band.column.rpartition(".")[0]
            words: dict[str, Text | str | int] = {
                "part": _part_name(name),
                "at": f"{1000 * signal(band.column):.1f}",
                "low": f"{1000 * band.low_m:.0f}",
                "high": f"{1000 * band.high_m:.0f}",
            }
            if name.rpartition(".")[2] not in ("lift", "slide"):
                return sentence("part", **words)
            ends = {end: signal(f"{name}.{end}.chamber.pressure_pa") / 1e5 for end in ("plus", "minus")}
            bars = {**ends, "supply": signal("air.network.manifold.pressure_pa") / 1e5}
            return sentence("part with air", **words, **{name: f"{bar:.1f}" for name, bar in bars.items()})
        if tag in ("tray_front_edge", "magazine_empty"):
            return _measured("conveyor.belt", f"{1000 * signal('conveyor.belt_m'):.0f} mm")
        if tag == "air_pressure_ok":
            return _measured("air.network.manifold", f"{signal('air.network.manifold.pressure_pa') / 1e5:.2f} bar")
        if tag.endswith("cup_pulse"):
            return _measured(f"{side}.cups", f"{1000 * signal(f'{side}.cups.speed_m_s'):.0f} mm/s")
        return _point_name(tag)

    def _flip(self, key: Key, line: RunTimeline) -> str:
        """Return the change with which the input has its other level from the present scan on."""
        start = max(line.first + 1, line.scan)
        return f"{device_name(*key)}={'off' if self._memory().X[key[1]] else 'on'}@{start}.."


class TwinProgram(PlantCauses, MachineProgram):
    """Program of a twin."""

    def __init__(self, twin: Twin) -> None:
        """Take a twin."""
        super().__init__(twin.machine)
        self.connect(twin.plant, twin.io_map, lambda: twin.plc.memory)


class PlantLadder(PlantCauses):
    """FX program on the plant. Of its interlocks nothing is known but the terminals of the safeguards."""

    def __init__(self, ladder: Ladder, plant: Plant, io_map: IoMap, memory: Callable[[], Memory]) -> None:
        """Take a program and its plant; the other arguments are those of `connect`."""
        super().__init__(CrossReference(ladder), Reasons(ladder))
        self.connect(plant, io_map, memory)
        chinese = terminal_names(io_map)
        self._terminals: dict[Key, Text] = {}
        for point in (*io_map.inputs, *io_map.outputs):
            key = point.device, point.number
            self._terminals[key] = Text(point.tag, chinese.get(key, point.tag))
        points = (io_map.get(tag) for tag in SAFEGUARDS)
        self._safeguards = {("X", point.number) for point in points if point is not None}

    def tag(self, key: Key) -> Text:
        """Return the comment of a device, or the name of a terminal without a comment."""
        tag = super().tag(key)
        return tag if tag.en else self._terminals.get(key, tag)

    def is_safeguard(self, key: Key, _of: Key, /) -> bool:
        """Return whether a device is the terminal of a safeguard."""
        return key in self._safeguards


def _measured(name: str, value: str) -> Text:
    """Return a measured value of a part."""
    part = _part_name(name)
    return Text(f"{part.en} {value}", f"{part.zh} {value}")


def _part_name(name: str) -> Text:
    """Return the name of a part; in English that of its values in a recording."""
    side, _, part = name.rpartition(".")
    chinese = _PARTS[part]
    return Text(name, f"{SIDES[side].zh}：{chinese}" if side in SIDES else chinese)


def _point_name(tag: str) -> Text:
    """Return the name of a terminal."""
    return Text(tag, terminal_name(tag) or tag)


def _when(line: RunTimeline, scan: int) -> dict[str, Text | str | int]:
    """Return an earlier scan and its time for a sentence."""
    return {"scan": scan, "time": f"{(line.machine.now_ms - (line.scan - scan) * SCAN_MS) / 1000:.2f} s"}
