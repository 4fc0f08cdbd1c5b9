"""Air stored in slides and lifts: vented, partly leaked, trapped by a jam; throttles and a speed regulator."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from plant_sim.cli.main import main
from plant_sim.common.parameter_file import Value
from plant_sim.faults import Fault, FaultError
from plant_sim.machine.stored_air import leak_down, parse_share, relieve, set_air
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.scenario.file import load_scenario
from plant_sim.scenario.run import run_scenario
from tests.plant_sim.machine.plant_rig import MACHINE, Rig, make_rig
from tests.sampling import first_of

MAIN_PA = MACHINE.supply.pressure_pa
RATING = MACHINE.rating
METER_IN: dict[str, Value] = {
    "slide.meter_in_conductance_m3_s_pa": 0.4e-9,
    "lift.meter_in_conductance_m3_s_pa": 2.5e-9,
}


def shares(rig: Rig) -> list[float]:
    """Return the gauge pressure of all chambers of slides and lifts, relative to the main line."""
    arms = rig.plant.state[0]["arms"]
    chambers_pa = [
        float(arms[number][drive][port]["chamber"]["pressure_pa"])
        for number in range(2)
        for drive in ("slide", "lift")
        for port in ("plus", "minus")
    ]
    return [(pressure_pa - ATMOSPHERE_PA) / MAIN_PA for pressure_pa in chambers_pa]


# --- state of the air ---------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "share"), [("vented", 0.0), ("full", 0.9), ("30 %", 0.3), ("0.5", 0.5), ("1", 1.0)])
def test_a_share_is_a_word_or_a_fraction(text: str, share: float) -> None:
    assert parse_share(text) == pytest.approx(share)


@pytest.mark.parametrize("text", ["", "empty", "120 %", "-1", "3 bar", "nan"])
def test_any_other_share_is_rejected(text: str) -> None:
    with pytest.raises(ValueError, match="must be vented, full, or a share"):
        parse_share(text)


def test_a_machine_starts_with_the_air_of_its_parameters() -> None:
    """A vented arm rests on its lower stop; nothing moves."""
    rig = make_rig({"start.chamber_share": 0.0})
    assert shares(rig) == pytest.approx([0.0] * 8, abs=1e-6)
    before_m = rig.left.lift.y_m, rig.left.slide.x_m
    rig.run(2_000)
    assert (rig.left.lift.y_m, rig.left.slide.x_m) == pytest.approx(before_m, abs=0.001)
    assert make_rig().machine.start.chamber_share == parse_share("full")


def test_the_air_can_be_set_at_any_time_without_motion_of_its_own() -> None:
    """Vented in mid-stroke, a raised arm sinks on the air that it compresses; at full pressure it stays."""
    rig = make_rig(x_m=0.2, y_m=0.0)
    set_air(rig.plant, 0.0)
    assert shares(rig) == pytest.approx([0.0] * 8, abs=1e-6)
    assert (rig.left.slide.x_m, rig.left.lift.y_m) == (0.2, 0.0)
    rig.run(2_000)
    lifting_m2, down_m2 = MACHINE.lift.lifting_area_m2, MACHINE.lift.area_m2
    line = rig.plant.state[0]["arms"][0]["lift"]
    held_n = (float(line["minus"]["chamber"]["pressure_pa"]) - ATMOSPHERE_PA) * lifting_m2
    pulled_n = (float(line["plus"]["chamber"]["pressure_pa"]) - ATMOSPHERE_PA) * down_m2
    assert 0.03 < rig.left.lift.y_m < 0.12
    assert held_n - pulled_n == pytest.approx(MACHINE.lift.weight_n, abs=MACHINE.lift_friction.static_n)
    full = make_rig(x_m=0.2, y_m=0.0)
    set_air(full.plant, 0.9)
    full.run(2_000)
    assert full.left.lift.y_m < 0.002


@pytest.mark.parametrize(("share", "over_ms"), first_of([(0.05, 20_000), (0.3, 60_000), (0.5, 60_000)]))
def test_chambers_leak_to_a_pressure_in_a_time(share: float, over_ms: int) -> None:
    """Pistons at rest at an end: the pressure is exact to 0.5 % of the main pressure; afterwards, it remains."""
    rig = make_rig()
    leaks = leak_down(rig.plant, share, over_ms)
    assert len(leaks) == 8
    rig.run(over_ms)
    assert shares(rig) == pytest.approx([share] * 8, abs=0.005)
    assert not rig.plant.faults.active
    rig.run(20_000)
    assert shares(rig) == pytest.approx([share] * 8, abs=0.005)


def test_impossible_leaks_are_rejected_and_change_nothing() -> None:
    rig = make_rig()
    with pytest.raises(ValueError, match=r"0: the share of the main pressure must be 0\.01 to 1"):
        leak_down(rig.plant, 0.0, 60_000)
    with pytest.raises(ValueError, match="air leaks for at least 1000 ms"):
        leak_down(rig.plant, 0.3, 500)
    with pytest.raises(ValueError, match=r"1\.1: the share"):
        set_air(rig.plant, 1.1)
    rig.plant.faults.add(Fault("leak", "right.lift.minus", size=1e-9))
    with pytest.raises(FaultError, match=r"right\.lift\.minus"):
        leak_down(rig.plant, 0.3, 60_000)


def test_a_scenario_sets_the_air_or_lets_it_leak(tmp_path: Path) -> None:
    text = (
        "title: t\nactions:\n  - {at: 1 s, air: 30 %, for: 5 s}\n"
        "  - {at: 8 s, air: vented}\n  - {at: 9 s, press: reset}\n"
        "until: {state: STOPPED, limit: 10 s}\nexpect: {state: STOPPED}\n"
    )
    path = tmp_path / "air.yaml"
    path.write_text(text, encoding="utf-8")
    seen: dict[int, float] = {}

    def watch(twin: object) -> None:
        twin.watch(lambda twin: seen.update({twin.now_ms: _left_slide_share(twin.plant)}))  # type: ignore[attr-defined]

    run_scenario(load_scenario(path), prepare=watch)
    assert seen[900] == pytest.approx(0.9, abs=0.001)
    assert seen[7_000] == pytest.approx(0.3, abs=0.005)
    assert seen[8_500] == pytest.approx(0.0, abs=0.001)


def _left_slide_share(plant: object) -> float:
    chamber = plant.state[0]["arms"][0]["slide"]["plus"]["chamber"]  # type: ignore[attr-defined]
    return (float(chamber["pressure_pa"]) - ATMOSPHERE_PA) / MAIN_PA


@pytest.mark.parametrize("command", ["trial", "serve"])
def test_the_commands_reject_an_impossible_air_in_one_line(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--air", "120%"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "--air '120%': must be vented, full, or a share of the main pressure from 0 to 100 %"


# --- jams ---------------------------------------------------------------------------------------


def test_a_freed_jam_releases_exactly_the_energy_of_the_trapped_air() -> None:
    """The work of the air on the piston equals the work against brake and friction over the jump.

    While the slide is jammed, its inner chamber fills and its outer one empties; neither changes after the coil is off.
    """
    rig = make_rig(x_m=0.2)
    slide = rig.left.slide
    rig.plant.faults.add(Fault("jammed", "left.slide", end_ms=9_000))
    rig.run(6_000, "left.slide_inward")
    rig.run(1_000)
    inner, outer = (rig.plant.state[0]["arms"][0]["slide"][port]["chamber"] for port in ("plus", "minus"))
    trapped_pa = float(inner["pressure_pa"]), float(outer["pressure_pa"])
    assert trapped_pa[0] - ATMOSPHERE_PA == pytest.approx(MAIN_PA, rel=0.02)
    assert trapped_pa[1] - ATMOSPHERE_PA < 0.05 * MAIN_PA
    rig.run(1_999)
    assert (float(inner["pressure_pa"]), float(outer["pressure_pa"])) == pytest.approx(trapped_pa, rel=1e-3)
    before_m, before_j = slide.x_m, float(inner["work_j"]) + float(outer["work_j"])
    rig.run(2_000)
    jump_m, work_j = slide.x_m - before_m, float(inner["work_j"]) + float(outer["work_j"]) - before_j
    friction = MACHINE.slide_friction
    least_n = friction.coulomb_n + MACHINE.slide.brake_n
    most_n = friction.static_n + friction.viscous_n_s_m * slide.fastest_m_s + MACHINE.slide.brake_n
    assert slide.speed_m_s == 0.0
    assert 0.02 < jump_m < 0.12
    assert least_n * jump_m < work_j < most_n * jump_m


@pytest.mark.parametrize(("name", "coil"), [("left.slide", "left.slide_outward"), ("left.lift", "left.lift_retract")])
def test_a_jam_that_is_relieved_does_not_move_when_it_is_freed(name: str, coil: str) -> None:
    rig = make_rig(x_m=0.2, y_m=0.1)
    device = rig.left.slide if name == "left.slide" else rig.left.lift
    rig.plant.faults.add(Fault("jammed", name))
    rig.run(3_000, coil)
    rig.run(1_000)
    before_m = device.position_m
    relieve(rig.plant, name)
    rig.plant.faults.clear(f"jammed:{name}")
    rig.run(2_000)
    assert device.position_m == pytest.approx(before_m, abs=0.002)


# --- throttles and speed regulator --------------------------------------------------------------


@pytest.mark.parametrize("x_m", [0.1, 0.28])
def test_meter_in_throttles_keep_the_rating_of_a_vented_slide(x_m: float) -> None:
    speeds_m_s = []
    for values in ({}, METER_IN):
        rig = make_rig(values, x_m=x_m, y_m=0.0)
        set_air(rig.plant, 0.0)
        rig.run(5_000, "left.slide_outward")
        assert rig.active("left.slide_at_feed")
        speeds_m_s.append(rig.left.slide.fastest_m_s)
    assert speeds_m_s[0] > 1.2 * RATING.slide_m_s
    assert speeds_m_s[1] < 0.75 * RATING.slide_m_s


@pytest.mark.parametrize(("coil", "y_m"), [("left.lift_retract", 0.15), ("left.lift_extend", 0.0)])
def test_meter_in_throttles_keep_the_rating_of_a_vented_lift(coil: str, y_m: float) -> None:
    speeds_m_s = []
    for values in ({}, METER_IN):
        rig = make_rig(values, x_m=0.0, y_m=y_m)
        set_air(rig.plant, 0.0)
        rig.run(2_500, coil)
        speeds_m_s.append(rig.left.lift.fastest_m_s)
    assert speeds_m_s[0] > 0.7
    assert speeds_m_s[1] < 0.9 * RATING.lift_m_s


def test_meter_in_throttles_lengthen_the_strokes_of_a_full_machine_by_a_third_at_most() -> None:
    for coil, x_m, switch in (("left.slide_outward", 0.28, "slide_at_feed"), ("left.lift_extend", 0.0, "lift_down")):
        times_ms = []
        for values in ({}, METER_IN):
            rig = make_rig(values, x_m=x_m, y_m=0.0)
            times_ms.append(rig.run_until(partial(rig.active, f"left.{switch}"), coil))
        assert times_ms[0] < times_ms[1] < 1.33 * times_ms[0]


def test_a_speed_regulator_keeps_the_rating_of_a_freed_lift() -> None:
    """Jammed on its way up, the lift is freed under pressure with both coils off."""
    speeds_m_s = []
    for values in ({}, {"lift.damper_n_s_m": 900.0}):
        rig = make_rig(values, y_m=0.145)
        rig.plant.faults.add(Fault("jammed", "left.lift", end_ms=4_000))
        rig.run(3_000, "left.lift_retract")
        rig.run(1_000)
        rig.left.lift.fastest_m_s = 0.0
        rig.run(1_000)
        speeds_m_s.append(rig.left.lift.fastest_m_s)
    assert speeds_m_s[0] > RATING.lift_m_s > speeds_m_s[1]


def test_the_highest_speed_is_recorded_and_can_be_reset() -> None:
    rig = make_rig()
    slide = rig.left.slide
    rig.run(2_000, "left.slide_inward")
    assert 0.14 < slide.fastest_m_s < 0.25
    slide.fastest_m_s = 0.0
    rig.run(100, "left.slide_inward")
    assert slide.fastest_m_s == pytest.approx(abs(slide.speed_m_s), rel=0.05)
    rig.run(2_000)
    assert slide.speed_m_s == 0.0 < slide.fastest_m_s
