"""Arbitrary networks: the engine is compared with a simple stack machine, scan by scan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from tests.sampling import examples

INPUTS = ("X0", "X1", "X2", "X3")
COILS = ("Y0", "Y1", "M0", "M1", "M2")
Line = tuple[str, str]
Levels = tuple[bool, bool, bool, bool]


@dataclass
class Machine:
    """Stack machine for contacts, blocks, branches and coils, with master control.

    Attributes:
        bits: Devices of the networks.
        before: Level at the last execution of each edge instruction, by line.
        fixed: Values of contacts that are given, by line.
        contacts: Value of each contact in this scan, by line.
        powers: Power after each line in this scan, without master control for contacts; only lines in a zone with
            master control.
    """

    bits: dict[str, bool] = field(default_factory=lambda: dict.fromkeys((*INPUTS, *COILS, "M100"), False))
    before: dict[int, bool] = field(default_factory=dict)
    fixed: dict[int, bool] = field(default_factory=dict)
    contacts: dict[int, bool] = field(default_factory=dict)
    powers: dict[int, bool] = field(default_factory=dict)

    def scan(self, lines: list[Line], levels: Levels) -> None:
        self.bits.update(zip(INPUTS, levels, strict=True))
        results: list[bool] = []
        branches: list[bool] = []
        gate = True
        self.contacts.clear()
        self.powers.clear()
        for at, (name, device) in enumerate(lines):
            match name:
                case "ANB":
                    last = results.pop()
                    results[-1] = results[-1] and last
                case "ORB":
                    last = results.pop()
                    results[-1] = results[-1] or last
                case "INV":
                    results[-1] = not results[-1]
                case "MPS":
                    branches.append(results[-1])
                case "MRD":
                    results[-1] = branches[-1]
                case "MPP":
                    results[-1] = branches.pop()
                case "MC N0":
                    self.bits[device] = results[-1]
                    gate = self.bits[device]
                case "MCR N0":
                    gate = True
                case "OUT":
                    self.bits[device] = gate and results[-1]
                case "SET" | "RST":
                    if gate and results[-1]:
                        self.bits[device] = name == "SET"
                case "PLS" | "PLF":
                    self.bits[device] = self._edge(at, gate and results[-1], falling=name == "PLF")
                case _:
                    self._contact(at, name, device, results)
            if (gate or name == "MC N0") and name != "MCR N0":
                self.powers[at] = results[-1]

    def _contact(self, at: int, name: str, device: str, results: list[bool]) -> None:
        value = self.bits[device]
        if at in self.fixed:
            value = self.fixed[at]
        elif name.endswith("I"):
            value = not value
        elif name[-1] in "PF":
            value = self._edge(at, value, falling=name[-1] == "F")
        self.contacts[at] = value
        if name.startswith("LD"):
            results.append(value)
        elif name.startswith("A"):
            results[-1] = results[-1] and value
        else:
            results[-1] = results[-1] or value

    def _edge(self, at: int, value: bool, *, falling: bool) -> bool:
        before, self.before[at] = self.before.get(at, False), value
        return before and not value if falling else value and not before


DEVICES = st.sampled_from((*INPUTS, *COILS))
DRIVES = st.tuples(st.sampled_from(("OUT", "OUT", "SET", "RST")), st.sampled_from(COILS)) | st.tuples(
    st.sampled_from(("PLS", "PLF")), st.sampled_from(COILS)
)


def contacts(*names: str) -> st.SearchStrategy[list[Line]]:
    return st.tuples(st.sampled_from(names), DEVICES).map(lambda line: [line])


LOADS = contacts("LD", "LDI", "LDP", "LDF")
SERIES = contacts("AND", "ANI", "ANDP", "ANDF")
PARALLEL = contacts("OR", "ORI", "ORP", "ORF")
INVERTED = st.just([("INV", "")])


def joined(parts: list[list[Line]]) -> list[Line]:
    return [line for part in parts for line in part]


def blocks(depth: int) -> st.SearchStrategy[list[Line]]:
    """Return a strategy for blocks: a load instruction followed by contacts and nested blocks."""
    more = SERIES | PARALLEL | INVERTED
    if depth:
        more |= st.tuples(blocks(depth - 1), st.sampled_from(("ANB", "ORB"))).map(
            lambda part: [*part[0], (part[1], "")]
        )
    return st.tuples(LOADS, st.lists(more, max_size=3)).map(lambda part: [*part[0], *joined(part[1])])


@st.composite
def branched(draw: st.DrawFn) -> list[Line]:
    """Draw the branches of a rung; each has up to two contacts or blocks in series and one output."""
    lines: list[Line] = []
    for name in ("MPS", *draw(st.lists(st.just("MRD"), max_size=2)), "MPP"):
        series = SERIES | blocks(1).map(lambda block: [*block, ("ANB", "")])
        lines += [(name, ""), *joined(draw(st.lists(series, max_size=2))), draw(DRIVES)]
    return lines


RUNGS = st.tuples(blocks(2), branched() | st.lists(DRIVES, min_size=1, max_size=2)).map(lambda part: part[0] + part[1])
SEAL_INS = st.tuples(DEVICES, st.sampled_from(COILS), DEVICES).map(
    lambda names: [("LD", names[0]), ("OR", names[1]), ("ANI", names[2]), ("OUT", names[1])]
)
NETWORKS = st.lists(RUNGS | SEAL_INS, min_size=1, max_size=4).map(joined)
CONTROLLED = st.tuples(NETWORKS, LOADS, NETWORKS, NETWORKS).map(
    lambda part: [*part[0], *part[1], ("MC N0", "M100"), *part[2], ("MCR N0", ""), *part[3]]
)
STORIES = st.lists(st.tuples(*[st.booleans()] * 4), min_size=4, max_size=12)


def text_of(lines: list[Line]) -> Iterator[str]:
    yield from (f"{name} {device}".strip() for name, device in lines)
    yield "END"


@examples(12, nightly=25)
@given(NETWORKS | CONTROLLED, STORIES)
def test_engine_and_stack_machine_agree_in_every_scan(lines: list[Line], story: list[Levels]) -> None:
    compare(lines, story)


@pytest.mark.nightly
@settings(max_examples=1_000)
@given(NETWORKS | CONTROLLED, STORIES)
def test_engine_and_stack_machine_agree_on_a_thousand_networks(lines: list[Line], story: list[Levels]) -> None:
    compare(lines, story)


def compare(lines: list[Line], story: list[Levels]) -> None:
    plc = FxPlc(read_il("\n".join(text_of(lines))), input_filter_ms=0)
    machine = Machine()
    for n, levels in enumerate(story):
        plc.scan(10 * n, levels)
        machine.scan(lines, levels)
        memory = plc.memory
        actual = {name: memory.bits(name[0])[int(name[1:])] for name in machine.bits}
        assert actual == machine.bits, f"scan {n}"
