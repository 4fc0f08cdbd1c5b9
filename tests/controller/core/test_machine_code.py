"""Machine code: the same device values as in Python execution after every scan; cached by content."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import pytest
from hypothesis import given, settings

from controller.core import object_code
from controller.core.devices import WORD_MAX, WORD_MIN, Memory
from controller.core.expr import Bit, Counter, Timer, Word
from controller.core.llvm_ir import translate
from controller.core.machine_code import MachineCode, MachineExecution
from controller.core.memory_layout import MemoryLayout
from controller.core.program import Block, Program
from controller.core.rungs import Count, Inc, Mov, OnDelay, Out, Rung, Set
from controller.core.scan import Plc
from controller.core.sequence import Sequence, Step, To
from tests.controller.common.files.trust_rig import private_folders
from tests.controller.core.core_rig import d, levels, m, program_of, s, x, y
from tests.controller.export.fx_equality import STEPS, Differs, Pair, stories
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.verify.test_scan import COMMAND, SET_POINT, SET_POINT_DEFAULT, STIMULI, Scanned, programs
from tests.sampling import examples, first_of

ROWS = [field.name for field in fields(Memory)]
A_STORY = 5_000


def with_machine_code(program: Program, filter_ms: int = 0) -> Plc:
    return Plc(program, input_filter_ms=filter_ms, execution=MachineExecution(program))


def differences(one: Plc, other: Plc) -> list[str]:
    """Return the devices whose values differ."""
    return [
        f"{row}{number}: {a}, not {b}"
        for row in ROWS
        for number, (a, b) in enumerate(zip(getattr(one.memory, row), getattr(other.memory, row), strict=False))
        if a != b
    ]


# ---- arbitrary programs -----------------------------------------------------------------------------------------


@pytest.fixture
def uncached(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile without a cache folder, so that arbitrary programs do not fill the user's cache."""
    monkeypatch.setattr(object_code, "_folder", lambda: None)


def check_arbitrary_program(items: list[Rung | Sequence], story: list[Scanned]) -> None:
    """Run a program with power failures in both `Execution` implementations; compare all devices after every scan."""
    program = program_of(*items, set_points=((SET_POINT, SET_POINT_DEFAULT),))
    plcs = [Plc(program, input_filter_ms=0), with_machine_code(program)]
    now_ms = 0
    for scanned in story:
        if scanned.power_lost:
            retained = [plc.retained() for plc in plcs]
            plcs = [Plc(program, input_filter_ms=0), with_machine_code(program)]
            for plc, values in zip(plcs, retained, strict=True):
                plc.restore_retained(values)
        now_ms += scanned.pause_ms
        for plc in plcs:
            plc.write(COMMAND, scanned.command)
            if scanned.set_point is not None:
                plc.write(SET_POINT, scanned.set_point)
        one, other = (plc.scan(now_ms, levels(*scanned.on)) for plc in plcs)
        assert one == other
        assert differences(*plcs) == []


@pytest.mark.usefixtures("uncached")
@examples(6, nightly=12)
@given(programs(), STIMULI)
def test_arbitrary_programs_have_equal_devices_after_every_scan(
    items: list[Rung | Sequence], story: list[Scanned]
) -> None:
    check_arbitrary_program(items, story)


@pytest.mark.nightly
@pytest.mark.timeout(1_800)
@pytest.mark.usefixtures("uncached")
@settings(max_examples=3_000)
@given(programs(), STIMULI)
def test_thousands_of_arbitrary_programs(items: list[Rung | Sequence], story: list[Scanned]) -> None:
    check_arbitrary_program(items, story)


def scanned(program: Program, *scans: tuple[int, tuple[int, ...]]) -> Plc:
    """Run scans (time in ms, X numbers that are on) in both implementations; return the PLC that runs machine code."""
    plcs = [Plc(program, input_filter_ms=0), with_machine_code(program)]
    for now_ms, on in scans:
        for plc in plcs:
            plc.scan(now_ms, levels(*on))
        assert differences(*plcs) == []
    return plcs[1]


def test_a_step_that_is_left_and_entered_in_the_same_scan_remains_active() -> None:
    """A transfer to a step cancels the reset of that step at END."""
    steps = [Step(title, go=[To(other, x(0))], waits_for="X0") for title, other in (("one", "two"), ("two", "one"))]
    program = program_of(Set(s(20), when=x(1)), Sequence("any", 20, steps))
    plc = scanned(program, (0, (1,)), (10, (0,)), (20, (0,)), (30, ()))
    assert [plc.memory.S[20], plc.memory.S[21]] == [True, False]


def test_a_step_with_a_transfer_to_itself_remains_active() -> None:
    steps = [Step("only", go=[To("only", x(0))], waits_for="X0")]
    plc = scanned(program_of(Set(s(20), when=x(1)), Sequence("any", 20, steps)), (0, (1,)), (10, (0,)), (20, ()))
    assert plc.memory.S[20]


def test_a_step_takes_one_transfer_in_a_scan() -> None:
    """A transfer that resets its own condition does not enable another transfer of the step in the same scan."""
    steps = [
        Step("one", go=[To("two", m(0)), To("three", x(0))], waits_for="X0"),
        *(Step(title, go=[], waits_for="nothing") for title in ("two", "three")),
    ]
    program = program_of(Set(s(20), when=x(1)), Set(m(0), when=x(2)), Sequence("any", 20, steps, consumes=m(0)))
    plc = scanned(program, (0, (1,)), (10, (0, 2)), (20, ()))
    assert plc.memory.S[20:23] == [False, True, False]


def test_a_retentive_timer_stops_at_the_largest_value() -> None:
    program = program_of(OnDelay(Timer(250), 100, when=x(0)))
    plc = scanned(program, (0, (0,)), (4_000_000, (0,)), (8_000_000, (0,)))
    assert plc.memory.TV[250] == WORD_MAX


def test_an_increment_of_the_largest_value_gives_the_smallest() -> None:
    plc = scanned(program_of(Mov(WORD_MAX, d(0), when=m(8002)), Inc(d(0), when=x(0))), (0, ()), (10, (0,)))
    assert plc.memory.D[0] == WORD_MIN


def test_a_32_bit_counter_counts_down_while_its_direction_relay_is_on() -> None:
    """The contact turns on when the value rises to the preset, and off when it falls below the preset."""
    program = program_of(Out(m(8200), when=x(1)), Count(Counter(200), 2, when=x(0)))
    up, down = [(0, (0,)), (10, ()), (20, (0,)), (30, ())], [(40, (0, 1)), (50, (1,)), (60, (0, 1)), (70, (0, 1))]
    counted = scanned(program, *up)
    assert (counted.memory.CV[200], counted.memory.C[200]) == (2, True)
    counted = scanned(program, *up, *down)
    assert (counted.memory.CV[200], counted.memory.C[200]) == (0, False)


# ---- program of the machine -------------------------------------------------------------------------------------


@dataclass
class ExecutionPair(Pair):
    """Machine program run by both `Execution` implementations; replaces the pair of a program and its export."""

    def __post_init__(self) -> None:
        self.fast = with_machine_code(MACHINE.program, self.filter_ms)
        super().__post_init__()

    def write(self, device: Bit | Word, value: int) -> None:
        self.soft.write(device, value)
        self.fast.write(device, value)

    def report_loss(self) -> None:
        self.write(MACHINE.tags.system.memory_lost, 1)

    def power_cycle(self, *, battery_low: bool = False) -> None:
        retained, fast = self.soft.retained(), self.fast.retained()
        assert retained == fast
        self.soft = Plc(MACHINE.program, input_filter_ms=self.filter_ms)
        self.fast = with_machine_code(MACHINE.program, self.filter_ms)
        if battery_low:
            self.report_loss()
        else:
            self.soft.restore_retained(retained)
            self.fast.restore_retained(retained)
        self.give_constants()

    def scan(self, now_ms: int, levels: list[bool]) -> list[bool]:  # type: ignore[override]
        images = [plc.retentive_image() for plc in (self.soft, self.fast)]
        image = self.soft.scan(now_ms, list(levels))
        fast = self.fast.scan(now_ms, list(levels))
        changed = [plc.retentive_image() != before for plc, before in zip((self.soft, self.fast), images, strict=True)]
        self.scans += 1
        self.moving += True in image
        self.visited |= {name for number, name in STEPS if self.soft.memory.S[number]}
        rows = [row for row in ROWS if getattr(self.soft.memory, row) != getattr(self.fast.memory, row).copy()]
        if image != fast or changed[0] != changed[1] or rows:
            raise Differs(f"scan {self.scans} at {now_ms} ms: {differences(self.soft, self.fast)[:8]} {changed}")
        return image


@pytest.mark.parametrize(
    ("scans", "seed"),
    first_of([(2_500, 4), (5_000, 0), pytest.param(1_000_000, 2_000, marks=pytest.mark.timeout(3_600))]),
)
def test_the_program_of_the_machine_has_equal_devices_after_every_scan(scans: int, seed: int) -> None:
    """The device values are equal in random scenarios with faults, power failures and late scans."""
    pairs = []
    length = min(scans, A_STORY)
    for number in range(seed, seed + scans // length):
        *_, (pair, _) = stories(number, length, kind=ExecutionPair)
        pairs.append(pair)
    assert sum(pair.scans for pair in pairs) == scans
    assert sum(pair.moving for pair in pairs) > scans // 6, "cup pulses at random times hold the machine"
    assert len(set().union(*(pair.visited for pair in pairs))) >= len(STEPS) // 2


# ---- memory -----------------------------------------------------------------------------------------------------


def test_the_memory_has_the_values_of_a_new_plc() -> None:
    program = program_of(Out(y(0), when=x(0)))
    assert differences(Plc(program), with_machine_code(program)) == []


def test_two_plcs_with_the_same_machine_code_share_no_state() -> None:
    program = program_of(OnDelay(Timer(200), 10, when=x(0)), Out(y(0), when=Bit("T", 200)))
    one, other = with_machine_code(program), with_machine_code(program)
    one.scan(0, levels(0))
    assert one.scan(10, levels(0))[0]
    assert not other.scan(10, levels())[0]
    assert one.memory.T[200]
    assert not other.memory.T[200]


def test_values_written_between_scans_have_python_types() -> None:
    plc = with_machine_code(program_of(Out(y(0), when=m(3))))
    plc.write(m(3), 1)
    plc.write(Word("D", 7), -5)
    assert plc.scan(0, levels())[0] is True
    assert plc.memory.M[3] is True
    assert plc.memory.D[7] == -5
    assert plc.memory.D.copy()[7] == -5
    assert plc.memory.M[2:4] == [False, True]


# ---- cache ------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty cache folder that is used instead of the user's cache folder."""
    monkeypatch.setattr(object_code, "_folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the list of modules that are compiled during the test."""
    texts: list[str] = []
    compile_module = object_code._compile

    def recorded(text: str) -> bytes:
        texts.append(text)
        return compile_module(text)

    monkeypatch.setattr(object_code, "_compile", recorded)
    return texts


def two_blocks(number: int) -> Program:
    """Return a program whose second block depends on an argument."""
    return Program(
        "two", (Block("one", (Out(m(0), when=x(0)),)), Block("two", (Out(y(number), when=m(0)),))), outputs="two"
    )


def test_a_changed_rung_recompiles_its_block_and_the_scan_only(folder: Path, compiled: list[str]) -> None:
    MachineCode(two_blocks(0))
    assert len(compiled) == 3
    MachineCode(two_blocks(0))
    assert len(compiled) == 3
    MachineCode(two_blocks(1))
    assert len(compiled) == 5
    plc = with_machine_code(two_blocks(1))
    assert plc.scan(0, levels(0))[:2] == [False, True]
    assert len(list(folder.iterdir())) == 5


@pytest.mark.parametrize("damage", [b"", b"no object code", None])
def test_a_damaged_object_file_is_compiled_again(folder: Path, compiled: list[str], damage: bytes | None) -> None:
    MachineCode(two_blocks(0))
    for path in folder.iterdir():
        path.write_bytes(path.read_bytes()[:-40] if damage is None else damage)
    MachineCode(two_blocks(0))
    assert len(compiled) == 6
    MachineCode(two_blocks(0))
    assert len(compiled) == 6


def test_a_cache_that_cannot_be_written_does_not_prevent_execution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(object_code, "_folder", lambda: tmp_path / "missing")
    MachineCode(two_blocks(0))


def test_machine_code_that_others_could_have_written_is_not_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiled: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Object files with a valid checksum lie in the cache when other users are let in; they are compiled afresh."""
    shared = tmp_path / "seedling-transplanter"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with private_folders(monkeypatch):
        object_code._folder.cache_clear()
        MachineCode(two_blocks(0))
        planted = list(shared.rglob("*.o"))
        assert (len(planted), len(compiled), caplog.messages) == (3, 3, [])
        shared.chmod(0o777)
        for _ in range(2):
            object_code._folder.cache_clear()
            MachineCode(two_blocks(0))
        assert len(compiled) == 6, "the private folder is a cache too"
        folder = object_code._folder()
        assert folder is not None
        assert not folder.is_relative_to(tmp_path)
        assert caplog.messages == [
            f"{shared}: other users can write it; run chmod go-w on it: machine code in it is not used, "
            f"but compiled in {folder.parent}"
        ]
    object_code._folder.cache_clear()


def test_equal_blocks_have_one_module() -> None:
    program = Program("equal", tuple(Block(title, (Set(m(0), when=x(0)),)) for title in ("one", "two")), outputs="two")
    assert len(translate(program, MemoryLayout(0)).modules) == 2
