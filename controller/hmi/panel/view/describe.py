"""Static description of the machine for the page: names, texts, limits, I/O points and steps."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, Final

from controller.common.modbus.io_map import Point
from controller.core.expr import Bit
from controller.core.sequence import Sequence, Step
from controller.events.alarm_load import MOST_IN_WINDOW
from controller.hmi.panel.modbus.telemetry import Telemetry, TelemetryTag
from controller.hmi.panel.orders.login import HALTING, command_level
from controller.hmi.panel.view.conditions import condition_text
from controller.hmi.panel.view.facts import Json
from controller.hmi.panel.view.state import in_both
from controller.hmi.panel.view.texts import TEXTS
from controller.iomap.loader import POINT_NAMES
from controller.program.alarms.guide import LikelyCause, likely_causes
from controller.program.machine import Transplanter
from controller.program.operator.commands import JOGGED, Command
from controller.program.set_points import CUPS
from controller.program.tags import ROWS, SIDES
from controller.program.texts.alarms.locations import LOCATIONS
from controller.program.texts.isolation import ISOLATION
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import LANGUAGES, MODES, REASONS, STATES, Language, Text, question_text
from controller.program.texts.operator import SIDES as SIDE_TEXTS

GEOMETRY: Final = {
    "slide_mm": {"feed": 0, "pick_1": 192.5, "pick_2": 235.5, "pick_3": 278.5},
    "lift_mm": 150,
    "spread_mm": 187,
    "rows": len(ROWS),
    "cups": CUPS,
}
"""Dimensions of the drawing: slide positions inward from feed for a row spacing of 600 mm; lift stroke; belt travel."""

_UNITS: Final[dict[str, tuple[float, str]]] = {
    " x10 ms": (10, "ms"),
    " x100 ms": (100, "ms"),
    " mm": (1, "mm"),
    " mm/s": (1, "mm/s"),
    " x0.01": (0.01, ""),
}
"""Value of one count of a set-point, and its unit, by the end of the name of its word."""


def public(language: Language | None = None) -> Json:
    """Return the part of the description that the login dialog needs.

    Args:
        language: Language of the page until the user selects one; None = that of the browser.
    """
    return {
        "languages": list(LANGUAGES),
        "language": language,
        "texts": {key: in_both(text) for key, text in TEXTS.items()},
    }


def describe(machine: Transplanter, telemetry: Telemetry | None, language: Language | None = None) -> Json:
    """Return the complete description; `language` as in `public`."""
    points = (*machine.io_map.inputs, *machine.io_map.outputs)
    wired = {point.tag for point in points} | {register.tag for register in machine.io_map.registers}
    devices = _alarmed_devices(machine)
    modes = {bit: int(mode) for mode, bit in machine.tags.commands.modes.items()}
    return {
        **public(language),
        "states": _numbered(STATES),
        "modes": _numbered(MODES),
        "reasons": _numbered(REASONS),
        "next_presses": _numbered(NEXT_PRESSES),
        "commands": [
            {
                "name": command.name,
                "text": _command_text(machine, command),
                "group": command.group,
                "packml": command.packml,
                "mode": modes.get(command.bit),
                "level": command_level(command.name).name.lower(),
                "halts": command.name in HALTING,
            }
            for command in machine.tags.commands
        ],
        "set_points": list(_set_points(machine)),
        "points": [_point(point) for point in points],
        "jogs": [
            {"output": output, "text": in_both(_jog_text(output)), "side": output.rpartition(".")[0] or None}
            for output in JOGGED
        ],
        "questions": list(_questions()),
        "alarms": [
            {
                "number": alarm.bit.number,
                "text": in_both(alarm.text.message),
                "meaning": in_both(alarm.text.meaning),
                "causes": [_cause(cause, wired) for cause in likely_causes(alarm, machine.io_map)],
                "safety": alarm.safety,
                "stops_work": alarm.stops_work,
                "device": devices.get(alarm.bit.number),
                "names_constants": alarm.bit == machine.alarms.constants,
            }
            for alarm in machine.alarms
        ],
        "sequences": [
            {"name": sequence.name, "steps": [_step(sequence, step) for _, step in sequence]}
            for sequence in machine.program.sequences()
        ],
        "most_alarms": MOST_IN_WINDOW,
        "isolation": [in_both(step) for step in ISOLATION],
        "geometry": GEOMETRY,
        "telemetry": [] if telemetry is None else [_tag(tag) for tag in telemetry.tags],
    }


def _cause(likely: LikelyCause, wired: Collection[str]) -> Json:
    """Return a likely cause: names and checks, parts for the picture, its wired points, and its set-points."""
    cause = likely.cause
    part = LOCATIONS[cause.location]
    return {
        "text": in_both(cause.name),
        "look": in_both(cause.look),
        "reach": None if cause.reach is None else in_both(cause.reach),
        "parts": [{"key": key, "text": in_both(_with_side(key.rpartition(".")[0], part))} for key in likely.locations],
        "points": [
            {"address": address, "text": in_both(_point_text(tag))} for tag, address in likely.points if tag in wired
        ],
        "set_points": [_label(f"set.{name}", name) for name in cause.set_points],
    }


def _point_text(tag: str) -> Text:
    side, _, name = tag.rpartition(".")
    return _with_side(side, Text(*POINT_NAMES[name]))


def _alarmed_devices(machine: Transplanter) -> dict[int, str]:
    """Return the device of each step alarm and switch alarm, by annunciator number.

    A step alarm belongs to the device that the step moves; a switch alarm belongs to the device with the switches.
    """
    devices: dict[int, str] = {}
    for side, arm in machine.tags.arms.items():
        moved = {bit: f"{side}.{_DEVICE_OF[name]}" for name, bit in arm.want.items()}
        for sequence in (machine.cycles[side], machine.homings[side]):
            for _, step in sequence:
                wanted = [moved[bit] for bit in step.hold if bit in moved]
                if step.watch is not None and isinstance(step.watch.alarm, Bit) and wanted:
                    devices[step.watch.alarm.number] = wanted[0]
    for alarm in machine.alarms:
        device, _, subject = alarm.key.partition(" ")
        if subject == "switches":
            devices[alarm.bit.number] = f"{alarm.side}.{device}"
    return devices


def _numbered(table: dict[int, Text]) -> Json:
    return {str(number): in_both(text) for number, text in table.items()}


_DEVICE_OF: Final = {
    "lift_extend": "lift",
    "lift_retract": "lift",
    "slide_inward": "slide",
    "slide_outward": "slide",
    "converge": "belt",
    "spread": "belt",
    "claws_open": "claws",
    "claws_close": "claws",
}


def _label(key: str, default: str) -> Json:
    return in_both(_text(key, default))


def _text(key: str, default: str) -> Text:
    return TEXTS.get(key, Text(default, default))


def _with_side(side: str, text: Text) -> Text:
    """Return a text preceded by the side, or the text alone if there is no side."""
    if side not in SIDE_TEXTS:
        return text
    name, form = SIDE_TEXTS[side], TEXTS["format.labelled"]
    return Text(form.en.format(label=name.en, text=text.en), form.zh.format(label=name.zh, text=text.zh))


def _command_text(machine: Transplanter, command: Command) -> Json:
    for output, bit in machine.tags.commands.jog.items():
        if command.bit == bit:
            return in_both(_jog_text(output))
    return _label(f"command.{command.name}", command.name)


def _jog_text(output: str) -> Text:
    side, _, name = output.rpartition(".")
    return _with_side(side, TEXTS[f"jog.{name}"])


def _set_points(machine: Transplanter) -> Iterator[Json]:
    set_points = machine.tags.sp
    defaults = dict(set_points.defaults)
    for name in set_points.names():
        word = getattr(set_points, name)
        lowest, highest = set_points.limits[word]
        scale, unit = next((value for ending, value in _UNITS.items() if word.name.endswith(ending)), (1, ""))
        yield {
            "name": name,
            "text": _label(f"set.{name}", word.name),
            "unit": unit,
            "scale": scale,
            "lowest": lowest,
            "highest": highest,
            "first": defaults[word],
            "constant": word in set_points.constants,
        }


def _point(point: Point) -> Json:
    side, _, name = point.tag.rpartition(".")
    return {
        "address": point.address,
        "tag": point.tag,
        "text": in_both(_with_side(side, _text(f"point.{name}", point.meaning))),
        "kind": "input" if point.device == "X" else "output",
        "inverted": point.inverted,
        "side": side if side in SIDES else None,
    }


def _questions() -> Iterator[Json]:
    for side in SIDES:
        yield _question(f"{side}_loaded", [f"{side}_loaded_yes", f"{side}_loaded_no", f"{side}_discard"])
        yield _question(f"{side}_cups", ["cups_empty"])
    yield _question("tray", ["tray_same", "tray_full", "tray_none"])


def _question(name: str, answers: list[str]) -> Json:
    options: list[Any] = [{"command": answer, "text": _label(f"command.{answer}", answer)} for answer in answers]
    return {"key": name, "text": in_both(question_text(name)), "answers": options}


def _step(sequence: Sequence, step: Step) -> Json:
    return {
        "s": str(sequence[step.title]),
        "title": step.title,
        "waits_for": step.waits_for,
        "goes": [{"to": str(sequence[to.step]), "when": in_both(condition_text(to.when))} for to in step.go],
    }


def _tag(tag: TelemetryTag) -> Json:
    return {"name": tag.name, "unit": tag.unit, "low": tag.low, "high": tag.high}
