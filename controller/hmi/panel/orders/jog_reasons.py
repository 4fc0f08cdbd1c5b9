"""Reason why the output that is jogged does not come on, or moves nothing."""

from __future__ import annotations

from typing import Final

from controller.core.devices import Memory
from controller.core.expr import evaluate
from controller.program.machine import Transplanter
from controller.program.operator.commands import JOGGED
from controller.program.tags import SIDES, Side, Tags
from controller.program.texts.interlocks import AT_END, RULES
from controller.program.texts.operator import Text

_LAST: Final = {
    "lift_extend": "sensed_down",
    "lift_retract": "sensed_up",
    "slide_outward": "sensed_at_feed",
    "spread": "sensed_spread",
    "converge": "sensed_converged",
}
"""Condition that the device is at the end to which an output drives it, as attribute of the arm's tags."""


def jog_obstacle(machine: Transplanter, memory: Memory, output: str) -> Text | None:
    """Return why a jogged output stays off, or drives nothing; None if the device moves, or the claws swing.

    Args:
        machine: Program and its tags.
        memory: Devices after a scan in which the output was requested.
        output: Tag of the output.
    """
    side, _, name = output.rpartition(".")
    rules = machine.rule_groups.get(side or "tray", [])
    for rule in rules:
        if name in rule.outputs and not evaluate(rule.allow, memory):
            return RULES[rule.name]
    if side in SIDES and _is_at_end(machine.tags, side, name, memory):
        return AT_END
    return None


def foreseen_obstacle(machine: Transplanter, memory: Memory, output: str) -> Text | None:
    """Return the obstacle of an output whose jog the program has not executed yet.

    The reason is thus shown with the reply to the press, not after the next scans and polls. It is not foreseen as long
    as the memory still contains the jog of another output.
    """
    jog = machine.tags.machine.jog
    before = memory.word(jog.kind, jog.number)
    if before not in {0, 1 + JOGGED.index(output)}:
        return None
    memory.set_word(jog.kind, jog.number, 1 + JOGGED.index(output))
    try:
        return jog_obstacle(machine, memory, output)
    finally:
        memory.set_word(jog.kind, jog.number, before)


def _is_at_end(tags: Tags, side: Side, name: str, memory: Memory) -> bool:
    attribute = _LAST.get(name)
    return attribute is not None and evaluate(getattr(tags.arms[side], attribute), memory)
