"""Observation of scans: the same devices as without, contacts and power as the stack machine has them."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.fx.engine.cpu import index_register
from controller.fx.engine.plc import FxPlc
from controller.fx.language.cpu_model import FX2N, FX3U
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from controller.fx.observation.end_values import EndValues
from controller.fx.observation.observation import FlowState, ScanObservation, is_output
from controller.fx.observation.observed_plc import ObservedPlc
from tests.controller.fx.engine import test_executions as arbitrary
from tests.controller.fx.engine import test_networks as networks
from tests.controller.fx.engine.fx_pair import assert_equal
from tests.sampling import examples

ON, OFF, GREY, UNKNOWN = FlowState.ON, FlowState.OFF, FlowState.NOT_EXECUTED, FlowState.UNKNOWN


def ladder_of(text: str) -> Ladder:
    """Return a program given as instructions separated by slashes; END is appended."""
    return read_il("\n".join([*text.split(" / "), "END"]))


def states(observation: ScanObservation, ladder: Ladder) -> str:
    """Return the states as one letter for each instruction: on (1), off (0), not executed (-), unknown (?)."""
    letters = {ON: "1", OFF: "0", GREY: "-", UNKNOWN: "?"}
    return "".join(letters[observation.state(i, x)] for i, x in enumerate(ladder.instructions[:-1]))


def observed(text: str, *scans: str) -> list[str]:
    """Return the states of each scan; a scan is given by the names of the inputs that are on."""
    ladder = ladder_of(text)
    plc = ObservedPlc(ladder, input_filter_ms=0)
    result = []
    for n, names in enumerate(scans):
        plc.scan(10 * n, [f"X{k}" in names.split() for k in range(4)])
        result.append(states(plc.observation, ladder))
    return result


# ---- as executed ------------------------------------------------------------------------------------------------


def test_a_contact_has_the_value_of_the_time_when_its_rung_ran() -> None:
    text = "LD Y0 / OUT M0 / LD X0 / OUT Y0 / LDI Y0 / OUT M1 / LD X1 / OUT Y0"
    assert observed(text, "X0", "X1") == ["00110000", "00001111"]


def test_a_pulse_contact_is_on_in_one_scan() -> None:
    assert observed("LDP X0 / OUT Y0 / LDF X0 / OUT Y1", "", "X0", "X0", "") == ["0000", "1100", "0000", "0011"]


def test_a_jumped_rung_is_not_executed() -> None:
    text = "LD X0 / CJ P1 / LD X1 / OUT Y0 / P1 / LD X1 / OUT Y1"
    assert observed(text, "X1", "X0 X1") == ["0011111", "11--111"]


def test_a_zone_without_master_control_is_not_executed_and_its_coils_are_off() -> None:
    text = "LD X0 / MC N0 M50 / LD X1 / OUT Y0 / MCR N0 / LD X1 / OUT Y1"
    assert observed(text, "X1", "X0 X1") == ["00-0111", "1111111"]


def test_an_inactive_step_is_not_executed_and_its_coils_turn_off_once() -> None:
    text = "LD X0 / SET S20 / STL S20 / OUT Y0 / LD X1 / SET S21 / STL S21 / OUT Y1 / RET"
    assert observed(text, "", "X0", "X1", "", "") == [
        "000---0-1",
        "1111000-1",
        "001111111",
        "0000--111",
        "000---111",
    ]


def test_a_subroutine_that_is_not_called_is_not_executed() -> None:
    text = "LD X0 / CALL P1 / FEND / P1 / LD X1 / OUT Y0 / SRET"
    without, called = observed(text, "X1", "X0 X1")
    assert [each[:2] + each[3:6] for each in (without, called)] == ["00---", "11111"]


def test_loops_show_their_last_execution() -> None:
    text = "LD M8000 / MOV K0 D0 / FOR K3 / LD M8000 / INC D0 / LD= D0 K2 / OUT M0 / NEXT"
    assert observed(text, "")[0][3:7] == "1100"


def test_a_comparison_with_index_is_observed_without_an_error() -> None:
    """D0V0 is out of range: the comparison is not executed while X0 is off, and its trial reports nothing."""
    ladder = ladder_of("LD X0 / AND= D0V0 K0 / OUT Y0")
    plc = ObservedPlc(ladder, input_filter_ms=0)
    plc.memory.D[index_register("V0")] = 9000
    seen = []
    for now_ms, level in ((0, False), (10, True)):
        plc.scan(now_ms, [level])
        seen.append((plc.memory.M[8067], states(plc.observation, ladder)))
    assert seen == [(False, "000"), (True, "100")]


def check_equal_devices(text: str, story: list[arbitrary.FxScan]) -> None:
    """Run a program with and without observation, and compare all devices after every scan."""
    ladder = read_il(text, cpu=FX3U if "D3." in text else FX2N)
    plain, plc = FxPlc(ladder, input_filter_ms=0), ObservedPlc(ladder, input_filter_ms=0)
    now_ms = 0
    for scanned in story:
        now_ms += scanned.pause_ms
        for each in (plain, plc):
            if scanned.command:
                getattr(each, scanned.command)()
            each.memory.D[8000] = 2
            if scanned.register is not None:
                name, value = scanned.register
                each.memory.D[int(name[1:]) if name[0] == "D" else index_register(name)] = value
            each.scan(now_ms, scanned.levels)
        assert_equal(plain, plc)
        if not plc.running:
            continue
        for i, instruction in enumerate(ladder.instructions):
            if is_output(instruction) and plc.observation.executed[i]:
                assert plc.observation.coils[i] is not None


@examples(10, nightly=100)
@given(arbitrary.programs(), arbitrary.STORIES)
def test_observation_changes_no_device(text: str, story: list[arbitrary.FxScan]) -> None:
    check_equal_devices(text, story)


@pytest.mark.nightly
@pytest.mark.timeout(3_600)
@settings(max_examples=1_000)
@given(arbitrary.programs(), arbitrary.STORIES)
def test_observation_changes_no_device_in_a_thousand_programs(text: str, story: list[arbitrary.FxScan]) -> None:
    check_equal_devices(text, story)


# ---- compared with the stack machine ----------------------------------------------------------------------------

JOINED = networks.NETWORKS | networks.CONTROLLED


def check_network(lines: list[networks.Line], story: list[networks.Levels]) -> None:
    """Compare both views of every scan with the stack machine."""
    ladder = read_il("\n".join(networks.text_of(lines)))
    plc, end, machine = ObservedPlc(ladder, input_filter_ms=0), EndValues(ladder), networks.Machine()
    for n, levels in enumerate(story):
        plc.scan(10 * n, levels)
        machine.scan(lines, levels)
        seen = plc.observation
        for at in range(len(lines)):
            where = f"scan {n}, line {at}, {lines[at]}"
            if at in machine.powers:
                assert seen.powers[at] == machine.powers[at], where
                assert seen.contacts[at] == machine.contacts.get(at), where
            elif lines[at][0] != "MCR N0":
                assert (seen.executed[at], seen.powers[at]) == (False, False), where
        check_end_values(lines, machine, end.observe(plc.memory))


def check_end_values(lines: list[networks.Line], machine: networks.Machine, seen: ScanObservation) -> None:
    """Compare END values with all results that the stack machine has for the possible values of pulse contacts."""
    pulses = [at for at, (name, _) in enumerate(lines) if name[-1] in "PF" and name[:2] in ("LD", "AN", "OR")][:8]
    if len(pulses) == 8:
        return
    results: list[dict[int, bool]] = []
    for values in product((False, True), repeat=len(pulses)):
        results.append(end_powers(lines, machine.bits, dict(zip(pulses, values, strict=True))))
    for at, (name, device) in enumerate(lines):
        possible = {result.get(at) for result in results}
        expected = possible.pop() if len(possible) == 1 else None
        if expected is None and possible == set():  # in a zone without master control
            assert seen.executed[at] is False or name == "MCR N0", (at, lines)
        elif name != "MCR N0":
            assert seen.powers[at] == expected, (at, lines)
        if name in ("OUT", "SET", "RST", "PLS", "PLF", "MC N0"):
            assert seen.coils[at] == machine.bits[device]


def end_powers(lines: list[networks.Line], bits: dict[str, bool], pulses: dict[int, bool]) -> dict[int, bool]:
    """Return the power after each line, evaluated from fixed devices and given pulses."""
    machine = networks.Machine(FixedBits(bits))
    machine.fixed = pulses
    machine.scan(lines, tuple(bits[name] for name in networks.INPUTS))  # type: ignore[arg-type]
    return dict(machine.powers)


class FixedBits(dict[str, bool]):
    """Devices that coils do not change."""

    def __setitem__(self, name: str, value: bool) -> None:
        pass


@examples(20, nightly=100)
@given(JOINED, networks.STORIES)
def test_contacts_and_power_agree_with_the_stack_machine(
    lines: list[networks.Line], story: list[networks.Levels]
) -> None:
    check_network(lines, story[:5])


@pytest.mark.nightly
@settings(max_examples=1_000)
@given(JOINED, networks.STORIES)
def test_a_thousand_networks_agree_with_the_stack_machine(
    lines: list[networks.Line], story: list[networks.Levels]
) -> None:
    check_network(lines, story)


# ---- END values -------------------------------------------------------------------------------------------------


def end_values(text: str, *scans: str) -> str:
    """Return the END values after the last of some scans."""
    ladder = ladder_of(text)
    plc = FxPlc(ladder, input_filter_ms=0)
    for n, names in enumerate(scans):
        plc.scan(10 * n, [f"X{k}" in names.split() for k in range(4)])
    return states(EndValues(ladder).observe(plc.memory), ladder)


def test_end_values_show_a_double_coil_as_its_device_is_at_end() -> None:
    text = "LD X0 / OUT Y0 / LD Y0 / OUT M1 / LD X1 / OUT Y0"
    assert end_values(text, "X0") == "100100"
    assert observed(text, "X0") == ["111100"]


def test_a_pulse_contact_is_unknown_in_end_values() -> None:
    ladder = ladder_of("LDP X0 / AND X1 / OUT Y0 / LDP X0 / OR X2 / OUT Y1")
    plc = FxPlc(ladder, input_filter_ms=0)
    plc.scan(0, [True, False, True])
    seen = EndValues(ladder).observe(plc.memory)
    assert seen.contacts[:6] == (None, False, None, None, True, None)
    assert seen.powers[:6] == (None, False, False, None, True, True)
    assert states(seen, ladder) == "?00?11"


def test_an_inverted_pulse_is_unknown_in_end_values() -> None:
    ladder = ladder_of("LDP X0 / INV / ANDP X1 / OUT Y0")
    assert EndValues(ladder).observe(FxPlc(ladder).memory).powers[:4] == (None, None, None, None)


def test_end_values_of_steps_zones_and_timers() -> None:
    text = "LD X0 / MC N0 M50 / LD X1 / OUT Y0 / MCR N0 / LD X1 / OUT T0 K5 / STL S20 / OUT Y1 / RET"
    assert end_values(text, "X1") == "00-0111001"
    assert end_values(text, "X0") == "1100100001"


@given(st.booleans())
@settings(max_examples=2)
def test_end_values_do_not_change_the_memory(level: bool) -> None:
    ladder = ladder_of("LD X0 / OUT Y0 / SET M0 / INC D0")
    plc = FxPlc(ladder, input_filter_ms=0)
    plc.scan(0, [level])
    before = plc.memory.Y.copy(), plc.memory.M.copy(), plc.memory.D.copy()
    EndValues(ladder).observe(plc.memory)
    assert before == (plc.memory.Y, plc.memory.M, plc.memory.D)
