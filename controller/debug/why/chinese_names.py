"""Chinese names of the devices of the transplanter's program, from the tables of its texts."""

from __future__ import annotations

from collections.abc import Iterator

from controller.common.modbus.io_map import IoMap
from controller.core.expr import Bit, Word
from controller.fx.language.operand_rules import Key
from controller.program.machine import Transplanter
from controller.program.texts.names import NAMES
from controller.program.texts.operator import SIDES
from controller.program.texts.timers import HOME, HOME_ZH, LIMIT, LIMIT_ZH, TIMERS


def chinese_names(machine: Transplanter) -> dict[Key, str]:
    """Return the Chinese name of each device that a table names: terminals, steps, set-points, commands and tags."""
    names = dict(_of_tags(machine))
    for name, word in vars(machine.tags.sp).items():
        if isinstance(word, Word) and f"set.{name}" in NAMES:
            names[word.kind, word.number] = NAMES[f"set.{name}"].zh
    return names | terminal_names(machine.io_map)


def terminal_names(io_map: IoMap) -> dict[Key, str]:
    """Return the Chinese name of each terminal."""
    names: dict[Key, str] = {}
    for point in (*io_map.inputs, *io_map.outputs):
        text = terminal_name(point.tag)
        if text is not None:
            names[point.device, point.number] = f"{text}（常闭）" if point.inverted else text
    return names


def terminal_name(tag: str) -> str | None:
    """Return the Chinese name of the point with a tag; None if no table names it."""
    return _with_side("point", tag)


def _of_tags(machine: Transplanter) -> Iterator[tuple[Key, str]]:
    """Yield the devices of the program with the Chinese names of their tags."""
    for device in machine.program.devices():
        sequence, colon, title = device.name.partition(": ")
        if colon and f"sequence.{sequence}" in NAMES and f"step.{title}" in NAMES:
            yield (device.kind, device.number), f"{NAMES[f'sequence.{sequence}'].zh}：{NAMES[f'step.{title}'].zh}"
        elif device.name in NAMES and isinstance(device, Bit):  # a command
            yield (device.kind, device.number), NAMES[device.name].zh
        else:
            text = _with_side("condition", device.name) or _timer(device.name)
            if text is not None:
                yield (device.kind, device.number), text


def _timer(tag: str) -> str | None:
    """Return the Chinese name of a timer; None if no table names it."""
    side, _, name = tag.partition(".") if tag.split(".", maxsplit=1)[0] in SIDES else ("", "", tag)
    text = TIMERS.get(name)
    if text is None and name.startswith(LIMIT):
        title = name.removeprefix(LIMIT)
        homes = title.startswith(HOME)
        step = NAMES.get(f"step.{title.removeprefix(HOME)}")
        text = None if step is None else f"{LIMIT_ZH}{HOME_ZH if homes else ''}{step.zh}"
    return None if text is None else f"{SIDES[side].zh}：{text}" if side else text


def _with_side(prefix: str, tag: str) -> str | None:
    """Return the Chinese name of a tag, with the side of an arm; None if no table names it."""
    side, _, name = tag.partition(".")
    if f"{prefix}.{tag}" in NAMES:
        return NAMES[f"{prefix}.{tag}"].zh
    if side in SIDES and f"{prefix}.{name}" in NAMES:
        return f"{SIDES[side].zh}：{NAMES[f'{prefix}.{name}'].zh}"
    return None
