"""Structured Text export: an independent parser accepts it, and its outputs are equal in every scan."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from random import Random

import pytest
from lark.exceptions import LarkError

from controller.core.expr import FALSE, TRUE, Bit, Counter, Expr, Timer, Word, all_of, any_of
from controller.core.program import Block, Program
from controller.core.rungs import (
    Add,
    Annunciate,
    Count,
    Inc,
    Mov,
    OnDelay,
    Out,
    Pulse,
    PulseFalling,
    Rst,
    Rung,
    Scale,
    Set,
    Subtract,
    ZoneReset,
)
from controller.core.scan import Plc
from controller.core.sequence import Dwell, Step, To
from controller.core.sequence import Sequence as Steps
from controller.export.instruction_list import acting
from controller.export.structured_text import WIDTH, structured_text
from controller.export.structured_text_variables import RESERVED, address, identifier
from tests.controller.export.fx_equality import MOVING, Differs, Pair, stories
from tests.controller.export.st_runner import StPlc, StProgram, parsed, tree_of
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of, one_in

TEXT = str(structured_text(acting(MACHINE.program)))
X = [Bit("X", n) for n in range(8)]
M = [Bit("M", n) for n in range(16)]


@pytest.fixture(scope="module")
def machine() -> StProgram:
    return StProgram(TEXT)


class StPair(Pair):
    """Program on the soft PLC, paired with its Structured Text export."""

    make: Callable[[], StPlc]

    def __post_init__(self) -> None:
        self.st = type(self).make()
        super().__post_init__()

    def write(self, device: Bit | Word, value: int) -> None:
        self.soft.write(device, value)
        self.st.write(address(device.kind, device.number).removeprefix("%"), value)

    def report_loss(self) -> None:
        self.write(MACHINE.tags.system.memory_lost, 1)

    def power_cycle(self, *, battery_low: bool = False) -> None:
        retained = self.soft.retained()
        self.soft = Plc(MACHINE.program, input_filter_ms=self.filter_ms)
        self.st.power_cycle(memory_lost=battery_low)
        if battery_low:
            self.report_loss()
        else:
            self.soft.restore_retained(retained)
        self.give_constants()

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        soft, st = self.soft.scan(now_ms, list(levels)), self.st.scan(now_ms, levels)
        self.scans += 1
        self.moving += any(soft[number] for number in MOVING)
        if soft != st:
            raise Differs(f"scan {self.scans} at {now_ms} ms: {[f'Y{n:o}' for n in range(256) if soft[n] != st[n]]}")
        return soft


def run_stories(make: Callable[[], StPlc], monkeypatch: pytest.MonkeyPatch, seeds: range, scans: int) -> list[Pair]:
    """Run random scenarios on the Structured Text and on the soft PLC in parallel."""
    monkeypatch.setattr(StPair, "make", staticmethod(make), raising=False)
    pairs = []
    for seed in seeds:
        *_, (pair, _) = stories(seed, scans, kind=StPair)
        pairs.append(pair)
    return pairs


@pytest.mark.parametrize(("count", "scans"), first_of([(1, 2_000), (3, 4_000)]))
def test_text_has_the_same_outputs_in_every_scan(
    count: int, scans: int, machine: StProgram, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The outputs are equal in random scenarios with motion in many scans and occasional power failures.

    If one AND in a valve's rung is then changed to OR, the difference is detected. Both checks are in one test because
    parsing takes a minute.
    """
    pairs = run_stories(machine.plc, monkeypatch, range(count), scans)
    assert sum(pair.scans for pair in pairs) == count * scans
    assert sum(pair.moving for pair in pairs) > count * scans // 6
    valve = next(name for name, v in machine.variables.items() if v.address == "QX0.2")

    def mutate(source: str) -> str:
        place = source.index(" and ", source.index(f"v_{valve} = "))
        return f"{source[:place]} or {source[place + 5 :]}"

    with pytest.raises(Differs):
        run_stories(lambda: machine.plc(mutate), monkeypatch, range(count), scans)


def test_every_device_of_the_machine_is_a_variable_at_its_address(machine: StProgram) -> None:
    located = [v.address for v in machine.variables.values() if v.address]
    assert len(located) == len(set(located))
    wanted = {address(device.kind, device.number).removeprefix("%") for device in acting(MACHINE.program).devices()}
    assert set(located) == wanted - {""}


def test_retentive_devices_of_the_soft_plc_are_retained(machine: StProgram) -> None:
    retained = {v.address for v in machine.variables.values() if v.retain and v.address}
    wanted = {address(d.kind, d.number).removeprefix("%") for d in acting(MACHINE.program).retentive if d.kind in "MD"}
    assert retained == wanted


def test_text_without_vendor_extensions(machine: StProgram) -> None:
    assert TEXT.isascii()
    code = re.sub(r"\(\*.*?\*\)", "", TEXT)
    assert not re.search(r"S=|R=|REF=|\{|//|\bAND_THEN\b|\bTON\b|\bTIME\b", code)
    assert max(map(len, code.split("END_VAR")[-1].splitlines())) <= WIDTH
    assert not RESERVED & {name.upper() for name in machine.variables}
    assert not [name for name in machine.variables if "__" in name or name.endswith("_")]


# ---- small programs, every kind of rung ----


def small(*items: Rung | Steps, set_points: tuple[tuple[Word, int], ...] = ()) -> Program:
    return Program("small", (Block("all", items),), "all", set_points=set_points)


def watched(program: Program, seed: int = 1, scans: int = 400, text: str = "", inputs: int = 8) -> None:
    """Run a program and its text with random inputs, and compare all relays, states and registers."""
    chance, now_ms = Random(seed), 0
    soft, st_program = Plc(program, input_filter_ms=0), StProgram(text or str(structured_text(program)))
    st = st_program.plc()
    names = {v.address: f"v_{name}" for name, v in st_program.variables.items() if v.address}
    inside = {d for d in program.devices() if address(d.kind, d.number)}
    levels = [False] * 16
    for number in range(scans):
        levels[chance.randrange(inputs)] = chance.random() < 0.6
        now_ms += chance.choice((1, 7, 10, 40, 100, 230))
        if number % 97 == 96:
            retained = soft.retained()
            soft = Plc(program, input_filter_ms=0)
            soft.restore_retained(retained)
            st.power_cycle()
        assert soft.scan(now_ms, levels) == st.scan(now_ms, levels), f"outputs in scan {number}"
        for device in inside:
            mine = soft.read(device)
            its = st.values[names[address(device.kind, device.number).removeprefix("%")]]
            assert mine == its, f"{device} in scan {number}: {mine} in the PLC, {its} in the text"


def timers() -> Program:
    return small(
        OnDelay(Timer(0), 300, X[0]),
        OnDelay(Timer(200), 250, X[1]),
        OnDelay(Timer(246), 333, X[2]),
        OnDelay(Timer(250), Word("D", 5), X[3]),
        OnDelay(Timer(2), Word("D", 5), any_of(X[1], X[0])),
        Rst(Timer(246), X[4]),
        Rst(Timer(250), all_of(X[4], X[5])),
        Rst(Timer(0), all_of(X[6], X[7])),
        Annunciate(Timer(1), 400, Bit("S", 900), X[0]),
        Annunciate(Timer(3), 200, Bit("S", 903), X[1]),
        Rst(Bit("S", 900), all_of(X[4], X[3])),
        Rst(Bit("S", 903), all_of(X[5], X[3])),
        *(Out(M[n], Bit("T", t)) for n, t in enumerate((0, 200, 246, 250, 2))),
        Out(M[9], Word("T", 0) >= 2),
        Mov(Word("T", 246), Word("D", 6)),
        Mov(Word("T", 200), Word("D", 8)),
        Out(M[10], Bit("M", 8048)),
        Mov(Word("D", 8049), Word("D", 7)),
        Out(M[11], Bit("M", 8013)),
        set_points=((Word("D", 5), 4),),
    )


def counters() -> Program:
    return small(
        Count(Counter(0), 3, X[0]),
        Count(Counter(100), Word("D", 10), X[1]),
        Out(Bit("M", 8200), X[2]),
        Count(Counter(200), 2, X[0]),
        Count(Counter(220), Word("D", 10), X[1]),
        Rst(Counter(0), X[3]),
        Rst(Counter(100), all_of(X[3], X[4])),
        Rst(Counter(200), all_of(X[3], X[5], X[6])),
        *(Out(M[n], Bit("C", c)) for n, c in enumerate((0, 100, 200, 220))),
        Out(M[8], Word("C", 200) < Word("C", 0)),
        Mov(Word("C", 100), Word("D", 11)),
        Mov(Word("C", 200), Word("D", 12)),
        set_points=((Word("D", 10), 4),),
    )


def logic() -> Program:
    return small(
        Pulse(M[0], X[0] | X[1]),
        PulseFalling(M[1], X[0]),
        Pulse(M[0], X[2]),
        Set(M[2], M[0] & ~X[3]),
        Rst(M[2], ~(X[3] & ~X[4]) & X[5]),
        Set(Bit("M", 500), X[6]),
        Set(Bit("M", 501), M[2]),
        ZoneReset(Bit("M", 500), Bit("M", 502), X[7]),
        Inc(Word("D", 0), M[0]),
        Mov(Word("D", 0), Word("D", 200), X[1]),
        Mov(-7, Word("D", 1)),
        Mov(32766, Word("D", 2), Bit("M", 8002)),
        Inc(Word("D", 2), X[1]),
        Out(M[3], ~Word("D", 2).equals(32767) & (Word("D", 0) > Word("D", 1))),
        Out(M[4], ~(Word("D", 2) < 0) | (X[0] & X[1])),
        Out(M[5], TRUE),
        Out(M[6], FALSE),
        Rst(Word("D", 0), X[7] & X[6]),
        Add(Word("D", 0), Word("D", 2), Word("D", 204), X[2]),
        Subtract(Word("D", 1), Word("D", 204), Word("D", 205), X[4]),
        Scale(Word("D", 2), Word("D", 0), 3, Word("D", 201), X[3]),
        Scale(Word("D", 2), Word("D", 1), Word("D", 0), Word("D", 202)),
        Scale(Word("D", 201), 900, Word("D", 0), Word("D", 203), X[5] | (Word("D", 203) > 40)),
        Out(Bit("Y", 0o12), Bit("M", 500) & Bit("M", 8000) | Word("D", 0).differs(3) & M[1]),
    )


def steps() -> Program:
    timer = Timer(10, "pause")
    sequence = Steps(
        "arm",
        20,
        (
            Step("rest", [To("out", X[0]), To("in", X[1] & ~X[2])], waits_for="start"),
            Step("out", [To("in", X[2]), To("rest", X[4])], dwell=Dwell(timer, 200, X[5]), hold=[M[8]]),
            Step("in", [To("rest", timer.done | X[3]), To("in", X[6])], waits_for="end"),
        ),
        enable=~X[7],
        consumes=M[9],
    )
    return small(
        Set(sequence["rest"], Bit("M", 8002)),
        Set(M[9], X[1]),
        sequence,
        Out(M[8], any_of(*sequence.holding(M[8]))),
        Out(Bit("Y", 0), M[8]),
    )


@pytest.mark.parametrize("make", first_of([steps, timers, counters, logic]))
def test_complete_text_is_parsed(make: Callable[[], Program]) -> None:
    assert parsed(str(structured_text(make()))).data == "iec_source"


@pytest.mark.nightly
def test_complete_text_of_the_machine_is_parsed() -> None:
    """The complete text is parsed as one unit, which takes over a minute; the other tests parse single statements."""
    assert tree_of(TEXT, "iec_source").data == "iec_source"


@pytest.mark.parametrize(
    "program", [timers(), counters(), logic(), steps()], ids=["timers", "counters", "logic", "steps"]
)
@pytest.mark.parametrize("seed", first_of(range(4), 2))
def test_every_kind_of_rung_is_equivalent_to_the_soft_plc(program: Program, seed: int) -> None:
    watched(program, seed)


@pytest.mark.parametrize(
    ("program", "right", "wrong"),
    one_in(
        3,
        [
            (timers(), ">= 3;", "> 3;"),
            (timers(), "tick_100 := now_ms / 100", "tick_100 := now_ms / 10"),
            (timers(), "t246_since := -1", "t246_since := t246_since"),
            (timers(), "(now_ms MOD 1000) < 500", "(now_ms MOD 1000) > 500"),
            (counters(), "c200_value - 1", "c200_value + 1"),
            (counters(), "driven AND NOT", "driven AND"),
            (logic(), "NOT driven AND", "driven AND"),
            (logic(), "total > 32767", "total > 32768"),
            (counters(), "VAR RETAIN", "VAR"),
            (logic(), "NOT x3 OR x4", "NOT x3 OR NOT x4"),
            (logic(), "* INT_TO_LINT(d0) / 3", "* INT_TO_LINT(d0) / 4"),
            (logic(), "(d0 > 0)", "(d0 > 1)"),
            (logic(), "scaled > 32767", "scaled > 32766 + scaled"),
            (steps(), "arm_rest := FALSE", "arm_rest := TRUE"),
            (steps(), "arm_in_leaves := FALSE", "arm_in_leaves := TRUE"),
            (steps(), "arm_out_leaves := TRUE", "arm_out := FALSE"),
        ],
    ),
)
def test_single_mutation_is_detected(program: Program, right: str, wrong: str) -> None:
    text = str(structured_text(program))
    assert right in text
    with pytest.raises(AssertionError):
        watched(program, 2, 800, text.replace(right, wrong))


def test_32_bit_counter_passes_its_preset_up_and_down() -> None:
    program = small(Out(Bit("M", 8200), X[1]), Count(Counter(200), 2, X[0]), Out(M[0], Bit("C", 200)))
    text = str(structured_text(program))
    watched(program, text=text, inputs=2)
    for right, wrong in ((" = 2 - 1", " = 2"), ("(c200_value = 2) THEN", "(c200_value = 3) THEN")):
        assert right in text
        with pytest.raises(AssertionError):
            watched(program, text=text.replace(right, wrong), inputs=2)


def test_truncated_text_is_a_parse_error() -> None:
    with pytest.raises(LarkError):
        parsed(str(structured_text(small(Set(M[0], X[0])))).replace("END_IF;", "", 1))


@pytest.mark.parametrize(
    ("tag", "name"),
    [
        ("left.lift_down", "left_lift_down"),
        ("a--b..c", "a_b_c"),
        ("9 lives", "v_9_lives"),
        ("step", "v_step"),
        ("Left", "v_Left"),
        ("_x_", "x"),
        ("…", "v"),
    ],
)
def test_a_tag_becomes_an_identifier(tag: str, name: str) -> None:
    assert identifier(tag) == name


def test_tags_with_the_same_identifier_get_different_names() -> None:
    """Identifiers are unique regardless of case, and those of helper variables differ from those of tags."""
    items: list[Expr] = [Bit("X", 1, "a.b"), Bit("X", 2, "A_B"), Bit("X", 3, "a b"), Bit("X", 4, "now ms")]
    program = small(*(Out(Bit("M", n), when) for n, when in enumerate(items)), Out(Bit("Y", 0, "a.b"), X[1]))
    names = list(StProgram(str(structured_text(program))).variables)
    assert len(names) == len({name.lower() for name in names})
    watched(program)


def test_comment_cannot_be_closed_by_its_text() -> None:
    program = small(Out(Bit("Y", 0, "valve", "opens *) END_PROGRAM (* \u00b0C"), X[0]))
    text = str(structured_text(program))
    assert text.isascii()
    watched(program)
