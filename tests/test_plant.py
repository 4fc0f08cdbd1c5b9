"""The whole plant at its terminals: wiring, power, time, and what must always hold."""

import random
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_rig import IO_MAP, MACHINE, Rig

from controller.io_map import IoMap, Polarity
from plant_sim.crop.seedling import Place
from plant_sim.plant import Plant

OUTPUTS = [point.tag for point in IO_MAP.outputs]
CONTRADICTIONS = [
    [f"{side}.{end}" for end in ends]
    for side in ("left", "right")
    for ends in (
        ("lift_up", "lift_down"),
        ("claws_spread", "claws_converged"),
        ("slide_at_feed", "slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3"),
    )
]
SEGMENTS = st.lists(
    st.tuples(st.integers(1, 600), st.frozensets(st.sampled_from(OUTPUTS), max_size=6), st.booleans()),
    min_size=1,
    max_size=25,
)


def wired(*tags: str) -> IoMap:
    """The map with optional points wired."""
    points = [replace(point, wired=True) for point in IO_MAP.unwired if point.tag in tags]
    assert len(points) == len(tags)
    return replace(
        IO_MAP,
        inputs=(*IO_MAP.inputs, *(point for point in points if point.device == "X")),
        outputs=(*IO_MAP.outputs, *(point for point in points if point.device == "Y")),
    )


def test_the_machine_is_found_as_a_normal_stop_leaves_it() -> None:
    rig = Rig()
    active = {point.tag for point in IO_MAP.inputs if rig.active(point.tag)} - {"left.cup_pulse", "right.cup_pulse"}
    home = ("lift_down", "slide_at_feed", "claws_converged")
    assert active == {f"{side}.{tag}" for side in ("left", "right") for tag in home}
    assert rig.plant.counts().in_tray == rig.plant.counts().total == 144
    assert rig.plant.time_ms == 0


def test_without_outputs_nothing_moves_but_the_cups() -> None:
    rig = Rig()
    before = snapshot(rig.plant)
    rig.run(60_000)
    after = snapshot(rig.plant)
    assert before[:-2] == after[:-2]
    assert all(later > earlier for earlier, later in zip(before[-2:], after[-2:], strict=True))


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("coil", "place", "leaves"),
    [
        ("lift_retract", {}, "lift_down"),
        ("lift_extend", {"y_m": 0.0}, "lift_up"),
        ("slide_inward", {}, "slide_at_feed"),
        ("slide_outward", {"x_m": 0.2785}, "slide_at_pick_3"),
        ("spread", {}, "claws_converged"),
        ("converge", {"travel_m": 0.187}, "claws_spread"),
    ],
)
def test_each_coil_moves_its_own_part(side: str, coil: str, place: dict[str, float], leaves: str) -> None:
    rig = Rig(trays=0)
    for arm in rig.plant.arms.values():
        arm.place(**place)  # type: ignore[arg-type]
    other = "right" if side == "left" else "left"
    assert rig.active(f"{side}.{leaves}")
    rig.run(500, f"{side}.{coil}")
    assert not rig.active(f"{side}.{leaves}")
    assert rig.active(f"{other}.{leaves}")


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_claw_coils_open_and_close_their_own_side(side: str) -> None:
    rig = Rig()
    rig.run(200, f"{side}.claws_close")
    assert rig.plant.arms[side].claws.angle_deg == -10
    assert [arm.claws.angle_deg for arm in rig.plant.arms.values()].count(30) == 1
    rig.run(200, f"{side}.claws_open")
    assert rig.plant.arms[side].claws.angle_deg == 30


@pytest.mark.parametrize(
    ("button", "tag"), [("start", "start"), ("stop", "stop"), ("emergency_stop", "emergency_stop")]
)
def test_a_button_is_seen_at_once_with_the_polarity_of_its_wire(button: str, tag: str) -> None:
    rig = Rig()
    number = IO_MAP[tag].number
    released = rig.plant.x[number]
    assert released is (tag != "start")  # stop and emergency stop are normally closed
    setattr(rig.plant.box, button, True)
    assert rig.plant.x[number] is not released


def test_an_inverted_output_moves_when_its_terminal_is_off() -> None:
    inverted = tuple(
        replace(point, polarity=Polarity.ACTIVE_LOW) if point.tag == "left.slide_inward" else point
        for point in IO_MAP.outputs
    )
    rig = Rig(io_map=replace(IO_MAP, outputs=inverted))
    rig.run(500)
    assert rig.left.slide.x_m == 0.0
    rig.run(500, "left.slide_inward")
    assert rig.left.slide.x_m > 0.05


def test_a_stuck_sensor_lies_at_its_terminal() -> None:
    rig = Rig()
    rig.plant.sensors["left.lift_up"].stuck = True
    assert rig.active("left.lift_up")
    assert not rig.active("right.lift_up")
    rig.plant.sensors["left.lift_up"].stuck = None
    assert not rig.active("left.lift_up")


def test_optional_points_appear_only_when_wired() -> None:
    rig = Rig()
    assert len(rig.plant.x) == 22
    assert rig.plant.indicators == {}
    io_map = wired("reset", "air_pressure_ok", "magazine_empty", "horn", "lamp_green")
    rig = Rig(io_map=io_map)
    assert len(rig.plant.x) == 25
    assert [rig.active(tag) for tag in ("reset", "air_pressure_ok", "magazine_empty")] == [False, True, False]
    rig.plant.box.reset = True
    rig.plant.supply.pressure_pa = 0.39e6
    assert [rig.active(tag) for tag in ("reset", "air_pressure_ok", "magazine_empty")] == [True, False, False]
    rig.run(4_000, "tray_run", "tray_forward", "lamp_green")
    assert rig.active("magazine_empty")
    assert rig.plant.indicators == {"horn": False, "lamp_green": True}


def test_a_terminal_without_a_wire_stays_off() -> None:
    rig = Rig(io_map=wired("magazine_empty"), trays=0)
    assert rig.plant.x[22:] == [False, False, True]


def test_air_pressure_is_ok_from_the_threshold_up() -> None:
    rig = Rig()
    switch = rig.plant.supply.pressure_ok
    rig.plant.supply.pressure_pa = 0.4e6
    assert switch.read()
    rig.plant.supply.pressure_pa = 0.4e6 - 1
    assert not switch.read()


def test_a_wired_input_that_no_machine_has_is_refused() -> None:
    extra = replace(IO_MAP.inputs[0], tag="moon", line=7)
    with pytest.raises(ValueError, match=r"io_map.yaml:7: moon: no such sensor or button"):
        Plant(replace(IO_MAP, inputs=(*IO_MAP.inputs, extra)), MACHINE, seed=1)


def test_a_coil_without_a_wire_is_refused() -> None:
    outputs = tuple(point for point in IO_MAP.outputs if point.tag != "left.spread")
    with pytest.raises(KeyError, match=r"left\.spread"):
        Plant(replace(IO_MAP, outputs=outputs), MACHINE, seed=1)


def test_time_never_runs_backward_and_images_are_complete() -> None:
    plant = Rig().plant
    with pytest.raises(ValueError, match="runs backward"):
        plant.step(-1, IO_MAP.safe_outputs())
    with pytest.raises(ValueError, match="17 levels"):
        plant.step(10, IO_MAP.safe_outputs()[:-1])
    assert plant.time_ms == 0


def test_the_image_belongs_to_the_caller() -> None:
    plant = Rig().plant
    image = plant.x
    image[0] = True
    assert plant.x[0] is False


def test_the_emergency_stop_takes_the_coil_power_whatever_the_outputs_say() -> None:
    rig = Rig(trays=2)
    rig.left.place(y_m=0.075)
    everything = ("left.slide_inward", "left.lift_retract", "left.spread", "tray_run", "tray_forward")
    rig.run(500, *everything)
    moving = (rig.left.slide.x_m, rig.left.lift.y_m, rig.left.spreader.travel_m, rig.plant.conveyor.belt_m)
    rig.plant.box.emergency_stop = True
    rig.run(2_000, *everything)
    stopped = (rig.left.slide.x_m, rig.left.lift.y_m, rig.left.spreader.travel_m, rig.plant.conveyor.belt_m)
    # 20 ms of valve and the check valves; the ramps of the motors
    for before_m, after_m, run_m in zip(moving, stopped, (0.0047, 0.0, 0.0026, 0.0051), strict=True):
        assert abs(after_m - before_m) <= max(run_m, 0.0059)
    rig.run(5_000, *everything)
    assert stopped == (rig.left.slide.x_m, rig.left.lift.y_m, rig.left.spreader.travel_m, rig.plant.conveyor.belt_m)
    rig.plant.box.emergency_stop = False
    rig.run(500, *everything)
    assert rig.left.slide.x_m > stopped[0] + 0.05


@pytest.mark.parametrize("is_open", [False, True])
def test_claws_keep_their_state_in_an_emergency_stop(is_open: bool) -> None:
    rig = Rig()
    rig.left.place(is_open=is_open)
    rig.plant.box.emergency_stop = True
    rig.run(5_000, "left.claws_open" if not is_open else "left.claws_close")
    assert rig.left.claws.angle_deg == (30 if is_open else -10)


@given(segments=SEGMENTS, seed=st.integers(0, 1_000))
@settings(max_examples=60, deadline=None)
def test_whatever_the_coils_do_positions_switches_and_seedlings_stay_possible(
    segments: list[tuple[int, frozenset[str], bool]], seed: int
) -> None:
    rig = Rig(seed=seed)
    rig.bring_tray()
    rig.go_to_pick(1)
    rig.close()
    for for_ms, tags, emergency_stop in segments:
        rig.plant.box.emergency_stop = emergency_stop and for_ms % 4 == 0
        rig.run(for_ms, *tags)
        assert_possible(rig)


def assert_possible(rig: Rig) -> None:
    plant = rig.plant
    for arm in plant.arms.values():
        assert 0.0 <= arm.slide.x_m <= 0.600
        assert 0.0 <= arm.lift.y_m <= 0.150
        assert -10.0 <= arm.claws.angle_deg <= 30.0
        assert 0.0 <= arm.spreader.travel_m <= 0.187
    for tags in CONTRADICTIONS:
        assert sum(rig.active(tag) for tag in tags) <= 1
    counts = plant.counts()
    assert counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T == counts.total == 144
    places = Counter(seedling.place for seedling in plant.seedlings)
    assert counts.in_tray == places[Place.STANDING] + places[Place.CLAMPED]
    assert counts.in_claw == places[Place.IN_CLAW] + places[Place.FALLING]
    assert (counts.in_cups, counts.P, counts.D, counts.T) == tuple(
        places[place] for place in (Place.IN_CUP, Place.LOST_PICK, Place.LOST_CARRY, Place.LOST_THROW)
    )
    held = [seedling for arm in plant.arms.values() for seedling in arm.grip.held]
    assert len(held) == places[Place.CLAMPED] + places[Place.IN_CLAW]


def random_run(seed: int, *, split: int = 1) -> tuple[object, ...]:
    """Pick and throw a row, then drive random coils for 40 s, the same for every plant seed."""
    rig = Rig({"crop.claw_pressure_mpa": 0.60}, seed=seed)
    rig.bring_tray()
    rig.pick(1)
    rig.throw()
    coils = random.Random(11)
    images = []
    for _ in range(400):
        tags = coils.sample(OUTPUTS, k=3)
        for _ in range(split):
            rig.run(100 // split, *tags)
        images.append(rig.plant.x)
    return snapshot(rig.plant), images, rig.plant.counts(), rig.plant.events, rig.plant.missed_cups


def snapshot(plant: Plant) -> list[float]:
    arms = plant.arms.values()
    return [
        *(part for a in arms for part in (a.slide.x_m, a.lift.y_m, a.claws.angle_deg, a.spreader.travel_m)),
        plant.conveyor.belt_m,
        *(arm.cups.chain_m for arm in arms),
    ]


def test_the_same_seed_and_coils_give_the_same_plant_bit_for_bit() -> None:
    first = random_run(5)
    assert first == random_run(5)
    assert first == random_run(5, split=10)
    assert first != random_run(6)
    assert first[2] != random_run(6)[2]


def test_a_slow_run_loses_the_same_seedlings_as_a_fast_one() -> None:
    def lost(pause_ms: int) -> list[tuple[int, int, Place]]:
        rig = Rig({"crop.claw_pressure_mpa": 0.60}, seed=3)
        rig.bring_tray()
        rig.run(pause_ms)
        rig.pick(1)
        rig.run(pause_ms)
        rig.throw()
        return [(s.column, s.along, s.place) for s in rig.plant.seedlings if s.place is not Place.STANDING]

    fast = lost(0)
    assert len(fast) == 12
    assert len({place for _, _, place in fast}) > 1
    assert lost(7_300) == fast


def test_odd_durations_add_up() -> None:
    rig = Rig()
    for for_ms in (1, 2, 3, 7, 13, 0, 274):
        rig.run(for_ms, "left.slide_inward")
    assert rig.plant.time_ms == 300
    even = Rig()
    even.run(300, "left.slide_inward")
    late_m = even.left.slide.x_m - rig.left.slide.x_m
    assert 0.0 <= late_m < 0.0015  # valve and dead time end with a step, so either up to 5 ms later


def test_crop_settings_beyond_the_trials_are_told() -> None:
    assert not Rig().plant.extrapolates
    assert Rig({"crop.claw_pressure_mpa": 0.75}).plant.extrapolates
