"""What the page has to know once: names, texts, limits, wires, steps; all of it from the program's own tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from controller.core.expr import Bit
from controller.core.sequence import Sequence, Step
from controller.hmi.panel.telemetry import Tag, Telemetry
from controller.hmi.panel.texts import TEXTS
from controller.hmi.panel.view import Json, in_both
from controller.hmi.reference import readable
from controller.io_map import Point
from controller.program.commands import JOGGED
from controller.program.machine import Transplanter
from controller.program.tags import CUPS, ROWS, SIDES
from controller.program.texts import MODES, QUESTIONS, REASONS, STATES, Text
from controller.program.texts import SIDES as SIDE_TEXTS

LANGUAGES: Final = ("en", "zh")

GEOMETRY: Final = {
    "slide_mm": {"feed": 0, "pick_1": 192.5, "pick_2": 235.5, "pick_3": 278.5},
    "lift_mm": 150,
    "spread_mm": 187,
    "rows": len(ROWS),
    "cups": CUPS,
}
"""Where things are drawn: slide from feed inward, for a row spacing of 600 mm; lift stroke; belt from converged."""

_TIME_BASES: Final = {" x10 ms": 10, " x100 ms": 100}


def public() -> Json:
    """Return what the login dialog needs."""
    return {"languages": list(LANGUAGES), "texts": {key: in_both(text) for key, text in TEXTS.items()}}


def describe(machine: Transplanter, telemetry: Telemetry | None) -> Json:
    """Return the whole description."""
    points = (*machine.io_map.inputs, *machine.io_map.outputs)
    devices = _alarmed_devices(machine)
    return {
        **public(),
        "states": _numbered(STATES),
        "modes": _numbered(MODES),
        "reasons": _numbered(REASONS),
        "commands": [
            {"name": c.name, "text": _label(f"command.{c.name}", c.name), "meaning": c.meaning, "group": c.group,
             "packml": c.packml}
            for c in machine.tags.commands
        ],
        "set_points": list(_set_points(machine)),
        "points": [_point(point) for point in points],
        "jogs": [{"output": output, **_jog_text(output)} for output in JOGGED],
        "questions": list(_questions()),
        "alarms": [
            {"number": alarm.bit.number, "text": in_both(alarm.text.message), "check": in_both(alarm.text.check),
             "safety": alarm.safety, "stops_work": alarm.stops_work, "device": devices.get(alarm.bit.number)}
            for alarm in machine.alarms
        ],
        "sequences": [
            {"name": sequence.name, "steps": [_step(sequence, step) for _, step in sequence]}
            for sequence in machine.program.sequences()
        ],
        "geometry": GEOMETRY,
        "telemetry": [] if telemetry is None else [_tag(tag) for tag in telemetry.tags],
    }  # fmt: skip


def _alarmed_devices(machine: Transplanter) -> dict[int, str]:
    """Return the device that an alarm is about, by annunciator: what its step was to move, or whose switches."""
    devices: dict[int, str] = {}
    for side, arm in machine.tags.arms.items():
        moved = {bit: f"{side}.{_DEVICE_OF[name]}" for name, bit in arm.want.items()}
        for sequence in (machine.cycles[side], machine.homings[side]):
            for _, step in sequence:
                wanted = [moved[bit] for bit in step.hold if bit in moved]
                if step.watch is not None and isinstance(step.watch.alarm, Bit) and wanted:
                    devices[step.watch.alarm.number] = wanted[0]
    for alarm in machine.alarms:
        device, _, what = alarm.key.partition(" ")
        if what == "switches":
            devices[alarm.bit.number] = f"{alarm.side}.{device}"
    return devices


def _numbered(table: dict[int, Text]) -> Json:
    return {str(number): in_both(text) for number, text in table.items()}


_DEVICE_OF: Final = {
    "lift_extend": "lift", "lift_retract": "lift", "slide_inward": "slide", "slide_outward": "slide",
    "converge": "belt", "spread": "belt", "claws_open": "claws", "claws_close": "claws",
}  # fmt: skip


def _label(key: str, otherwise: str) -> Json:
    return in_both(TEXTS.get(key, Text(otherwise, otherwise)))


def _jog_text(output: str) -> Json:
    side, _, name = output.rpartition(".")
    text = TEXTS[f"jog.{name}"]
    if side:
        sided = SIDE_TEXTS[side]
        text = Text(f"{sided.en}: {text.en}", f"{sided.zh}:{text.zh}")
    return {"text": in_both(text), "side": side or None}


def _set_points(machine: Transplanter) -> Iterator[Json]:
    set_points = machine.tags.sp
    firsts = dict(set_points.defaults)
    for name in set_points.names():
        word = getattr(set_points, name)
        lowest, highest = set_points.limits[word]
        scale = next((ms for ending, ms in _TIME_BASES.items() if word.name.endswith(ending)), None)
        yield {
            "name": name,
            "text": _label(f"set.{name}", word.name),
            "unit": "" if scale is None else "ms",
            "scale": scale or 1,
            "lowest": lowest,
            "highest": highest,
            "first": firsts[word],
            "at_start": word in set_points.at_start,
        }


def _point(point: Point) -> Json:
    side = point.tag.partition(".")[0]
    return {
        "address": point.address,
        "tag": point.tag,
        "meaning": point.meaning,
        "kind": "input" if point.device == "X" else "output",
        "inverted": point.inverted,
        "side": side if side in SIDES else None,
    }


def _questions() -> Iterator[Json]:
    for side in SIDES:
        answers = [f"{side}_loaded_yes", f"{side}_loaded_no", f"{side}_discard"]
        yield _question(f"{side}_loaded", QUESTIONS["loaded"].of(SIDE_TEXTS[side]), answers)
        yield _question(f"{side}_cups", QUESTIONS["cups"].of(SIDE_TEXTS[side]), ["cups_empty"])
    yield _question("tray", QUESTIONS["tray"], ["tray_same", "tray_full", "tray_none"])


def _question(key: str, text: Text, answers: list[str]) -> Json:
    labelled: list[Any] = [{"command": name, "text": _label(f"command.{name}", name)} for name in answers]
    return {"key": key, "text": in_both(text), "answers": labelled}


def _step(sequence: Sequence, step: Step) -> Json:
    return {
        "s": str(sequence[step.title]),
        "title": step.title,
        "waits_for": step.waits_for,
        "goes": [{"to": str(sequence[to.step]), "when": readable(to.when).strip("`")} for to in step.go],
    }


def _tag(tag: Tag) -> Json:
    return {"name": tag.name, "unit": tag.unit, "meaning": tag.meaning}
