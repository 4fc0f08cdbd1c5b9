"""Reasons shown for a jogged output that stays off or moves nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from controller.core.devices import Memory
from controller.core.expr import Bit, Word, evaluate, leaves
from controller.hmi.panel.orders.jog_reasons import foreseen_obstacle, jog_obstacle
from controller.program.interlocks import Rule
from controller.program.machine import build
from controller.program.operator.commands import JOG_LEASE_MS, JOGGED
from controller.program.states import Mode, State
from controller.program.texts.interlocks import AT_END, RULES
from plant_sim.twin.lock_step import Twin
from tests.controller.hmi.panel.panel_rig import PanelRig
from tests.controller.hmi.panel.test_chinese import latin_words, punctuation_errors
from tests.controller.hmi.panel.test_jog import jog
from tests.controller.program.interlock_scene import MACHINE
from tests.plant_sim.twin.twin_rig import switched_on
from tests.sampling import one_in
from tests.wiring import wired

AT_FEED = {
    "lift_extend": RULES["load down only when spread"],
    "lift_retract": AT_END,
    "slide_inward": RULES["inward ready"],
    "slide_outward": AT_END,
    "converge": RULES["converge only when empty at feed"],
    "spread": None,
    "claws_close": None,
    "claws_open": RULES["release load only at cups or row"],
    "tray_run": None,
}
"""Reason for each output of arms that are up at the feed position and count as loaded, as after the first power-up."""
MOST_RENEWALS = 300
"""Renewals of a jog, ten scans apart, until the view shows that the program has received it: the end of a hang."""


def rules_of(output: str) -> list[Rule]:
    """Return the rules of an output."""
    side, _, name = output.rpartition(".")
    return [rule for rule in MACHINE.rule_groups[side or "tray"] if name in rule.outputs]


def test_every_rule_has_a_reason_in_both_languages() -> None:
    names = {rule.name for rules in build(wired("guard")).rule_groups.values() for rule in rules}
    assert names == set(RULES)
    for text in (*RULES.values(), AT_END):
        assert text.en.isascii()
        assert latin_words(text.zh) == []
        assert punctuation_errors(text.zh) == []


def put(memory: Memory, device: Bit | Word, value: int) -> int:
    """Set a device; return its value before."""
    if isinstance(device, Word):
        before = memory.word(device.kind, device.number)
        memory.set_word(device.kind, device.number, value)
        return before
    bits = memory.bits(device.kind)
    before, bits[device.number] = bits[device.number], bool(value)
    return before


def scenes(rules: list[Rule], seed: int, count: int) -> Iterator[Memory]:
    """Yield one memory again and again, each time with another random value of a device that the rules read.

    A value is undone if an earlier rule blocks with it, so that each rule is the first that blocks at some time, and
    no rule does in the end.
    """
    random, memory, reached = Random(seed), Memory(), 0
    read = sorted({device for rule in rules for device in leaves(rule.allow)}, key=str)
    for _ in range(count):
        device = random.choice(read)
        before = put(memory, device, random.randrange(4 if isinstance(device, Word) else 2))
        yield memory
        first = next((n for n, rule in enumerate(rules) if not evaluate(rule.allow, memory)), len(rules))
        if first < reached:
            put(memory, device, before)
        reached = max(first, reached)


@pytest.mark.parametrize("output", one_in(9, JOGGED))
def test_the_reason_is_that_of_the_first_rule_that_blocks(output: str) -> None:
    """Every rule of the output is the reason in some scene; if none blocks, only the end of the motion can be."""
    rules, given, free = rules_of(output), set(), 0
    for memory in scenes(rules, 1, 4_000):
        blocking = [rule.name for rule in rules if not evaluate(rule.allow, memory)]
        reason = jog_obstacle(MACHINE, memory, output)
        if blocking:
            assert reason == RULES[blocking[0]]
            given.add(blocking[0])
        else:
            assert reason in (None, AT_END)
            free += 1
    assert given == {rule.name for rule in rules}
    assert free > 0


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[PanelRig]:
    with PanelRig(tmp_path, homed_in_manual_mode()) as rig:
        yield rig


def homed_in_manual_mode() -> Twin:
    """Return a machine in manual mode that has been homed before, so that all places are confirmed."""
    twin = switched_on()
    twin.home()
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=10_000)
    twin.run_for(300)
    twin.command(f"mode_{Mode.MANUAL.name.lower()}")
    twin.home()
    twin.start()
    return twin


@pytest.mark.parametrize("output", one_in(3, [output for output in JOGGED if not output.startswith("right.")]))
def test_a_held_jog_moves_its_device_or_tells_why_not(
    rig: PanelRig, output: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a homed machine in manual mode; the reason ends with the jog."""
    monkeypatch.setattr("controller.hmi.panel.orders.jog.LEASE_MS", 10 * JOG_LEASE_MS)  # for a busy computer
    with rig.browser("maintain") as browser:
        for _ in range(MOST_RENEWALS):
            reply = jog(browser, output)
            assert reply["ok"], reply
            rig.for_scans(10)
            if browser.view["jog"]["requested"]:
                break
        shown = {**browser.view["jog"]}
        browser.order(type="jog", output=output, hold=False)
        ended = browser.until(lambda view: view["jog"]["output"] is None)
    expected = AT_FEED[output.rpartition(".")[2]]
    assert shown == {
        "output": output,
        "requested": True,
        "why": None if expected is None else {"en": expected.en, "zh": expected.zh},
    }
    assert ended["jog"]["why"] is None


def test_nothing_is_foreseen_as_long_as_the_jog_of_another_output_is_known() -> None:
    """From up quickly to down, *the opposite motion is requested* would be wrong."""
    jog, memory = MACHINE.tags.machine.jog, Memory()
    own, opposite = (1 + JOGGED.index(f"left.{name}") for name in ("lift_extend", "lift_retract"))
    for known, foreseen in ((0, True), (own, True), (opposite, False)):
        memory.set_word(jog.kind, jog.number, known)
        assert (foreseen_obstacle(MACHINE, memory, "left.lift_extend") is not None) is foreseen
        assert memory.word(jog.kind, jog.number) == known
