"""Machine constants: which set-points they are, that they are given at each start, and what a start accepts."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from controller.cli.machine import ConstantsError, start_values
from controller.core.devices import WORD_MAX
from controller.core.expr import Bit, Word, leaves
from controller.core.rungs import Annunciate, OnDelay, read_devices
from controller.core.scan import Plc
from controller.export.instruction_list import export
from controller.program.requirements.proof import specification
from controller.program.states import Mode
from tests.controller.program.interlock_scene import MACHINE, TAGS

SP = TAGS.sp
NAMES = {getattr(SP, name): name for name in SP.names()}
WRONG = {
    SP.settle: 10**9,
    SP.pause_at_feed: 501,
    SP.trays_target: -1,
    TAGS.machine.mode: 9,
    TAGS.tray.phase: 42,
    TAGS.arms["left"].rows[1]: 4,
    TAGS.arms["right"].cycles: -1,
    TAGS.machine.trays_done: WORD_MAX + 1,
    TAGS.machine.batch_complete: 2,
}
"""An impossible value of each kind of retentive device."""


def constants_relied_on() -> set[str]:
    """Return the set-points on which interlocks, places and the assumptions of the proof rely.

    An interlock reads a set-point, or a monitor of the proof a timer whose preset is a set-point.
    """
    specified = specification(MACHINE)
    read: set[Bit | Word] = set()
    for rules in MACHINE.rule_groups.values():
        read |= {device for rule in rules for device in leaves(rule.allow)}
    read |= {device for each in specified.requirements for device in leaves(each.never)}
    read |= {device for rung in specified.monitors.rungs() for device in read_devices(rung)}
    timers = {device.number for device in read if device.kind == "T"}
    words: set[Word] = {device for device in read if isinstance(device, Word)}
    for rung in MACHINE.program.rungs():
        if isinstance(rung, OnDelay | Annunciate) and rung.timer.number in timers and isinstance(rung.preset, Word):
            words.add(rung.preset)
    return {NAMES[word] for word in words if word in NAMES}


def test_a_set_point_that_the_safety_relies_on_is_a_machine_constant() -> None:
    assert {NAMES[word] for word in SP.constants} == constants_relied_on()


def test_constants_are_not_retained() -> None:
    plc = Plc(MACHINE.program)
    plc.write(SP.arms_may_meet, 1)
    plc.write(SP.settle, 77)
    retained = plc.retained()
    assert not {str(word) for word in SP.constants} & retained.keys()
    started = Plc(MACHINE.program)
    started.restore_retained(retained)
    assert started.read(SP.arms_may_meet) == 0
    assert started.read(SP.settle) == 77


@pytest.mark.nightly
def test_an_export_writes_the_given_constants_at_each_start() -> None:
    """The other set-points are written once, to new memory."""
    program = MACHINE.program.with_set_points({SP.arms_may_meet: 1})
    first: dict[str, tuple[str, bool]] = {}
    guarded = False
    for line in export(program).instructions:
        words = [str(operand) for operand in line.operands]
        if line.name == "LD":
            guarded = False
        guarded |= line.name == "ANI"
        if line.name == "MOV":
            first.setdefault(words[1], (words[0], guarded))
    constants = {str(word): (f"K{value}", False) for word, value in program.set_points if word in SP.constants}
    assert constants["D516"] == ("K1", False)
    assert {name: value for name, value in first.items() if name in constants} == constants
    assert first[str(SP.settle)][1]


@pytest.mark.parametrize("device", WRONG, ids=str)
def test_impossible_values_in_retentive_memory_are_refused(device: Bit | Word) -> None:
    """Nothing is restored; the message names the device."""
    plc = Plc(MACHINE.program)
    retained = Plc(MACHINE.program).retained()
    before = plc.retained()
    retained |= {str(SP.trays_target): 60, str(device): WRONG[device]}
    with pytest.raises(ValueError, match=rf"^{device} .*: {WRONG[device]} is not a valid value$"):
        plc.restore_retained(retained)
    assert plc.retained() == before


def test_every_retentive_word_has_valid_values() -> None:
    """A register added to the retentive memory must state its valid values."""
    words = {device for device in MACHINE.program.retentive if isinstance(device, Word) and device.kind == "D"}
    assert words == {word for word in MACHINE.program.valid if word not in SP.constants}


@pytest.mark.parametrize("lowest", [True, False])
def test_every_permitted_value_is_restored(*, lowest: bool) -> None:
    plc = Plc(MACHINE.program)
    end = min if lowest else max
    retained = plc.retained() | {
        str(word): end(values) for word, values in MACHINE.program.valid.items() if word not in SP.constants
    }
    plc.restore_retained(retained)
    assert plc.retained() == retained


def test_every_mode_is_restored() -> None:
    for mode in Mode:
        plc = Plc(MACHINE.program)
        plc.restore_retained(plc.retained() | {str(TAGS.machine.mode): mode})
        assert plc.read(TAGS.machine.mode) == mode


# the file of machine constants


def given(path: Path | None, *assignments: str) -> dict[str, int]:
    """Return the values of a start by name."""
    options = argparse.Namespace(constants=path, set_points=assignments)
    return {NAMES[word]: value for word, value in start_values(MACHINE, options).items()}


def test_constants_come_from_a_file_and_set_has_priority(tmp_path: Path) -> None:
    file = tmp_path / "constants.yaml"
    file.write_text("arms_may_meet: 1\nclamp: 30\n", encoding="utf-8")
    assert given(file, "clamp=40", "trays_target=2") == {"arms_may_meet": 1, "clamp": 40, "trays_target": 2}
    assert given(None) == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("clmp: 30\n", "1: clmp: is no machine constant or travel time; did you mean clamp?"),
        ("lift_ms: 0\n", "1: lift_ms: must be an integer, 1 to 60000"),
        ("lift_ms: 0.75\n", "1: lift_ms: must be an integer, 1 to 60000"),
        ("lift_ms: true\n", "1: lift_ms: must be an integer, 1 to 60000"),
        ("lift_ms: 300\n", " lift_shortest_ms: must not exceed lift_ms, 300"),
        ("arms_may_meet: 1\nclamp: 9\n", "2: clamp: must be 10 to 200"),
        ("clamp: true\n", "1: clamp: must be an integer, 10 to 200"),
        ("clamp: [20]\n", "1: clamp: must be an integer, 10 to 200"),
        ("clamp: -1\n", "1: clamp: must be an integer, 10 to 200"),
        ("clamp: 20\nclamp: 30\n", "2: file: key 'clamp' is already defined on line 1; delete one"),
    ],
)
def test_an_invalid_file_is_reported_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "constants.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConstantsError) as raised:
        given(file)
    assert str(raised.value) == f"constants.yaml:{message}"


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConstantsError, match=r"absent\.yaml"):
        given(tmp_path / "absent.yaml")
