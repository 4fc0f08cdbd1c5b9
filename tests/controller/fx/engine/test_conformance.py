"""Conformance suite: every file in `conformance`, and the coverage of all instructions."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from controller.core.devices import is_32_bit_counter
from controller.fx.engine.peripherals.peripherals import Peripherals, load_peripherals
from controller.fx.language.cpu_model import CPU_MODELS, CpuModel
from controller.fx.language.il import read_il
from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder, LadderError
from controller.fx.language.instruction_set import FORMS, JOINS, RELATIONS
from controller.fx.stimulus.running import run
from controller.fx.stimulus.stimulus import load_stimulus

FOLDER = Path(__file__).parent / "conformance"
FILES = sorted(FOLDER.glob("*.yaml"))
ABOUT = {"name", "about", "program"}
OPTIONAL = {"cpu", "modules", "serial"}
STL_RULES = range(1, 10)


@cache
def content(path: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
    return loaded


def is_rejected(path: Path) -> bool:
    return "refused" in content(path)


def cpu(path: Path) -> CpuModel:
    return CPU_MODELS[content(path).get("cpu", "fx2n")]


def program(path: Path) -> Ladder:
    return read_il(content(path)["program"], path.name, cpu(path))


def peripherals(path: Path, folder: Path) -> Peripherals:
    """Return the modules and the serial line of a file."""
    described = {key: value for key, value in content(path).items() if key in ("modules", "serial")}
    if not described:
        return Peripherals()
    file = folder / path.name
    file.write_text(yaml.safe_dump(described, default_flow_style=False), encoding="utf-8")
    return load_peripherals(file)


RUNNING = [path for path in FILES if not is_rejected(path)]
REJECTED = [path for path in FILES if is_rejected(path)]


@pytest.mark.parametrize("path", RUNNING, ids=lambda path: path.stem)
def test_trace(path: Path, tmp_path: Path) -> None:
    stimulus = load_stimulus(path, others=ABOUT | OPTIONAL | {"expect"}, cpu=cpu(path))
    scans = run(program(path), stimulus, peripherals(path, tmp_path))
    actual = {name: [scan[name] for scan in scans] for name in scans[0] if name != "ms"}
    assert actual == content(path)["expect"]
    assert [scan["ms"] for scan in scans] == [n * stimulus.scan_ms for n in range(stimulus.scans)]


@pytest.mark.parametrize("path", REJECTED, ids=lambda path: path.stem)
def test_rejected(path: Path) -> None:
    with pytest.raises(LadderError) as caught:
        program(path)
    lines = {int(line.split(":")[1]) for line in str(caught.value).splitlines()}
    assert set(content(path)["refused"]) <= lines


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_file_is_complete(path: Path) -> None:
    keys = content(path).keys()
    assert keys >= ABOUT
    about = content(path)["about"]
    assert "[verified]" in about or "[from memory]" in about
    if path in REJECTED:
        assert keys == ABOUT | {"refused"}
    else:
        traces = content(path)["expect"]
        assert list(traces) == content(path)["watch"]
        assert all(len(trace) == content(path)["scans"] for trace in traces.values())


def covered() -> set[str]:
    """Return the mnemonics that a file both names and uses; DMOVP also counts as a use of MOV."""
    found: set[str] = set()
    for path in RUNNING:
        named = set(content(path)["name"].split(", "))
        used = {instruction.name for instruction in program(path).instructions}
        found |= named & (used | {FORMS[name].kind.name for name in used if name in FORMS})
    return found


def test_every_instruction_has_a_file() -> None:
    kinds = {form.kind.name for form in FORMS.values() if form.kind.supported}
    assert kinds - covered() == set()


def test_every_contact_comparison_has_a_file_in_both_widths() -> None:
    forms = {f"{join}{wide}{relation}" for join in JOINS for wide in ("", "D") for relation in RELATIONS}
    assert len(forms) == 36
    assert forms - covered() == set()


def test_every_rule_of_steps_has_a_file() -> None:
    names = [content(path)["name"] for path in FILES]
    rules = {int(match[1]) for name in names if (match := re.match(r"1\.7\.(\d) ", name))}
    assert rules == set(STL_RULES)


def coil(instruction: Instruction) -> str:
    """Return the kind of coil that an OUT drives."""
    match instruction.operands[0]:
        case DeviceOperand("T", number):
            return (
                "T 100 ms"
                if number < 200
                else "T 10 ms"
                if number < 246
                else "T retentive 1 ms"
                if number < 250
                else "T retentive"
            )
        case DeviceOperand("C", number):
            return "C 32" if is_32_bit_counter(number) else "C 16"
        case DeviceOperand(kind, _):
            return kind
    return "D.b"


def test_every_kind_of_coil_has_a_file() -> None:
    found = {
        coil(instruction)
        for path in RUNNING
        if "OUT" in content(path)["name"].split(", ")
        for instruction in program(path).instructions
        if instruction.name == "OUT"
    }
    assert found >= {"Y", "M", "S", "T 100 ms", "T 10 ms", "T retentive 1 ms", "T retentive", "C 16", "C 32"}
