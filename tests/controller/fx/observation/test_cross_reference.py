"""Search and cross references: uses of devices compared with the engine and with the declarations of the machine."""

from __future__ import annotations

import pytest

from controller.core.rungs import written_devices
from controller.fx.engine.plc import FxPlc
from controller.fx.language.cpu_model import FX2N, FX3U
from controller.fx.language.il import read_il
from controller.fx.observation.cross_reference import CrossReference, device_key
from controller.fx.observation.device_use import device_uses
from tests.controller.export.test_program_ladder import LADDER
from tests.controller.fx.engine.test_executions import OUTPUTS
from tests.controller.program.interlock_scene import MACHINE

TEXT = """
; lift up
LD X1
ANI M240
MPS
OUT Y2
MPP
AND X10
MOV D0 D1
; steps
STL S20
LD T1
SET S21
STL S21
LD M5
OUT M240
RET
LD M6
MC N0 M50
LD X2
OUT M5
MCR N0
LD Y2
ZRST M10 M12
END
"""
COMMENTS = {"X1": "left lift down", "M240": "blocked", "Y2": "left lift up"}


@pytest.fixture
def reference() -> CrossReference:
    ladder = read_il(TEXT)
    ladder.comments.update(COMMENTS)
    return CrossReference(ladder, {"M240": ["被阻止"], "M999": ["unused"]})


def test_uses_of_a_device(reference: CrossReference) -> None:
    (found,) = reference.find("m240")
    assert [(each.at, each.step, each.rung, each.title, each.written) for each in found.uses] == [
        (1, 1, 0, "lift up", False),
        (12, 17, 4, "steps", True),
    ]
    assert found.texts == ("blocked", "被阻止")


@pytest.mark.parametrize(
    ("text", "devices"),
    [
        ("left lift", ["X1", "Y2"]),
        ("LIFT UP", ["Y2"]),
        ("阻", ["M240"]),
        ("unused", ["M999"]),
        ("x10", ["X10"]),
        ("X8", []),
        ("M11", ["M11"]),
        ("M777", []),
        (" ", []),
    ],
)
def test_find_by_device_tag_and_comment(text: str, devices: list[str], reference: CrossReference) -> None:
    assert list(map(str, reference.find(text))) == devices


def test_titles_are_found_with_their_uses(reference: CrossReference) -> None:
    assert reference.titles("STEP") == [(7, "steps")]


def test_rungs_behind_an_output_include_steps_and_zones(reference: CrossReference) -> None:
    """Y2 depends on M240, M240 on step S21 and M5, S21 on step S20, and M5 on M50."""
    y2 = ("Y", 2)
    first = [rung.first for rung in reference.rungs]
    assert [first[n] for n in reference.rungs_behind(y2)] == [0]
    assert [first[n] for n in reference.rungs_behind(y2, 2)] == [0, 11]
    assert [first[n] for n in reference.rungs_behind(y2, 3)] == [0, 11, 16, 8]
    assert [first[n] for n in reference.rungs_behind(y2, 4)] == [0, 11, 16, 8, 14]


@pytest.mark.parametrize("text", [each for each in OUTPUTS if "V" not in each and "Z0" not in each])
def test_an_instruction_writes_only_its_written_devices(text: str) -> None:
    """The devices that change in some scans are those that the operands write, besides special devices."""
    ladder = read_il(f"LD X0\n{text}\nEND\n", cpu=FX3U if "D3." in text else FX2N)
    plc = FxPlc(ladder, input_filter_ms=0)
    memory = plc.memory
    memory.D[:12] = [3, 1, 0x4120, 70, 2, 0, 9, 5, 7, 1, 2, 3]
    memory.M[:6] = [True, False] * 3
    memory.S[20] = memory.S[900] = memory.T[0] = memory.C[0] = True
    written = {key for key, is_written in device_uses(ladder.instructions[1]) if is_written}
    for n, level in enumerate((False, True, True, False, True)):
        before = {kind: list(memory.bits(kind)) for kind in "YMSTC"} | {"D": memory.D.copy()}
        plc.scan(200 * n, [level])
        after = {kind: list(memory.bits(kind)) for kind in "YMSTC"} | {"D": memory.D}
        for kind, row in after.items():
            changed = {(kind, k) for k, value in enumerate(row) if value != before[kind][k] and k < 8000}
            assert changed <= written | ({("S", 900)} if text == "ANR" else set())


def test_the_machine_writes_the_devices_of_its_declaration() -> None:
    reference = CrossReference(LADDER)
    declared = {(device.kind, device.number) for rung in MACHINE.program.rungs() for device in written_devices(rung)}
    for sequence in MACHINE.program.sequences():
        declared |= {("S", t.target.number) for each in sequence.transfers.values() for t in each}
        if sequence.consumes is not None:
            declared.add(("M", sequence.consumes.number))
    uses = {
        key: found.uses
        for kind, size in (("X", 256), ("Y", 256), ("M", 8000), ("S", 1000), ("T", 256), ("C", 256), ("D", 8000))
        for key in ((kind, number) for number in range(size))
        if (found := reference.device(key)).uses
    }
    written = {key for key, uses in uses.items() if any(each.written for each in uses)}
    assert {key for key in written if key[0] != "D" or key[1] not in range(180, 189)} == declared
    assert not any(each.written for key, uses in uses.items() if key[0] == "X" for each in uses)


def test_names_of_devices() -> None:
    assert [device_key(name) for name in ("Y17", "y20", "D8000", "Q1", "M", "X9")] == [
        ("Y", 15),
        ("Y", 16),
        ("D", 8000),
        None,
        None,
        None,
    ]
