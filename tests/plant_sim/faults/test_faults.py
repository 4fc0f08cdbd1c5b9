"""Effects of all named faults on the machine: before, during and after the fault."""

from __future__ import annotations

import numpy as np
import pytest

from plant_sim.common.parameter_file import Value
from plant_sim.faults import FAULTS, Fault, FaultError, FaultKind, fault_table, parse_fault
from plant_sim.faults.kind import read_value
from tests.plant_sim.machine.plant_rig import Rig

IN, OUT, UP, DOWN = "left.slide_inward", "left.slide_outward", "left.lift_retract", "left.lift_extend"


def activated(*faults: str, values: dict[str, Value] | None = None, trays: int = 2) -> Rig:
    """Return a machine with the given faults active."""
    rig = Rig(values, trays=trays)
    for fault in faults:
        rig.plant.faults.add(parse_fault(fault))
    return rig


def receiver_pa(rig: Rig) -> float:
    return float(rig.plant.state[0]["air"]["network"]["receiver"]["pressure_pa"])


# --- times ---------------------------------------------------------------------------------------


def test_a_fault_starts_and_ends_at_its_millisecond() -> None:
    """With a stuck_off fault from 15 to 25 ms, a switch that is on reads off during exactly these milliseconds."""
    rig = activated("stuck_off:left.lift_down@15ms..25ms")
    levels = []
    for _ in range(40):
        levels.append(rig.active("left.lift_down"))
        rig.run(1)
    assert [ms for ms, on in enumerate(levels) if not on] == list(range(15, 25))


def test_a_long_step_stops_at_every_fault() -> None:
    """With a jam and a leak that start and end during the step, one step of 500 ms equals 500 steps of 1 ms."""
    ends = []
    for chunk_ms in (500, 1):
        rig = activated("jammed:left.slide@203ms..310ms", "leak:left.lift.minus=3e-9@111ms..333ms")
        for _ in range(500 // chunk_ms):
            rig.run(chunk_ms, IN)
        arm, air = rig.plant.state[0]["arms"][0], rig.plant.state[0]["air"]
        ends.append([part.tobytes() for part in (arm["slide"], arm["lift"], air, rig.plant.params)])
    assert ends[0] == ends[1]


def test_faults_a_millisecond_apart_take_effect_a_millisecond_apart() -> None:
    rig = activated("stuck_off:left.lift_down@10ms..12ms", "stuck_on:left.lift_up@11ms..13ms")
    levels = []
    for _ in range(15):
        levels.append((rig.active("left.lift_down"), rig.active("left.lift_up")))
        rig.run(1)
    assert levels[9:14] == [(True, False), (False, False), (False, True), (True, True), (True, False)]


def test_consecutive_faults_of_the_same_value() -> None:
    """Each of two consecutive faults is active during its own period; then the original value is restored."""
    rig = activated("stuck_off:left.lift_down@10ms..20ms", "stuck_on:left.lift_down@20ms..30ms")
    stuck = []
    for _ in range(4):
        stuck.append(rig.plant.sensors["left.lift_down"].stuck)
        rig.run(10)
    assert stuck == [None, False, True, None]


def test_active_faults_are_listed() -> None:
    rig = activated("jammed:left.slide@10ms..20ms", "jammed:left.lift@5ms..")
    seen = []
    for _ in range(5):
        seen.append([str(fault) for fault in rig.plant.faults.active])
        rig.run(5)
    lift, slide = "jammed:left.lift@5ms..", "jammed:left.slide@10ms..20ms"
    assert seen == [[], [lift], [lift, slide], [lift, slide], [lift]]
    assert [str(fault) for fault in rig.plant.faults.activated] == [lift, slide]
    assert rig.plant.faults.next_ms is None


def test_a_fault_added_during_the_run_is_activated_at_once_and_can_be_cleared() -> None:
    rig = activated("stuck_off:left.lift_down@1s..")
    rig.run(100)
    rig.plant.faults.add(Fault("stuck_on", "left.lift_up"))
    assert rig.active("left.lift_up")
    rig.plant.faults.clear("stuck_on:left.lift_up")
    rig.plant.faults.clear("stuck_off:left.lift_down")
    assert not rig.active("left.lift_up")
    rig.run(2_000)
    assert rig.active("left.lift_down")
    with pytest.raises(
        FaultError, match=r"^stuck_on:left\.lift_up: neither active nor scheduled; current faults: none$"
    ):
        rig.plant.faults.clear("stuck_on:left.lift_up")


@pytest.mark.parametrize("kind", [kind for kind in FAULTS.values() if not kind.permanent], ids=lambda kind: kind.name)
def test_the_end_of_a_fault_restores_all_values(kind: FaultKind) -> None:
    """A fault of any kind changes its values while it is active, and they are restored exactly when it ends."""
    row = next(row for row in fault_table()[1:] if row[0] == f"`{kind.name}`")
    fault = parse_fault(row[-1].strip("`").partition("@")[0] + "@10ms..20ms")
    rig = Rig()
    part = FAULTS[fault.kind].part(rig.plant, fault.target)
    params, values = rig.plant.params.tobytes(), [read_value(part, path) for path in FAULTS[fault.kind].changes]
    rig.plant.faults.add(fault)
    rig.run(10)
    for path, sound in zip(FAULTS[fault.kind].changes, values, strict=True):
        assert not np.array_equal(read_value(part, path), sound), path
    rig.run(10)
    assert rig.plant.params.tobytes() == params
    for path, sound in zip(FAULTS[fault.kind].changes, values, strict=True):
        assert np.array_equal(read_value(part, path), sound), path


# --- sensors and wires --------------------------------------------------------------------------


def test_a_stuck_sensor_ignores_its_target() -> None:
    rig = activated("stuck_on:left.slide_at_feed", "stuck_off:left.slide_at_pick_1")
    said = set()
    for _ in range(300):
        rig.run(10, IN)
        said.add((rig.active("left.slide_at_feed"), rig.active("left.slide_at_pick_1")))
    assert said == {(True, False)}
    assert rig.left.slide.position_m > rig.machine.picks_m[0]


def test_a_late_sensor_delays_every_edge() -> None:
    def edges(rig: Rig) -> list[int]:
        times_ms, before = [], rig.active("left.slide_at_feed")
        for _ in range(1_000):
            rig.run(1, IN)
            if rig.active("left.slide_at_feed") != before:
                before = not before
                times_ms.append(rig.plant.time_ms)
        return times_ms

    sound, late = edges(Rig()), edges(activated("late_sensor:left.slide_at_feed=200ms"))
    assert len(sound) == 1
    assert late == [sound[0] + 200]


def test_a_broken_wire_reads_off_regardless_of_polarity() -> None:
    """With the wires of the closed stop contact and of a switch broken, stop is active and the switch reads off."""
    rig = activated("broken_wire:stop@50ms..100ms", "broken_wire:left.lift_down@50ms..100ms")
    seen = []
    for _ in range(3):
        seen.append((rig.active("stop"), rig.active("left.lift_down")))
        rig.run(50)
    assert seen == [(False, True), (True, False), (False, True)]


@pytest.mark.parametrize(("fault", "low", "high"), [("missed", 0.35, 0.65), ("doubled", 1.35, 1.65)])
def test_flags_are_missed_or_counted_twice(fault: str, low: float, high: float) -> None:
    """With half of the flags affected, there are about 0.5 or 1.5 times as many pulses as cups that passed."""

    def pulses(rig: Rig) -> int:
        count, before = 0, rig.active("left.cup_pulse")
        for _ in range(2_000):
            rig.run(10)
            now = rig.active("left.cup_pulse")
            count += now and not before
            before = now
        return count

    values: dict[str, Value] = {"cups.planting_frequency_per_min": 200.0}
    sound = pulses(Rig(values))
    faulty = pulses(activated(f"{fault}_pulses:left.cup_pulse=50%", values=values))
    assert sound > 60
    assert low * sound <= faulty <= high * sound


# --- valves and air -----------------------------------------------------------------------------


def test_a_stuck_valve_keeps_its_position() -> None:
    """If the spool sticks during a stroke, the arm rises with its coil off; if it sticks centred, the arm is still."""
    rig = activated("stuck_valve:left.lift@300ms..")
    rig.run(300, UP)
    assert rig.left.lift.rise_m < 0.05
    rig.run(1_500)
    assert rig.left.lift.rise_m == pytest.approx(rig.machine.lift.stroke_m, abs=0.5e-3)  # the stop yields
    still = activated("stuck_valve:left.lift@0s..1s")
    still.run(1_000, UP)
    assert still.left.lift.rise_m < 1e-4
    still.run(1_500, UP)
    assert still.left.lift.rise_m == pytest.approx(still.machine.lift.stroke_m, abs=0.5e-3)


def test_a_slow_valve_switches_later_by_its_delay() -> None:
    def begins_ms(rig: Rig) -> int:
        while rig.left.slide.position_m < 0.01:
            rig.run(1, IN)
        return rig.plant.time_ms

    assert begins_ms(activated("slow_valve:left.slide=150ms")) - begins_ms(Rig()) == pytest.approx(150, abs=2)


def held_rise_m(*faults: str) -> tuple[float, float]:
    """Raise the arm and switch its coils off; return its height then and 4 s later."""
    rig = activated(*faults)
    rig.raise_arm()
    before_m = rig.left.lift.rise_m
    rig.run(4_000)
    return before_m, rig.left.lift.rise_m


def test_a_faultless_arm_stays_up_without_coils() -> None:
    before_m, after_m = held_rise_m()
    assert after_m == pytest.approx(before_m, abs=0.002)


@pytest.mark.parametrize(
    "fault",
    ["leak:left.lift.minus=2e-9", "leaking_check_valve:left.lift.minus=2e-9", "dropping_arm:left.lift=2e-9"],
)
def test_an_arm_that_loses_its_air_sinks_without_coils(fault: str) -> None:
    before_m, after_m = held_rise_m(fault)
    assert before_m > 0.14
    assert after_m < 0.001


def test_a_leak_vents_the_supply() -> None:
    """During a 2 s leak in the manifold, its pressure falls and air escapes; afterwards the pressure recovers."""
    rig = activated("leak:supply=3e-8@0s..2s")
    before_kg = float(rig.plant.state[0]["air"]["network"]["outside"]["mass_kg"])
    rig.run(2_000)
    low_pa = rig.plant.supply.pressure_pa
    assert low_pa < rig.machine.supply.pressure_pa - 0.05e6
    assert float(rig.plant.state[0]["air"]["network"]["outside"]["mass_kg"]) > before_kg
    rig.run(3_000)
    assert rig.plant.supply.pressure_pa == pytest.approx(rig.machine.supply.pressure_pa, rel=0.03)


def test_a_closed_throttle_slows_the_stroke_that_it_exhausts() -> None:
    """With the outer throttle closed to a third, the slide is three times slower inward and unchanged outward."""

    def times_ms(rig: Rig) -> tuple[int, int]:
        inward = rig.run_until(lambda: rig.left.slide.position_m > 0.15, IN)
        rig.run(12_000, IN)
        return inward, rig.run_until(lambda: rig.left.slide.position_m < 0.15, OUT)

    sound, closed = times_ms(Rig()), times_ms(activated("closed_throttle:left.slide.minus=33%"))
    assert 2.0 < closed[0] / sound[0] < 3.5
    assert closed[1] == pytest.approx(sound[1], rel=0.1)


def strokes(rig: Rig, count: int) -> None:
    """Consume air by moving both lifts up and down."""
    for _ in range(count):
        rig.run(1_500, UP, "right.lift_retract")
        rig.run(1_500, DOWN, "right.lift_extend")


def test_a_low_supply_falls_with_consumption_and_recovers() -> None:
    rig = activated("low_supply:supply=0.3MPa@0s..12s")
    strokes(rig, 4)
    assert rig.plant.supply.pressure_pa == pytest.approx(0.3e6, abs=0.02e6)
    rig.run(5_000)
    assert rig.plant.supply.pressure_pa == pytest.approx(0.5e6, abs=0.01e6)


def test_a_low_claw_supply_weakens_the_grip_alone_and_recovers() -> None:
    """With the regulator at 0.2 MPa, the claw force is half of that at 0.4 MPa; the main pressure is unchanged."""
    rig = activated("low_claw_supply:supply=0.2MPa@0s..12s")
    for _ in range(6):
        rig.run(1_000, "left.claws_open")
        rig.run(1_000, "left.claws_close")
    assert rig.plant.supply.claw_pressure_pa == pytest.approx(0.2e6, abs=0.01e6)
    assert rig.plant.supply.pressure_pa == pytest.approx(0.5e6, abs=0.01e6)
    low_n = rig.left.claws.clamp_n
    rig.run(3_000, "left.claws_close")
    assert rig.plant.supply.claw_pressure_pa == pytest.approx(0.4e6, abs=0.01e6)
    assert low_n == pytest.approx(0.5 * rig.left.claws.clamp_n, rel=0.02)


def test_a_failing_compressor_empties_the_receiver() -> None:
    values: dict[str, Value] = {"supply.receiver_m3": 0.003}
    sound, dead = Rig(values), activated("failing_supply:compressor=0%", values=values)
    for rig in (sound, dead):
        strokes(rig, 5)
    least_pa = sound.machine.supply.compressor_on_pa
    assert receiver_pa(sound) > least_pa
    assert receiver_pa(dead) < least_pa - 0.1e6


def test_claws_lose_their_air_past_the_check_valve_of_their_reservoir() -> None:
    """With an empty receiver, claws grip with air from their reservoir, but only weakly if its check valve leaks."""

    def clamp_n(*faults: str) -> float:
        rig = activated("failing_supply:compressor=0%", "leak:supply=5e-8", *faults)
        rig.run(60_000)
        for coil in ("left.claws_close", "left.claws_open", "left.claws_close"):
            rig.run(1_000, coil)
        return rig.left.claws.clamp_n

    sound_n = clamp_n()
    assert sound_n > 5.0
    assert clamp_n("leaking_check_valve:claw_reservoir=1e-8") < 0.6 * sound_n


# --- moving parts ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "coils"),
    [
        ("left.slide", [IN]),
        ("left.lift", [UP]),
        ("left.claws", ["left.claws_close"]),
        ("left.spreader", ["left.spread"]),
        ("left.cups", []),
        ("conveyor", ["tray_run", "tray_forward"]),
    ],
)
def test_a_jammed_part_does_not_move_until_released(target: str, coils: list[str]) -> None:
    def place(rig: Rig) -> float:
        arm = rig.left
        return {
            "left.slide": arm.slide.position_m,
            "left.lift": arm.lift.position_m,
            "left.claws": arm.claws.position_m,
            "left.spreader": arm.spreader.travel_m,
            "left.cups": arm.cups.chain_m,
            "conveyor": rig.plant.conveyor.belt_m,
        }[target]

    rig = activated(f"jammed:{target}@0s..1s")
    start = place(rig)
    rig.run(1_000, *coils)
    assert place(rig) == start
    rig.run(1_000, *coils)
    assert abs(place(rig) - start) > 0.005


def test_a_decoupled_piston_leaves_the_carriage_behind() -> None:
    rig = activated("decoupled_magnet:left.slide=20N")
    rig.run(3_000, IN)
    assert rig.left.slide.decoupled
    assert rig.left.slide.position_m < 0.02
    assert float(rig.left.slide.state["piston_m"]) > 0.2


def test_a_slipping_belt_leaves_the_claws_behind_the_motor() -> None:
    def spread_m(rig: Rig) -> float:
        rig.run(1_500, "left.spread")
        return rig.left.spreader.travel_m

    full_m = Rig().machine.spreader.travel_m
    assert spread_m(Rig()) == pytest.approx(full_m, abs=0.002)
    assert spread_m(activated("slipping_belt:left.spreader=15N")) < 0.5 * full_m


def test_a_stepper_without_torque_loses_steps() -> None:
    def lost(rig: Rig) -> tuple[int, float]:
        rig.run(1_000, "tray_run", "tray_forward")
        return rig.plant.conveyor.lost_steps, rig.plant.conveyor.belt_m

    assert lost(Rig())[0] == 0
    steps, way_m = lost(activated("stalled_stepper:conveyor=10%"))
    assert steps > 10
    assert 0.02 < way_m < 0.8 * lost(Rig())[1]
    assert lost(activated("stalled_stepper:conveyor=0%"))[1] == pytest.approx(0.0, abs=1e-3)


# --- trays and seedlings ------------------------------------------------------------------------


def front_at_beam_m(rig: Rig) -> float:
    """Move the first tray out; return the position of the second tray when the beam detects its front edge, m."""
    rig.run_until(lambda: 1 in rig.plant.conveyor.front_m, "tray_run", "tray_forward")
    rig.run_until(lambda: not rig.active("tray_front_edge"), "tray_run", "tray_forward")
    image = rig.outputs("tray_run", "tray_forward")
    while not rig.active("tray_front_edge"):
        rig.plant.step(1, image)
    return rig.plant.conveyor.front_m[1]


def test_a_skewed_tray_reaches_the_beam_early() -> None:
    assert front_at_beam_m(activated("skewed_tray:magazine=8mm")) == pytest.approx(
        front_at_beam_m(Rig()) - 0.008, abs=1e-3
    )


def test_a_withholding_magazine_places_no_tray() -> None:
    rig = activated("missing_tray:magazine@0s..20s")
    rig.run(19_990, "tray_run", "tray_forward")
    assert rig.plant.conveyor.in_magazine == 1
    rig.run(1_000, "tray_run", "tray_forward")
    assert rig.plant.conveyor.in_magazine == 0


def test_missing_cells_are_empty_from_the_start() -> None:
    """With half of the plugs of tray 1 missing, the total is 36 lower; a claw over an empty cell carries nothing."""
    rig = activated("missing_cells:tray_1=50%")
    counts = rig.plant.counts()
    assert (counts.in_tray, counts.total) == (108, 108)
    assert sum(len(rig.column(column)) for column in range(6)) == 36
    assert sum(len(rig.column(column, tray=1)) for column in range(6)) == 72
    rig.bring_tray()
    before = len(rig.column(0))
    assert 0 < before < 12
    rig.go_to_pick(1)
    rig.close()
    assert len(rig.left.grip.held) == before
    after = rig.plant.counts()
    assert (after.in_tray, after.total) == (108, 108)
    rig.raise_arm()
    after = rig.plant.counts()
    assert after.in_tray == 108 - before
    assert after.in_claw + after.P == before


def test_missing_cells_depend_on_the_seed_alone_and_do_not_change_the_others() -> None:
    def sown(seed: int, *faults: str) -> dict[tuple[int, int, int], object]:
        rig = Rig(seed=seed)
        for fault in faults:
            rig.plant.faults.add(parse_fault(fault))
        return {(each.tray, each.column, each.along): each.traits for each in rig.plant.seedlings}

    full, thin = sown(1), sown(1, "missing_cells:tray_2=6")
    assert len(thin) == len(full) - 6
    assert thin.items() <= full.items()
    assert thin == sown(1, "missing_cells:tray_2=6 cells")
    assert thin.keys() != sown(2, "missing_cells:tray_2=6").keys()
