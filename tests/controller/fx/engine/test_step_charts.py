"""Arbitrary step charts: the engine is compared with a direct implementation of fx2n.md 1.7, scan by scan."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from tests.sampling import examples

INPUTS = ("X0", "X1", "X2")
STATES = ("S20", "S21", "S22", "S23")
COILS = ("Y0", "Y1", "Y2")
Action = tuple[str, str, str]
"""Contact, instruction, device."""
Chart = list[tuple[tuple[str, ...], list[Action]]]
"""Steps in program order, each with its required states and its actions."""


@dataclass
class Machine:
    """Interpreter of the steps of a chart.

    Attributes:
        bits: Devices of the chart.
        active: Positions of the steps that were on at their last execution.
    """

    bits: dict[str, bool] = field(
        default_factory=lambda: dict.fromkeys((*INPUTS, *STATES, *COILS, "M8040"), False) | {"S20": True}
    )
    active: set[int] = field(default_factory=set)

    def scan(self, chart: Chart, levels: tuple[bool, ...], disabled: bool) -> None:
        bits = self.bits
        bits.update(zip(INPUTS, levels, strict=True), M8040=disabled)
        leaving: set[str] = set()
        for place, (states, actions) in enumerate(chart):
            if self._on(states):
                self.active.add(place)
                for contact, name, device in actions:
                    self._act(bits[contact], name, device, states, leaving)
            elif place in self.active:
                self.active.remove(place)
                for _, name, device in actions:
                    if name == "OUT" and device in COILS and not self._driven(chart, device):
                        bits[device] = False
        bits.update(dict.fromkeys(leaving, False))

    def _on(self, states: tuple[str, ...]) -> bool:
        return all(self.bits[state] for state in states)

    def _driven(self, chart: Chart, coil: str) -> bool:
        """Return whether an active step drives a coil."""
        return any(
            self._on(states) and coil in {d for _, name, d in actions if name == "OUT"} for states, actions in chart
        )

    def _act(self, power: bool, name: str, device: str, states: tuple[str, ...], leaving: set[str]) -> None:
        if device in STATES:
            if power and not self.bits["M8040"]:
                self.bits[device] = True
                leaving |= set(states)
                leaving.discard(device)
        elif name == "OUT":
            self.bits[device] = power
        elif power:
            self.bits[device] = name == "SET"


CONTACTS = st.sampled_from((*INPUTS, *COILS, *STATES))
ACTIONS = st.tuples(CONTACTS, st.sampled_from(("OUT", "SET", "RST")), st.sampled_from(COILS)) | st.tuples(
    CONTACTS, st.sampled_from(("OUT", "SET")), st.sampled_from(STATES)
)
PLACES = st.lists(st.sampled_from(STATES), min_size=1, max_size=2, unique=True).map(tuple)
CHARTS: st.SearchStrategy[Chart] = st.lists(
    st.tuples(PLACES, st.lists(ACTIONS, min_size=1, max_size=4)), min_size=2, max_size=6, unique_by=lambda step: step[0]
)
STORIES = st.lists(
    st.tuples(st.tuples(*[st.booleans()] * 3), st.integers(0, 3).map(lambda n: n == 0)), min_size=4, max_size=12
)


def text_of(chart: Chart) -> str:
    lines: list[str] = []
    for states, actions in chart:
        lines += [f"STL {state}" for state in states]
        for contact, name, device in actions:
            lines += [f"LD {contact}", f"{name} {device}"]
    return "\n".join([*lines, "RET", "END"])


@examples(20, nightly=40)
@given(CHARTS, STORIES)
def test_engine_agrees_with_the_rules_in_every_scan(chart: Chart, story: list[tuple[tuple[bool, ...], bool]]) -> None:
    compare(chart, story)


@pytest.mark.nightly
@settings(max_examples=1_000)
@given(CHARTS, STORIES)
def test_engine_agrees_with_the_rules_on_a_thousand_charts(
    chart: Chart, story: list[tuple[tuple[bool, ...], bool]]
) -> None:
    compare(chart, story)


def compare(chart: Chart, story: list[tuple[tuple[bool, ...], bool]]) -> None:
    plc = FxPlc(read_il(text_of(chart)), input_filter_ms=0)
    machine = Machine()
    plc.memory.S[20] = True
    for n, (levels, disabled) in enumerate(story):
        plc.memory.M[8040] = disabled
        plc.scan(10 * n, levels)
        machine.scan(chart, levels, disabled)
        actual = {name: plc.memory.bits(name[0])[int(name[1:])] for name in machine.bits}
        assert actual == machine.bits, f"scan {n}"
