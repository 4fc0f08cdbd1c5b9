"""Seedling handling by the complete machine, with coils driven by the test."""

import dataclasses

import pytest

from plant_sim.crop.seedling import Location, SeedlingCounts
from plant_sim.crop.traits import TYPICAL, Traits
from tests.plant_sim.machine.plant_rig import Rig
from tests.sampling import first_of


def thriving(rig: Rig) -> Rig:
    """Make all seedlings typical, so that none fails by itself, and return the rig."""
    rig.plant.seedlings.make_typical()
    return rig


def counts(**places: int) -> SeedlingCounts:
    """Return the counts of 144 seedlings; those not assigned to another location are in their trays."""
    rest = {"in_claw": 0, "in_cups": 0, "P": 0, "D": 0, "T": 0} | places
    return SeedlingCounts(in_tray=144 - sum(places.values()), **rest, total=144)


def rig_with_tray() -> Rig:
    rig = thriving(Rig())
    rig.bring_tray()
    return rig


@pytest.mark.parametrize(("side", "columns"), [("left", (0, 1, 2)), ("right", (5, 4, 3))])
def test_each_arm_empties_its_three_columns(side: str, columns: tuple[int, ...]) -> None:
    rig = rig_with_tray()
    for number, column in enumerate(columns, start=1):
        rig.pick(number, side)
        assert [plant.location for plant in rig.column(column)] == [Location.IN_CLAW] * 12
        rig.throw(side)
        assert [plant.location for plant in rig.column(column)] == [Location.IN_CUP] * 12
        assert rig.plant.counts() == counts(in_cups=12 * number)
        rig.converge(side)
    assert rig.plant.events == []


WEAK: dict[str, Traits] = {
    "short": TYPICAL._replace(height=-9.0),
    "leaning along": TYPICAL._replace(lean_along=9.0),
    "leaning across": TYPICAL._replace(lean_across=-9.0),
    "clinging": TYPICAL._replace(grasp=-9.0),
    "soft": TYPICAL._replace(strength=-9.0),
    "tired": TYPICAL._replace(endurance=-9.0),
    "drifting along": TYPICAL._replace(drift_along=6.0),
    "drifting across": TYPICAL._replace(drift_across=-6.0),
}
LOST_AT = dict(zip(WEAK, [Location.LOST_PICK] * 5 + [Location.LOST_CARRY] + [Location.LOST_THROW] * 2, strict=True))


def test_every_seedling_of_a_row_fails_at_the_stage_of_its_weakness() -> None:
    """Each weak seedling has one trait that deviates by 9 standard deviations, or by 6 for drift.

    A drift of 9 standard deviations would land the seedling in the next cup.
    """
    rig = rig_with_tray()
    for plant, traits in zip(rig.column(0), WEAK.values(), strict=False):
        plant.traits = traits
    rig.go_to_pick(1)
    rig.close()
    assert rig.plant.counts() == counts()
    rig.raise_arm()
    assert rig.plant.counts() == counts(P=5, in_claw=7)
    rig.go_to_feed()
    assert rig.plant.counts() == counts(P=5, D=1, in_claw=6)
    rig.spread()
    rig.lower_arm()
    rig.throw()
    assert rig.plant.counts() == counts(P=5, D=1, T=2, in_cups=4)
    for plant, place in zip(rig.column(0), LOST_AT.values(), strict=False):
        assert plant.location is place
    assert rig.plant.events == []


def test_every_lost_seedling_is_the_cause_of_its_empty_cup() -> None:
    """Claw 11 is above the first of the twelve cups to pass, and each cup reports the fate of its own seedling."""
    rig = rig_with_tray()
    for plant, traits in zip(rig.column(0), WEAK.values(), strict=False):
        plant.traits = traits
    rig.pick(1)
    rig.left.row.passed = []
    rig.throw()
    rig.close()
    rig.open()  # over other cups, which are empty for another reason
    rig.run(20_000)
    assert rig.left.row.passed is not None
    passed = [(cup.seedlings, cup.cause) for cup in rig.left.row.passed]
    first = passed.index((1, None))
    fates = [(0, LOST_AT[name]) for name in WEAK]
    assert passed[first : first + 12] == [*[(1, None)] * (12 - len(fates)), *reversed(fates)]
    assert set(passed[:first] + passed[first + 12 :]) == {(0, None)}


def test_a_cut_stem_is_lost_even_if_put_back() -> None:
    rig = rig_with_tray()
    soft, clinging = rig.column(0)[:2]
    soft.traits, clinging.traits = WEAK["soft"], WEAK["clinging"]
    rig.go_to_pick(1)
    rig.close()
    rig.run(30, "left.lift_retract")
    rig.open()
    assert (soft.location, clinging.location) == (Location.LOST_PICK, Location.STANDING)
    assert rig.plant.counts() == counts(P=1)


def test_a_seedling_put_back_was_loaded_with_the_full_force() -> None:
    """Within one second at rest on the row, the clamping force reaches its full value."""
    rig = thriving(Rig({"crop.claw_pressure_mpa": 0.60}))
    rig.bring_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.run(1_000)
    assert rig.left.grip.history.peak_n == pytest.approx(rig.left.claws.clamp_n, rel=0.01)
    soft = rig.column(0)[0]
    margin = float(rig.left.grip._mechanics.cut_margin(rig.left.claws.clamp_n))
    soft.traits = TYPICAL._replace(strength=-margin - 0.1)
    rig.open()
    assert rig.plant.counts() == counts(P=1)
    assert soft.location is Location.LOST_PICK


def test_fingers_that_regain_their_force_grip_the_stems_between_them() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.left.grip.drop_all(rig.left._pose, rig.plant.time_ms / 1000)
    assert rig.plant.counts() == counts()
    assert rig.left.grip.held == []
    rig.run(20)
    assert [plant.location for plant in rig.column(0)] == [Location.CLAMPED] * 12
    rig.raise_arm()
    assert rig.plant.counts() == counts(in_claw=12)


@pytest.mark.parametrize("open_ms", [50, 55, 60, 70])
def test_an_aborted_opening_drops_the_seedlings(open_ms: int) -> None:
    """The fingers do not move, but briefly lose their clamping force."""
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    rig.run(open_ms, "left.claws_open")
    rig.close()
    assert rig.plant.counts() == counts(D=12)
    assert "dropped" in rig.kinds()


def test_an_opening_aborted_at_once_drops_nothing() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    rig.run(5, "left.claws_open")
    rig.close()
    assert rig.plant.counts() == counts(in_claw=12)
    assert rig.plant.events == []


@pytest.mark.parametrize("rest_s", first_of([120, 600]))
def test_a_stem_held_too_long_breaks_over_the_cups(rest_s: int) -> None:
    """A stem slightly weaker than a typical one survives the move to feed, but not two minutes there, nor ten."""
    rig = rig_with_tray()
    frail = rig.column(0)[0]
    rig.pick(1)
    mechanics, history = rig.left.grip._mechanics, rig.left.grip.history
    held_s = rig.plant.time_ms / 1000 - history.since_s
    lasting = [float(mechanics.break_margin(history.peak_n, s)) for s in (held_s + 5, held_s + rest_s)]
    assert lasting[0] > lasting[1] + 0.3
    frail.traits = TYPICAL._replace(endurance=-sum(lasting) / 2)
    rig.run(1_000 * rest_s)
    rig.throw()
    assert frail.location is Location.LOST_CARRY
    assert rig.plant.counts() == counts(D=1, in_cups=11)


def test_clamped_seedlings_can_be_put_back_unharmed() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    assert [plant.location for plant in rig.column(0)] == [Location.CLAMPED] * 12
    rig.run(60, "left.lift_retract")
    rig.run(100)
    assert 0.002 < rig.left.lift.rise_m < 0.006
    assert rig.active("left.lift_down")
    rig.open()
    assert [plant.location for plant in rig.column(0)] == [Location.STANDING] * 12
    rig.run(300, "left.lift_extend")
    rig.go_to_feed()  # back out along the same path, low
    assert rig.plant.counts() == counts()
    assert rig.plant.events == []
    rig.pick(1)
    assert rig.plant.counts() == counts(in_claw=12)


def test_a_plug_pulled_half_out_cannot_be_put_back() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.run(120, "left.lift_retract")
    rig.run(100)
    assert 0.010 < rig.left.lift.rise_m < 0.044
    assert rig.plant.counts() == counts()
    rig.open()
    assert rig.plant.counts() == counts(P=12)


def test_plugs_are_out_of_their_cells_45_mm_up() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    start_m = rig.left.lift.rise_m
    rig.run_until(lambda: rig.plant.counts().in_claw == 12, "left.lift_retract")
    assert 0.045 <= rig.left.lift.rise_m - start_m < 0.047


def test_claws_that_open_over_the_tray_drop_their_seedlings() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    rig.open()
    assert rig.plant.counts() == counts(D=12)
    assert rig.kinds() == ["dropped", "drop_over_tray"]


def test_claws_that_open_on_the_way_drop_their_seedlings() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    rig.run_until(lambda: rig.left.slide.x_m < 0.1, "left.slide_outward")
    rig.run(200)
    rig.open()
    assert rig.plant.counts() == counts(D=12)
    assert rig.kinds() == ["dropped"]


@pytest.mark.parametrize("missing", ["spread", "down"])
def test_claws_that_open_at_feed_too_early_throw_beside_the_cups(missing: str) -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    rig.go_to_feed()
    if missing == "down":
        rig.spread()
    else:
        rig.lower_arm()
    rig.open()
    assert rig.plant.counts() == counts(T=12)
    assert rig.kinds() == ["dropped"]


def test_plugs_released_between_the_cups_fall_beside_them() -> None:
    rig = rig_with_tray()
    rig.pick(1)
    rig.wait_for_cups(off_m=0.030)
    rig.open()
    rig.run(200)
    assert rig.plant.counts() == counts(T=12)
    assert rig.plant.events == []


def test_a_second_plug_in_a_cup_is_reported_and_lost() -> None:
    rig = thriving(Rig({"cups.acceleration_m_s2": 1.0}))
    rig.bring_tray()
    rig.pick(1)
    rig.throw()
    rig.plant.planting_frequency_per_min = 0  # the tractor stops, the cups remain filled
    rig.run(2_000)
    rig.left.cups.place(rig.left.cups.chain_m // 0.06 * 0.06)  # 12 mm back, where they were filled
    rig.converge()
    rig.pick(2)
    rig.open()
    rig.run(200)
    assert rig.plant.counts().in_cups == 12
    assert rig.kinds() == ["double"] * 12
    assert rig.plant.counts().T == 12


def test_the_emergency_stop_does_not_affect_a_falling_plug() -> None:
    """The plug is released 120 ms after the coil turns on and lands in the cup 127.7 ms later, i.e. after 248 ms."""
    rig = rig_with_tray()
    rig.pick(1)
    rig.wait_for_cups()
    rig.run(130, "left.claws_open")
    assert [plant.location for plant in rig.column(0)] == [Location.FALLING] * 12
    assert rig.plant.counts() == counts(in_claw=12)
    rig.plant.box.emergency_stop = True
    rig.run(110)
    assert rig.plant.counts() == counts(in_claw=12)
    rig.run(20)
    assert rig.plant.counts() == counts(in_cups=12)


def test_claws_that_close_beside_the_row_cut_the_stems() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.left.place(x_m=0.1925 + 0.0065)
    rig.close()
    assert rig.plant.counts() == counts(P=12)
    assert rig.kinds() == ["stems_cut"]


def test_claws_grip_at_the_edge_of_their_tolerance() -> None:
    rig = rig_with_tray()
    rig.left.place(x_m=0.1925 - 0.0059)
    rig.close()
    rig.raise_arm()
    assert rig.plant.counts() == counts(in_claw=12)


def test_claws_that_close_too_high_cut_the_stems() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.left.place(y_m=0.150 - 0.0055)
    rig.close()
    assert rig.plant.counts() == counts(P=12)


def test_claws_that_close_on_a_misplaced_tray_cut_the_stems() -> None:
    rig = thriving(Rig())
    rig.bring_tray()
    rig.run(150, "tray_run", "tray_forward")
    rig.run(200)
    assert rig.plant.conveyor.placed_tray is None
    rig.go_to_pick(1)
    rig.close()
    assert rig.plant.counts().P == 11  # 20 to 30 mm further, one cell has left the claws
    assert rig.kinds() == ["stems_cut"]


def test_claws_that_close_between_two_rows_touch_nothing() -> None:
    rig = rig_with_tray()
    rig.left.place(x_m=0.1925 + 0.0215)
    rig.close()
    assert rig.plant.counts() == counts()
    assert rig.plant.events == []


def test_clamped_seedlings_tear_when_the_slide_moves() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    start_m = rig.left.slide.x_m
    rig.run_until(lambda: abs(rig.left.slide.x_m - start_m) > 0.0050, "left.slide_outward")
    assert rig.plant.counts() == counts()
    rig.run(50, "left.slide_outward")
    assert rig.plant.counts() == counts(P=12)
    assert rig.kinds() == ["torn"]


def test_clamped_seedlings_tear_when_the_tray_moves() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.run(200, "tray_run", "tray_forward")
    assert rig.plant.counts().P == 12
    assert "torn" in rig.kinds()


def test_a_low_arm_collides_with_a_standing_row() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.run_until(lambda: rig.left.slide.x_m > 0.1925 + 0.014, "left.slide_inward")
    assert rig.plant.events == []
    before = rig.plant.seedlings.save()
    rig.go_to_pick(2)
    assert rig.kinds() == ["arm_through_tray"]
    assert "column 1 " in rig.plant.events[0].text
    assert rig.plant.counts() == dataclasses.replace(counts(), ploughed=12)  # open, converged claws bend the plants
    rig.plant.seedlings.restore(before)
    assert rig.plant.counts() == counts()


def test_a_low_arm_may_pass_an_empty_row() -> None:
    rig = rig_with_tray()
    rig.pick(1)
    rig.throw()
    rig.converge()
    rig.go_to_pick(2)
    rig.go_to_feed()
    assert rig.plant.events == []


def test_a_raised_arm_may_pass_standing_rows() -> None:
    rig = rig_with_tray()
    rig.raise_arm()
    rig.go_to_pick(3)
    rig.close()
    rig.go_to_feed()
    assert rig.plant.events == []
    assert rig.plant.counts() == counts()


@pytest.mark.parametrize(("is_open", "travel_m"), [(False, 0.0), (True, 0.187)])
def test_a_low_arm_with_closed_or_spread_claws_damages_the_stems(is_open: bool, travel_m: float) -> None:
    rig = rig_with_tray()
    rig.left.place(is_open=is_open, travel_m=travel_m)
    rig.run_until(lambda: rig.left.slide.x_m > 0.1925 - 0.0160, "left.slide_inward")
    assert rig.plant.counts() == counts()
    rig.run(20, "left.slide_inward")
    assert rig.plant.counts() == counts(P=12)
    assert rig.kinds() == ["arm_through_tray"]


def test_a_low_arm_collides_with_a_standing_row_on_its_way_back() -> None:
    rig = rig_with_tray()
    rig.left.place(x_m=0.1925 + 0.0215)
    rig.run_until(lambda: rig.left.slide.x_m < 0.1925 - 0.0140, "left.slide_outward")
    assert rig.plant.events == []
    rig.go_to_feed()
    assert rig.kinds() == ["arm_through_tray"]
    assert "column 1 " in rig.plant.events[0].text


@pytest.mark.parametrize(("is_open", "lost"), [(False, 12), (True, 0)])
def test_an_arm_lowered_on_standing_seedlings_collides(is_open: bool, lost: int) -> None:
    rig = rig_with_tray()
    rig.left.place(x_m=0.2355, y_m=0.0, is_open=is_open)
    rig.run_until(lambda: rig.left.lift.rise_m < 0.1315, "left.lift_extend", every_ms=1)
    assert rig.plant.events == []
    rig.run(20, "left.lift_extend")
    assert rig.kinds() == ["arm_through_tray"]
    assert "column 2 " in rig.plant.events[0].text
    assert rig.plant.counts() == dataclasses.replace(counts(P=lost), ploughed=12 - lost)


def test_a_loaded_arm_lowered_on_the_tray_collides() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    rig.run_until(lambda: rig.left.lift.rise_m < 0.0410, "left.lift_extend")
    assert rig.plant.events == []
    rig.run(20, "left.lift_extend")
    assert rig.plant.counts() == counts(D=12)
    assert rig.kinds() == ["arm_through_tray"]


def test_placing_an_arm_is_not_a_motion_and_grips_nothing() -> None:
    rig = rig_with_tray()
    rig.left.place(x_m=0.1925, is_open=False)
    rig.raise_arm()
    assert rig.plant.counts() == counts()
    assert rig.plant.events == []


def test_a_tray_that_moves_under_a_low_arm_collides() -> None:
    rig = rig_with_tray()
    rig.left.place(x_m=0.1925 - 0.0215)
    rig.run(100, "tray_run", "tray_forward")
    rig.run(200, "tray_run", "tray_forward")
    assert rig.kinds() == ["arm_through_tray"]
    assert "tray moved" in rig.plant.events[0].text
    rig.go_to_feed()
    rig.run(1_000, "tray_run", "tray_forward")
    assert len(rig.plant.events) == 1


@pytest.mark.parametrize("may_meet", [False, True])
def test_both_arms_inward_of_pick_2_collide_unless_they_fit(may_meet: bool) -> None:
    rig = Rig({"layout.arms_may_meet_in_plant": may_meet}, trays=0)
    rig.left.place(x_m=0.2785)
    rig.plant.right.place(x_m=0.2560)
    rig.run(100)
    assert rig.plant.events == []
    rig.run_until(lambda: rig.plant.right.slide.x_m > 0.2580, "right.slide_inward")
    assert rig.kinds() == ([] if may_meet else ["arms_collide"])
    rig.run(1_000)
    assert len(rig.plant.events) == (0 if may_meet else 1)


def test_an_event_carries_its_time() -> None:
    rig = rig_with_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    start_ms = rig.plant.time_ms
    rig.open()
    time_ms, kind, text = rig.plant.events[0]
    freed_ms = 1000 * float(rig.left._state["freed_s"])
    assert 115 <= freed_ms - start_ms <= 125
    assert 0 <= time_ms - freed_ms < 10  # seedling events are evaluated every 10 ms
    assert kind == "dropped"
    assert text == "left arm: 12 seedlings dropped beside the cups"


def test_a_late_row_misses_the_cups_that_pass() -> None:
    """Twelve cups are filled, the cups that pass during the next pick remain empty, and then twelve more are filled."""
    rig = rig_with_tray()
    pitch_m = 0.060
    rig.pick(1)
    rig.throw()
    first_m = rig.left.cups.chain_m
    rig.converge()
    rig.pick(2)
    rig.run(20_000)
    rig.throw()
    second_m = rig.left.cups.chain_m
    between = round((second_m - first_m) / pitch_m) - 12
    assert between > 0
    assert rig.plant.missed_cups == {"left": 0, "right": 0}
    rig.run(20_000)
    assert rig.plant.missed_cups == {"left": between, "right": 0}
    assert dataclasses.asdict(rig.plant.counts())["in_cups"] == 24


def test_a_skewed_tray_is_gripped_in_the_middle_and_cut_at_its_ends() -> None:
    """A lead of 8 mm over 140 mm is a skew of 57 mrad; the claws grip only stems that are offset by up to 6 mm.

    Cells 0.5, 1.5 and 2.5 pitches from the centre are offset by 1.2, 3.7 and 6.1 mm.
    """
    rig = thriving(Rig())
    rig.plant.conveyor.skewed_m[0] = 0.008
    rig.bring_tray()
    rig.go_to_pick(1)
    rig.close()
    assert [seedling.along for seedling in rig.left.grip.held] == [4, 5, 6, 7]
    assert rig.kinds() == ["stems_cut"]
    assert rig.plant.counts().P == 8
