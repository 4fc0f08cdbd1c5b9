"""Chinese names of the devices of the transplanter's program, from the tables of its texts."""

from __future__ import annotations

from collections.abc import Iterator

from controller.core.expr import Bit, Word
from controller.fx.language.operand_rules import Key
from controller.program.machine import Transplanter
from controller.program.texts.names import NAMES
from controller.program.texts.operator import SIDES


def chinese_names(machine: Transplanter) -> dict[Key, str]:
    """Return the Chinese name of each device that a table names: terminals, steps, set-points, commands and tags."""
    names = dict(_of_tags(machine))
    for name, word in vars(machine.tags.sp).items():
        if isinstance(word, Word) and f"set.{name}" in NAMES:
            names[word.kind, word.number] = NAMES[f"set.{name}"].zh
    for point in (*machine.io_map.inputs, *machine.io_map.outputs):
        text = _with_side("point", point.tag)
        if text is not None:
            names[point.device, point.number] = f"{text}（常闭）" if point.inverted else text
    return names


def _of_tags(machine: Transplanter) -> Iterator[tuple[Key, str]]:
    """Yield the devices of the program with the Chinese names of their tags."""
    for device in machine.program.devices():
        sequence, colon, title = device.name.partition(": ")
        if colon and f"sequence.{sequence}" in NAMES and f"step.{title}" in NAMES:
            yield (device.kind, device.number), f"{NAMES[f'sequence.{sequence}'].zh}：{NAMES[f'step.{title}'].zh}"
        elif device.name in NAMES and isinstance(device, Bit):  # a command
            yield (device.kind, device.number), NAMES[device.name].zh
        else:
            text = _with_side("condition", device.name)
            if text is not None:
                yield (device.kind, device.number), text


def _with_side(prefix: str, tag: str) -> str | None:
    """Return the Chinese name of a tag, with the side of an arm; None if no table names it."""
    side, _, name = tag.partition(".")
    if f"{prefix}.{tag}" in NAMES:
        return NAMES[f"{prefix}.{tag}"].zh
    if side in SIDES and f"{prefix}.{name}" in NAMES:
        return f"{SIDES[side].zh}：{NAMES[f'{prefix}.{name}'].zh}"
    return None
