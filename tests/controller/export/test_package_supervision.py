"""Supervision of packages: a wrong clock, a silent link or a lost memory is safe, and every part of it is needed."""

from __future__ import annotations

import pytest

from controller.export.runtime_parts.inputs import FIRST_EXCHANGE_MS, LINK_LIMIT_MS
from controller.export.runtime_parts.part import SCAN_MS
from controller.export.runtime_parts.scan_clock import SCAN_LIMIT_MS, WINDOW_S
from controller.program.operator.refusals import Refusal
from controller.program.states import State
from controller.program.tags import COMING, FORGOTTEN
from tests.controller.export.package_rig import MOVERS, PLACES, PackageRig, homing, rig
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of, one_in

TARGETS = sorted(PLACES)

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


WRONG_CLOCKS = [
    (0, SCAN_LIMIT_MS),
    (5, 2 * SCAN_LIMIT_MS),
    (20, SCAN_LIMIT_MS),
    (9, 10 * SCAN_LIMIT_MS),
    (SCAN_LIMIT_MS + 20, 0),
]
"""Advance per scan and time until the difference is permitted no longer, ms: the clock stands, runs at half, double and
nine tenths of its speed, and has a gap."""
CLOCKS_OF_TARGETS = [
    (TARGETS[(n + shift) % len(TARGETS)], *clock)
    for shift in range(len(TARGETS))
    for n, clock in enumerate(WRONG_CLOCKS)
]


@pytest.mark.parametrize(("target", "clock_ms", "counted_ms"), first_of(CLOCKS_OF_TARGETS))
def test_a_wrong_clock_stops_the_machine(target: str, clock_ms: int, counted_ms: int) -> None:
    """The outputs are safe within three scans of the difference that is permitted, and the alarm is on."""
    machine = homing(target)
    assert is_safe(machine, run(machine, counted_ms // SCAN_MS + 3, clock_ms=clock_ms), 902)
    assert not machine.alarm(901)


@pytest.mark.parametrize(
    ("target", "disturbed", "scans", "alarm", "part", "damaged"),
    one_in(
        2,
        [
            ("plain", {"clock_ms": 0}, 30, 902, DIFFER, f"v_clocks_differ = False and ({DIFFER[19:]}"),
            (
                "plain",
                {"clock_ms": 0},
                30,
                902,
                "if (v_clocks_differ):\n    v_scan_fault = True",
                "if False:\n    pass",
            ),
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
    ),
)
def test_each_part_of_the_supervision_is_needed(
    target: str, disturbed: dict[str, int], scans: int, alarm: int, part: str, damaged: str
) -> None:
    """The outputs become safe, but not if the statement that detects the fault is damaged."""
    machine, blind = homing(target), homing(target, (part, damaged))
    assert is_safe(machine, run(machine, scans, **disturbed), alarm)
    assert not is_safe(blind, run(blind, scans, **disturbed), alarm)


@pytest.mark.parametrize("target", first_of(TARGETS))
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


@pytest.mark.nightly
def test_setting_the_utc_clock_is_no_fault() -> None:
    machine = homing("openplc")
    for step_ms in (3_600_000, -7_200_000, 2_500):
        machine.utc_ms += step_ms
        run(machine, 1_200)
    assert not machine.alarm(902)
    assert machine.is_in(State.HELD), "homing ends with a question, because the memory is lost"


@pytest.mark.nightly
@pytest.mark.parametrize("target", TARGETS)
def test_the_fault_ends_after_a_window_in_which_the_clocks_agree(target: str) -> None:
    """The operator can then clear it by a press of the stop button, as after a scan fault of the soft PLC."""
    machine = homing(target)
    run(machine, 40, clock_ms=0)
    _press_stop(machine)
    assert machine.is_in(State.ABORTED), "the clocks have not yet agreed for a window"
    run(machine, 1_000 * WINDOW_S // SCAN_MS)
    _press_stop(machine)
    assert machine.is_in(State.STOPPED)


def _press_stop(machine: PackageRig) -> None:
    """Press X24 for 3.5 s and release it."""
    machine.module.plant.box.stop = True
    run(machine, 350)
    machine.module.plant.box.stop = False
    run(machine, 5)


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


def test_openplc_restores_the_set_points_and_nothing_else() -> None:
    """A set-point of zero is restored as well; state and places are unknown, and the loss is reported."""
    machine = homing("openplc")
    machine.plc.write("QW923", 0)  # D523, pause at feed
    machine.plc.write("QW921", 90)  # D521, clamp: a machine constant
    machine.plc.write("QW934", 77)  # D534, shortest time from cup to cup
    run(machine, 1)
    machine.power_cycle()
    run(machine, 3)
    assert machine.plc.read("QW923") == 0
    assert machine.plc.read("QW921") == 20, "a constant is given at each start"
    assert machine.plc.read("QW934") == 77
    assert machine.is_in(State.STOPPED)
    assert machine.alarm(904)


@pytest.mark.parametrize("target", ["plain", "codesys"])
def test_a_retained_memory_is_valid_and_a_lost_one_is_reported(target: str) -> None:
    """The first power-up is without memory."""
    machine = rig(target)
    for memory_lost in (None, False, True):
        if memory_lost is not None:
            machine.power_cycle(memory_lost=memory_lost)
        run(machine, 2)
        assert machine.alarm(904) == (memory_lost is not False)


def test_openplc_keeps_a_declaration_until_the_machine_moves() -> None:
    """It outlasts power cycles before the first homing, and is not repeated in the middle of a trial."""
    machine = rig("openplc")
    run(machine, 2)
    machine.set_relay("coil 1658")
    run(machine, 2)
    for _ in range(2):
        assert not machine.alarm(904)
        assert machine.read(MACHINE.tags.tray.phase) == COMING
        machine.power_cycle()
        run(machine, 2)
    machine.set_relay("coil 1600")
    run(machine, 200)
    assert machine.is_in(State.RESETTING)
    machine.power_cycle()
    run(machine, 2)
    assert machine.alarm(904)
    assert machine.read(MACHINE.tags.tray.phase) == FORGOTTEN


def test_openplc_does_not_keep_a_declaration_that_is_refused() -> None:
    machine = rig("openplc")
    run(machine, 2)
    machine.set_relay("coil 1658")
    run(machine, 2)
    machine.set_relay("coil 1600")
    run(machine, 200)
    machine.set_relay("coil 1658")
    run(machine, 2)
    assert machine.read(MACHINE.tags.machine.refusal) == Refusal.MEMORY_VALID
    machine.power_cycle()
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
