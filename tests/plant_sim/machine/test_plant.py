"""The complete plant as seen at its terminals: wiring, power, time, and invariants."""

import random
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.common.declarations import DeclarationError
from controller.common.modbus.io_map import Polarity
from plant_sim.crop.seedling import Location
from plant_sim.machine.plant import Plant
from tests.plant_sim.machine.plant_rig import IO_MAP, MACHINE, Rig
from tests.sampling import examples
from tests.wiring import unwired, wired

NETWORK = ("receiver", "header", "manifold", "claw_reservoir", "claw_manifold")
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


def test_the_initial_state_is_that_after_a_normal_stop() -> None:
    rig = Rig()
    required = [point.tag for point in IO_MAP.inputs if not point.optional]
    active = {tag for tag in required if rig.active(tag)} - {"left.cup_pulse", "right.cup_pulse"}
    home = ("lift_down", "slide_at_feed", "claws_converged")
    assert active == {f"{side}.{tag}" for side in ("left", "right") for tag in home}
    assert rig.plant.counts().in_tray == rig.plant.counts().total == 144
    assert rig.plant.time_ms == 0


def test_without_outputs_only_the_cups_move() -> None:
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
def test_each_coil_moves_one_part_only(side: str, coil: str, place: dict[str, float], leaves: str) -> None:
    rig = Rig(trays=0)
    for arm in rig.plant.arms.values():
        arm.place(**place)  # type: ignore[arg-type]
    other = "right" if side == "left" else "left"
    assert rig.active(f"{side}.{leaves}")
    rig.run(1_000, f"{side}.{coil}")
    assert not rig.active(f"{side}.{leaves}")
    assert rig.active(f"{other}.{leaves}")


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_claw_coils_open_and_close_one_side_only(side: str) -> None:
    rig = Rig()
    rig.run(300, f"{side}.claws_close")
    assert rig.plant.arms[side].claws.angle_deg == -10
    assert [arm.claws.angle_deg for arm in rig.plant.arms.values()].count(30) == 1
    rig.run(300, f"{side}.claws_open")
    assert rig.plant.arms[side].claws.angle_deg == 30


@pytest.mark.parametrize(
    ("button", "tag"), [("start", "start"), ("stop", "stop"), ("emergency_stop", "emergency_stop")]
)
def test_a_button_takes_effect_at_once_with_the_polarity_of_its_wire(button: str, tag: str) -> None:
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
    rig.run(1_000)
    assert rig.left.slide.x_m == 0.002
    rig.run(1_000, "left.slide_inward")
    assert rig.left.slide.x_m > 0.05


def test_the_level_of_a_stuck_sensor_is_at_its_terminal() -> None:
    rig = Rig()
    rig.plant.sensors["left.lift_up"].stuck = True
    assert rig.active("left.lift_up")
    assert not rig.active("right.lift_up")
    rig.plant.sensors["left.lift_up"].stuck = None
    assert not rig.active("left.lift_up")


def test_optional_points_appear_only_when_wired() -> None:
    rig = Rig()
    assert len(rig.plant.x) == IO_MAP.input_count
    assert rig.plant.indicators == {"lamp_amber": False}
    assert Rig(io_map=unwired("lamp_amber")).plant.indicators == {}
    io_map = wired("reset", "air_pressure_ok", "magazine_empty", "horn", "lamp_green")
    rig = Rig(io_map=io_map)
    assert len(rig.plant.x) == max(25, IO_MAP.input_count)
    assert [rig.active(tag) for tag in ("reset", "air_pressure_ok", "magazine_empty")] == [False, True, False]
    rig.plant.box.reset = True
    assert [rig.active(tag) for tag in ("reset", "air_pressure_ok", "magazine_empty")] == [True, True, False]
    rig.run(4_000, "tray_run", "tray_forward", "lamp_green")
    assert rig.active("magazine_empty")
    assert rig.plant.indicators == {"horn": False, "lamp_amber": False, "lamp_green": True}


def test_a_terminal_without_a_wire_stays_off() -> None:
    rig = Rig(io_map=wired("magazine_empty"), trays=0)
    assert rig.plant.x[22:25] == [False, False, True]


def test_a_broken_wire_reads_off_regardless_of_its_sensor() -> None:
    rig = Rig()
    assert rig.active("left.lift_down")
    rig.plant.broken_wires.add("left.lift_down")
    assert not rig.active("left.lift_down")
    assert rig.plant.sensors["left.lift_down"].read()
    rig.plant.broken_wires.clear()
    assert rig.active("left.lift_down")


def test_the_y_image_can_be_read_back() -> None:
    plant = Rig().plant
    assert plant.y == IO_MAP.safe_outputs()
    image = [number % 3 == 0 for number in range(IO_MAP.output_count)]
    plant.step(1, image)
    assert plant.y == image
    plant.y[0] = False
    assert plant.y == image


def test_an_unknown_wired_input_is_rejected() -> None:
    extra = replace(IO_MAP.inputs[0], tag="moon", line=7)
    with pytest.raises(ValueError, match=r"io_map.yaml:7: moon: the machine has no such sensor or button"):
        Plant(replace(IO_MAP, inputs=(*IO_MAP.inputs, extra)), MACHINE, seed=1)


def test_a_coil_without_a_wire_is_rejected() -> None:
    outputs = tuple(point for point in IO_MAP.outputs if point.tag != "left.spread")
    with pytest.raises(DeclarationError, match=r"left\.spread"):
        Plant(replace(IO_MAP, outputs=outputs), MACHINE, seed=1)


def test_negative_times_and_incomplete_images_are_rejected() -> None:
    plant = Rig().plant
    with pytest.raises(ValueError, match="must be 0 or more"):
        plant.step(-1, IO_MAP.safe_outputs())
    with pytest.raises(ValueError, match="20 levels"):
        plant.step(10, IO_MAP.safe_outputs()[:-1])
    assert plant.time_ms == 0


def test_the_image_belongs_to_the_caller() -> None:
    plant = Rig().plant
    image = plant.x
    image[0] = True
    assert plant.x[0] is False


@given(segments=SEGMENTS, seed=st.integers(0, 1_000))
@examples(12, nightly=40)
def test_positions_switches_pressures_and_seedlings_stay_valid_under_random_coils(
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
        assert -0.0005 <= arm.lift.y_m <= 0.1505  # the stops yield
        assert -10.0 <= arm.claws.angle_deg <= 30.0
        assert 0.0 <= arm.spreader.travel_m <= 0.187
    for tags in CONTRADICTIONS:
        assert sum(rig.active(tag) for tag in tags) <= 1
    assert_pressures_possible(plant)
    assert_seedlings_accounted_for(plant)


def assert_pressures_possible(plant: Plant) -> None:
    """Check that there is no vacuum, and no pressure above the limits set by the supply and a falling arm.

    The receiver pressure is at most 0.75 MPa gauge plus one step of compressor delivery. The valves supply at most the
    regulated 601 kPa. A lift driven down by 591 kPa and 147 N of weight compresses the air on its rod side from 551 kPa
    to (490 kPa * 1963.5 mm2 + 147 N) / 1649.3 mm2 + 101 kPa = 774 kPa. It overshoots by at most the same increase of
    223 kPa, i.e. to 997 kPa.
    """
    network = plant.state[0]["air"]["network"]
    assert all(50e3 < float(network[name]["pressure_pa"]) < 860e3 for name in NETWORK)
    for arm in plant.state[0]["arms"]:
        for cylinder, highest_pa in (("slide", 997e3), ("lift", 997e3), ("claws", 620e3)):
            for end in ("plus", "minus"):
                line = arm[cylinder][end]
                assert 20e3 < float(line["chamber"]["pressure_pa"]) < highest_pa
                assert 50e3 < float(line["tube"]["pressure_pa"]) < highest_pa
                assert line["chamber"]["mass_kg"] > 0.0


def assert_seedlings_accounted_for(plant: Plant) -> None:
    counts = plant.counts()
    assert counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T == counts.total == 144
    places = Counter(seedling.location for seedling in plant.seedlings)
    assert counts.in_tray == places[Location.STANDING] + places[Location.CLAMPED]
    assert counts.in_claw == places[Location.IN_CLAW] + places[Location.FALLING]
    assert (counts.in_cups, counts.P, counts.D, counts.T) == tuple(
        places[place] for place in (Location.IN_CUP, Location.LOST_PICK, Location.LOST_CARRY, Location.LOST_THROW)
    )
    gripped = [seedling for arm in plant.arms.values() for seedling in arm.grip.held]
    assert len(gripped) == places[Location.CLAMPED] + places[Location.IN_CLAW]


def random_run(seed: int, *, split: int = 1) -> tuple[object, ...]:
    """Pick and throw a row, then drive random coils for 40 s; the coils do not depend on the seed of the plant."""
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


def test_the_same_seed_and_coils_give_bit_identical_plants() -> None:
    first, other = random_run(5), random_run(6)
    assert first == random_run(5)
    assert first == random_run(5, split=10)
    assert first != other
    assert first[2] != other[2]


def test_a_slow_run_loses_the_same_seedlings_as_a_fast_one() -> None:
    def lost(pause_ms: int) -> list[tuple[int, int, Location]]:
        rig = Rig({"crop.claw_pressure_mpa": 0.60}, seed=3)
        rig.bring_tray()
        rig.run(pause_ms)
        rig.pick(1)
        rig.run(pause_ms)
        rig.throw()
        return [(s.column, s.along, s.location) for s in rig.plant.seedlings if s.location is not Location.STANDING]

    fast = lost(0)
    assert len(fast) == 12
    assert len({place for _, _, place in fast}) > 1
    assert lost(7_300) == fast


def test_odd_durations_add_up() -> None:
    rig, even = Rig(), Rig()
    for for_ms in (1, 2, 3, 7, 13, 0, 974):
        rig.run(for_ms, "left.slide_inward", "right.lift_retract")
    even.run(1_000, "left.slide_inward", "right.lift_retract")
    assert rig.plant.time_ms == 1_000
    assert snapshot(rig.plant) == snapshot(even.plant)
    assert rig.left.slide.x_m > 0.05


def test_crop_settings_beyond_the_trials_are_reported() -> None:
    assert not Rig().plant.extrapolates
    assert Rig({"crop.claw_pressure_mpa": 0.75}).plant.extrapolates
