"""Every rule of the interlocks as the reason for which a requested output is off: named, never a contact to change.

The output block runs alone, so that each rule can be the only one that does not allow its output.
"""

from __future__ import annotations

import re
from functools import cache

import pytest

from controller.core.devices import Memory
from controller.core.expr import Bit, Word, all_of
from controller.core.program import Program
from controller.debug.why.machine_program import MachineProgram
from controller.export.instruction_list import program_ladder
from controller.fx.observation.cross_reference import CrossReference
from controller.fx.observation.observed_plc import ObservedPlc
from controller.fx.observation.why import Reasons
from controller.program.alarms.table import Alarm
from controller.program.interlocks import Rule, output_block
from controller.program.machine import OUTPUTS
from controller.program.tags import Side
from tests.controller.program.interlock_scene import MACHINE, TAGS, tag_of
from tests.controller.program.test_interlocks import RULES, example, request_of, rules_of


@cache
def outputs() -> tuple[CrossReference, Reasons, ObservedPlc, MachineProgram]:
    """Return the output block alone as a ladder, and the complete program."""
    block = output_block(TAGS, MACHINE.io_map, MACHINE.rules, MACHINE.tray_rules, MACHINE.other_rules)
    ladder = program_ladder(Program("outputs", (block,), outputs=OUTPUTS))
    plc = ObservedPlc(ladder, input_filter_ms=0)
    whole = MachineProgram(MACHINE)
    return CrossReference(ladder), Reasons(ladder), plc, whole


def scan(stimulus: dict[Bit | Word, int]) -> None:
    """Execute one scan of the output block with some devices."""
    plc, memory = outputs()[2], Memory()
    for device, value in stimulus.items():
        if isinstance(device, Bit):
            memory.bits(device.kind)[device.number] = bool(value)
        else:
            memory.set_word(device.kind, device.number, value)
    plc.load(memory)
    plc.scan(0, list(memory.X))


@pytest.mark.parametrize(
    ("side", "rule", "output"), RULES, ids=[f"{tag_of(side, output)}: {rule.name}" for side, rule, output in RULES]
)
def test_a_rule_is_named_and_its_contacts_are_not_to_be_changed(side: Side | None, rule: Rule, output: str) -> None:
    reference, reasons, plc, whole = outputs()
    others = [other.allow for other in rules_of(side) if other is not rule and output in other.outputs]
    stimulus = example(all_of(request_of(side, output), *others, ~rule.allow))
    assert stimulus is not None
    scan(stimulus)
    key = ("Y", MACHINE.io_map[tag_of(side, output)].number)
    writers = [use.at for use in reference.device(key).uses if use.written]
    reason = reasons.of_device(writers, before=False, seen=plc.observation)
    assert not reason.driven
    assert reason.sets
    for each in reason.sets:
        changed = {change.device for change in each.changes if change.device is not None}
        assert all(whole.is_safeguard(device, key) for device in changed)
    (words,) = whole.blocking(key, plc.memory)
    assert words.en.startswith(f"“{rule.name}”: ")
    assert rule.name not in words.zh
    assert len(words.zh) > 2


@pytest.mark.parametrize("alarm", [*MACHINE.alarms], ids=lambda alarm: str(alarm.bit))
def test_an_alarm_is_a_cause_with_its_message_in_both_languages(alarm: Alarm) -> None:
    whole, key = outputs()[3], ("S", alarm.bit.number)
    assert all(whole.is_safeguard(key, of) for of in (("M", 34), ("Y", 2), ("D", 100)))
    name = whole.name(key)
    assert alarm.text.message.en in name.en
    assert alarm.text.message.zh in name.zh


@pytest.mark.parametrize("tag", ["stop", "emergency_stop"])
def test_a_stop_is_a_safeguard_of_every_device_that_reads_it(tag: str) -> None:
    whole = outputs()[3]
    key = ("X", MACHINE.io_map[tag].number)
    behind = {use.rung for use in whole.reference.device(key).uses}
    assert len(behind) > 1
    assert all(whole.is_safeguard(key, of) for of in (("M", 32), ("Y", 2), ("S", 900), key))


def test_terminals_steps_timers_commands_and_set_points_have_their_chinese_names() -> None:
    whole = outputs()[3]
    points = (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs)
    named = [(point.device, point.number) for point in points]
    named += [(bit.kind, bit.number) for steps in MACHINE.program.sequences() for bit, _ in steps]
    named += [(device.kind, device.number) for device in MACHINE.program.devices() if device.kind == "T"]
    named += [(command.bit.kind, command.bit.number) for command in TAGS.commands if "jog" not in command.name]
    named += [(word.kind, word.number) for word in TAGS.sp.constants]
    for key in named:
        text = whole.tag(key)
        assert text.en
        assert not re.search("[a-zA-Z]{2}", text.zh), text
        assert text.zh != text.en
    lift, stop = MACHINE.io_map["left.lift_up"].number, MACHINE.io_map["emergency_stop"].number
    assert whole.name(("X", lift)) == ("X2 left.lift_up", "X2 左：升降在上限位")
    assert whole.name(("X", stop)).zh == "X25 急停按下（常闭）"
    assert whole.name(("T", 5)).zh == "T5 左：限时：分散"
    assert whole.name(("S", 25)).zh == "S25 左臂循环：提苗"
