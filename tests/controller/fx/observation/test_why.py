"""Minimal sets of contacts, compared with all subsets on arbitrary networks."""

from __future__ import annotations

from itertools import chain, combinations

import pytest
from hypothesis import given, settings

from controller.fx.language.il import read_il
from controller.fx.language.rung_shapes import rungs_of
from controller.fx.observation.observed_plc import ObservedPlc
from controller.fx.observation.why import OutputReason, Reasons
from tests.controller.fx.engine import test_networks as networks
from tests.sampling import examples

Signal = tuple[str | int, bool]
"""Device with its level, or the index of a pulse contact."""
MOST_SIGNALS = 7
"""Number of signals of an output up to which all subsets are tried."""


def power_at(lines: list[networks.Line], at: int, levels: dict[int, bool]) -> bool:
    """Return the power of an output, given the value of each contact before INV: a second, simple evaluation."""
    machine = networks.Machine()
    machine.fixed = levels
    machine.scan(lines[: at + 1], (False,) * 4)
    return machine.powers[at]


def signal_of(lines: list[networks.Line], machine: networks.Machine, i: int) -> Signal:
    """Return what a contact reads: a device with its level, or one pulse contact."""
    name, device = lines[i]
    return (i, False) if name[-1] in "PF" else (device, machine.contacts[i] != name.endswith("I"))


def all_minimal_sets(
    lines: list[networks.Line], at: int, first: int, machine: networks.Machine
) -> set[frozenset[Signal]]:
    """Return the minimal sets of signals that invert an output, by trying all subsets of its contacts."""
    contacts = {i: value for i, value in machine.contacts.items() if first <= i < at}
    signals: dict[Signal, list[int]] = {}
    for i in contacts:
        signals.setdefault(signal_of(lines, machine, i), []).append(i)
    if len(signals) > MOST_SIGNALS:
        return set()
    keys = list(signals)
    before = machine.powers[at]
    minimal: list[frozenset[Signal]] = []
    subsets = chain.from_iterable(combinations(keys, size) for size in range(len(keys) + 1))
    for subset in subsets:
        part = frozenset(subset)
        if any(each <= part for each in minimal):
            continue
        changed = {i for key in subset for i in signals[key]}
        if power_at(lines, at, {i: value != (i in changed) for i, value in contacts.items()}) != before:
            minimal.append(part)
    return set(minimal)


def check_reasons(lines: list[networks.Line], story: list[networks.Levels]) -> int:
    """Compare the sets of all outputs in some scans; return the number of compared outputs."""
    ladder = read_il("\n".join(networks.text_of(lines)))
    plc, machine, reasons = ObservedPlc(ladder, input_filter_ms=0), networks.Machine(), Reasons(ladder)
    compared = 0
    for n, levels in enumerate(story):
        plc.scan(10 * n, levels)
        machine.scan(lines, levels)
        for at, (name, _) in enumerate(lines):
            if name not in ("OUT", "SET", "RST", "PLS", "PLF"):
                continue
            first = max(rung.first for rung in rungs_of(ladder) if rung.first <= at)
            expected = all_minimal_sets(lines, at, first, machine)
            if not expected:
                continue
            found = reasons.of_output(at, plc.observation, most=10_000)
            assert found.complete
            sets = {
                frozenset(signal_of(lines, machine, change.contacts[0]) for change in each.changes)
                for each in found.sets
            }
            assert sets == expected, (n, at, lines)
            sizes = [len(each.changes) for each in found.sets]
            assert sizes == sorted(sizes)
            compared += 1
    return compared


@examples(20, nightly=100)
@given(networks.NETWORKS, networks.STORIES)
def test_sets_are_those_of_all_subsets(lines: list[networks.Line], story: list[networks.Levels]) -> None:
    check_reasons(lines, story[:2])


@pytest.mark.nightly
@pytest.mark.timeout(3_600)
@settings(max_examples=1_000)
@given(networks.NETWORKS, networks.STORIES)
def test_sets_are_those_of_all_subsets_in_a_thousand_networks(
    lines: list[networks.Line], story: list[networks.Levels]
) -> None:
    check_reasons(lines, story[:4])


def reason_of(text: str, levels: list[bool], causes: tuple[str, ...] = (), most: int = 5, at: int = -2) -> OutputReason:
    """Return the reason for an output of a program; the default is the last instruction before END."""
    ladder = read_il("\n".join([*text.split(" / "), "END"]))
    plc = ObservedPlc(ladder, input_filter_ms=0)
    plc.scan(0, levels)
    reasons = Reasons(ladder, lambda key: f"{key[0]}{key[1]}" in causes)
    return reasons.of_output(at % len(ladder.instructions), plc.observation, most)


def changes(reason: OutputReason) -> list[list[tuple[str, bool]]]:
    return [[(f"{c.device[0]}{c.device[1]}", c.on) for c in each.changes if c.device] for each in reason.sets]


def test_all_open_contacts_of_a_series_must_change() -> None:
    reason = reason_of("LD X0 / ANI X1 / AND X2 / OUT Y0", [False, True, True])
    assert (reason.executed, reason.driven, reason.complete) == (True, False, True)
    assert changes(reason) == [[("X0", True), ("X1", False)]]


def test_one_parallel_contact_is_enough_and_smaller_sets_are_first() -> None:
    reason = reason_of("LD X0 / AND X1 / OR X2 / OUT Y0", [False, False, False])
    assert changes(reason) == [[("X2", True)], [("X0", True), ("X1", True)]]
    assert not reason_of("LD X0 / AND X1 / OR X2 / OUT Y0", [False, False, False], most=1).complete


def test_both_contacts_of_a_device_change_together() -> None:
    """X0 must be on for one contact and off for the other, so only M0 helps."""
    reason = reason_of("LD X0 / ANI X0 / OR M0 / OUT Y0", [False])
    assert changes(reason) == [[("M0", True)]]


def test_a_guard_is_a_cause_and_never_a_change() -> None:
    reason = reason_of("LD X0 / AND X1 / OUT Y0", [False, False], causes=("X1",))
    (only,) = reason.sets
    assert [(c.device, c.on) for c in only.changes] == [(("X", 0), True)]
    assert [(c.device, c.on) for c in only.causes] == [(("X", 1), True)]


def test_an_output_that_is_on_turns_off_by_any_contact_in_series() -> None:
    reason = reason_of("LD X0 / AND X1 / OUT Y0", [True, True])
    assert reason.driven
    assert changes(reason) == [[("X0", False)], [("X1", False)]]


def test_an_output_in_an_inactive_step_is_not_executed() -> None:
    reason = reason_of("LD X0 / SET S20 / STL S20 / LD X1 / OUT Y0 / RET", [False], at=4)
    assert not reason.executed
    assert reason.sets == ()


# devices with several outputs


WRITERS = ("OUT", "SET", "RST")


def device_at_end(lines: list[networks.Line], device: str, levels: dict[int, bool], before: dict[str, bool]) -> bool:
    """Return a device at END of a scan with given values of the contacts: a second, simple evaluation."""
    machine = networks.Machine(bits=dict(before))
    machine.fixed = levels
    machine.scan(lines, (False,) * 4)
    return machine.bits[device]


def check_devices(lines: list[networks.Line], story: list[networks.Levels]) -> int:
    """Compare the sets of all devices in some scans with all subsets of contacts; return the number of comparisons."""
    ladder = read_il("\n".join(networks.text_of(lines)))
    plc, machine, reasons = ObservedPlc(ladder, input_filter_ms=0), networks.Machine(), Reasons(ladder)
    compared = 0
    for n, levels in enumerate(story):
        before = dict(machine.bits)
        plc.scan(10 * n, levels)
        machine.scan(lines, levels)
        for device in networks.COILS:
            writers = [at for at, (_, written) in enumerate(lines) if written == device and is_written(lines[at])]
            if not writers or any(lines[at][0] not in WRITERS for at in writers):
                continue
            found = reasons.of_device(writers, before[device], plc.observation, most=10_000)
            assert found.driven == machine.bits[device], (n, device, lines)
            expected = minimal_changes(lines, device, machine, before)
            if expected is None:
                continue
            sets = {
                frozenset(signal_of(lines, machine, change.contacts[0]) for change in each.changes)
                for each in found.sets
            }
            assert sets == expected, (n, device, lines)
            compared += 1
    return compared


def is_written(line: networks.Line) -> bool:
    return line[0] in ("OUT", "SET", "RST", "PLS", "PLF")


def minimal_changes(
    lines: list[networks.Line], device: str, machine: networks.Machine, before: dict[str, bool]
) -> set[frozenset[Signal]] | None:
    """Return the minimal sets of signals that invert a device, by trying all subsets; None if there are too many."""
    contacts = dict(machine.contacts)
    signals: dict[Signal, list[int]] = {}
    for i in contacts:
        signals.setdefault(signal_of(lines, machine, i), []).append(i)
    if len(signals) > MOST_SIGNALS:
        return None
    minimal: list[frozenset[Signal]] = []
    for subset in chain.from_iterable(combinations(signals, size) for size in range(len(signals) + 1)):
        part = frozenset(subset)
        if any(each <= part for each in minimal):
            continue
        changed = {i for key in subset for i in signals[key]}
        tried = {i: value != (i in changed) for i, value in contacts.items()}
        if device_at_end(lines, device, tried, before) != machine.bits[device]:
            minimal.append(part)
    return set(minimal)


@examples(20, nightly=100)
@given(networks.NETWORKS, networks.STORIES)
def test_sets_of_a_device_are_those_of_all_subsets(lines: list[networks.Line], story: list[networks.Levels]) -> None:
    check_devices(lines, story[:2])


@pytest.mark.nightly
@pytest.mark.timeout(3_600)
@settings(max_examples=1_000)
@given(networks.NETWORKS, networks.STORIES)
def test_sets_of_a_device_are_those_of_all_subsets_in_a_thousand_networks(
    lines: list[networks.Line], story: list[networks.Levels]
) -> None:
    check_devices(lines, story[:4])


def device_reason(text: str, levels: list[bool], writers: list[int], *, before: bool = False) -> OutputReason:
    ladder = read_il("\n".join([*text.split(" / "), "END"]))
    plc = ObservedPlc(ladder, input_filter_ms=0)
    plc.scan(0, levels)
    return Reasons(ladder).of_device(writers, before, plc.observation)


def test_of_two_coils_the_last_one_counts() -> None:
    reason = device_reason("LD X0 / OUT Y0 / LD X1 / OUT Y0", [True, False], [1, 3])
    assert changes(reason) == [[("X1", True)]]


def test_a_device_turns_on_only_if_it_is_set_and_not_reset() -> None:
    reason = device_reason("LD X0 / SET M0 / LD X1 / RST M0", [False, True], [1, 3])
    assert changes(reason) == [[("X0", True), ("X1", False)]]


def test_a_device_that_stays_set_turns_off_by_its_reset_alone() -> None:
    reason = device_reason("LD X0 / SET M0 / LD X1 / RST M0", [False, False], [1, 3], before=True)
    assert reason.driven
    assert changes(reason) == [[("X1", True)]]


def test_a_timer_contact_and_a_comparison_are_one_change_each() -> None:
    reason = device_reason("LD X0 / OUT T0 K10 / LD T0 / AND= D0 K5 / OUT Y0", [True], [4])
    assert [[change.device for change in each.changes] for each in reason.sets] == [[("T", 0), None]]


def test_a_jumped_output_and_one_in_a_zone_without_power_have_no_effect() -> None:
    jumped = device_reason("LD X0 / CJ P0 / LD X1 / OUT Y0 / P0 / LD X2 / OUT Y1", [True, True], [3], before=True)
    assert (jumped.executed, jumped.driven, jumped.sets) == (False, True, ())
    zone = device_reason("LD X0 / MC N0 M100 / LD X1 / SET Y0 / MCR N0", [False, True], [3])
    assert (zone.executed, zone.driven) == (False, False)
    coil = device_reason("LD X0 / MC N0 M100 / LD X1 / OUT Y0 / MCR N0", [False, True], [3], before=True)
    assert (coil.executed, coil.driven, coil.sets) == (False, False, ())
