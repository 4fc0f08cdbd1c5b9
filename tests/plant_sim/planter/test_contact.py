"""Tests of the contact dynamics of the block: closed forms, invariances and the paper's three cases."""

import dataclasses
import itertools
import math

import pymunk
import pytest

from plant_sim.planter.contact import STEP_S, Fall, FallFrame, add_block, add_floor, add_soil, drop, new_space
from plant_sim.planter.falls import motion_at
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter, load_planter
from plant_sim.planter.separation import GRAVITY_M_S2
from plant_sim.planter.verdict import FallVerdict, verdict_of

MM = 1e3


@pytest.fixture(scope="module")
def planter() -> Planter:
    return load_planter()


def standing(planter: Planter, space: pymunk.Space, *, above_mm: float = 0.0, slope_rad: float = 0.0) -> pymunk.Body:
    """Return a block that stands on the floor or is above it, parallel to its slope."""
    body = add_block(space, planter.block)
    up_mm = MM * planter.block.centre_m + above_mm
    body.angle = -slope_rad
    body.position = (up_mm * math.sin(slope_rad), up_mm * math.cos(slope_rad))
    return body


def run(space: pymunk.Space, for_s: float) -> None:
    for _ in range(round(for_s / STEP_S)):
        space.step(STEP_S)


def case(planter: Planter, speed_km_h: float, step_s: float = STEP_S) -> Fall:
    """Return the fall of one of the paper's cases on rigid ground."""
    motion = Motion(planter.chain, speed_m_s=speed_km_h / 3.6, frequency_per_min=56)
    return drop(planter, planter.rigid_ground, motion, opener_deg=planter.chain.release_deg, step_s=step_s)


def test_free_fall_follows_gravity(planter: Planter) -> None:
    """The height of a block agrees with free fall, within the error of a first-order time step."""
    space = new_space()
    body = standing(planter, space, above_mm=300.0)
    start_mm = body.position.y
    run(space, 0.2)
    fallen_m = (start_mm - body.position.y) / MM
    assert fallen_m == pytest.approx(GRAVITY_M_S2 * 0.2**2 / 2, abs=GRAVITY_M_S2 * 0.2 * STEP_S)
    assert body.velocity.y == pytest.approx(-MM * GRAVITY_M_S2 * 0.2, rel=1e-9)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.6])
def test_bounce_returns_the_restitution_of_the_speed(planter: Planter, restitution: float) -> None:
    space = new_space()
    add_floor(space, friction=0.5, restitution=restitution)
    body = standing(planter, space, above_mm=100.0)
    speeds = []
    for _ in range(round(0.2 / STEP_S)):
        space.step(STEP_S)
        speeds.append(body.velocity.y)
    rebound = max(speeds) / -min(speeds)
    assert rebound == pytest.approx(restitution, abs=0.02)


@pytest.mark.parametrize("friction", [0.2, 0.4])
def test_sliding_block_stops_after_the_distance_of_friction(planter: Planter, friction: float) -> None:
    space = new_space()
    add_floor(space, friction=friction, restitution=0.0)
    body = standing(planter, space)
    run(space, 0.05)
    start_mm, speed_m_s = body.position.x, 0.6
    body.velocity = (MM * speed_m_s, 0.0)
    run(space, 0.5)
    assert abs(body.velocity.x) < 0.1
    slid_m = (body.position.x - start_mm) / MM
    assert slid_m == pytest.approx(speed_m_s**2 / (2 * friction * GRAVITY_M_S2), rel=0.01)


@pytest.mark.parametrize("friction", [0.3, 0.5])
def test_block_on_a_slope_slides_above_the_angle_of_friction(planter: Planter, friction: float) -> None:
    """Below the angle of friction the block does not slide; above it, gravity less friction accelerates it."""
    for extra_deg in (-3.0, 3.0):
        angle = math.atan(friction) + math.radians(extra_deg)
        space = new_space()
        add_floor(space, friction=friction, restitution=0.0, slope_rad=angle)
        body = standing(planter, space, slope_rad=angle)
        run(space, 0.3)
        expected_m_s = max(0.0, GRAVITY_M_S2 * (math.sin(angle) - friction * math.cos(angle)) * 0.3)
        assert body.velocity.length / MM == pytest.approx(expected_m_s, abs=0.01)


def test_block_on_a_steep_rough_slope_tips_when_its_centre_is_outside_the_base(planter: Planter) -> None:
    critical = math.atan(planter.block.edge_m / 2 / planter.block.centre_m)
    for extra_deg, tips in ((-1.5, False), (1.5, True)):
        angle = critical + math.radians(extra_deg)
        space = new_space()
        add_floor(space, friction=5.0, restitution=0.0, slope_rad=angle)
        body = standing(planter, space, slope_rad=angle)
        run(space, 1.0)
        assert (abs(body.angle + angle) > math.radians(20.0)) == tips


@pytest.mark.parametrize(("share", "tips"), [(0.97, False), (1.03, True)])
def test_block_tips_over_its_edge_with_enough_energy(planter: Planter, share: float, tips: bool) -> None:
    """A block tips if its rotation about the front edge lifts the centre of mass above that edge."""
    block = planter.block
    space = new_space()
    add_floor(space, friction=5.0, restitution=0.0)
    body = standing(planter, space)
    arm_m = math.hypot(block.edge_m / 2, block.centre_m)
    inertia_kg_m2 = block.inertia_kg_m2 + block.mass_kg * arm_m**2
    needed_rad_s = math.sqrt(2 * block.mass_kg * GRAVITY_M_S2 * (arm_m - block.centre_m) / inertia_kg_m2)
    omega = share * needed_rad_s
    body.angular_velocity = -omega
    body.velocity = (MM * omega * block.centre_m, MM * omega * block.edge_m / 2)
    run(space, 1.2)
    assert (abs(body.angle) > math.radians(60.0)) == tips


def test_loose_soil_stops_a_sliding_block_sooner(planter: Planter) -> None:
    """The constant resistance of the soil dissipates kinetic energy in addition to friction."""
    friction, speed_m_s = 0.2, 0.6
    soil = dataclasses.replace(planter.bench_soil, friction=friction, cover_m=0.02, resistance_pa=500.0)
    space = new_space()
    add_floor(space, friction=friction, restitution=0.0)
    body = standing(planter, space)
    run(space, 0.05)
    add_soil(space, body, planter.block, soil)
    start_mm = body.position.x
    body.velocity = (MM * speed_m_s, 0.0)
    run(space, 0.5)
    resistance_n = friction * planter.block.mass_kg * GRAVITY_M_S2 + soil.soil_n(planter.block)
    slid_m = (body.position.x - start_mm) / MM
    assert slid_m == pytest.approx(planter.block.mass_kg * speed_m_s**2 / 2 / resistance_n, rel=0.02)


def test_equal_arguments_give_equal_falls(planter: Planter) -> None:
    assert case(planter, 1.9) == case(planter, 1.9)


def test_gripped_block_moves_with_the_planter(planter: Planter) -> None:
    """The block keeps its position in the planter until the plates release it."""
    frames: list[FallFrame] = []
    motion = Motion(planter.chain, speed_m_s=1.4 / 3.6, frequency_per_min=56)
    drop(planter, planter.rigid_ground, motion, opener_deg=75.0, frames=frames)
    held = round(planter.grip.free_s / STEP_S) - 1
    places = [frame.block_y_m - frame.hinge_y_m for frame in frames]
    assert places[held] == pytest.approx(places[0], abs=3e-5)
    assert places[held + 40] < places[0] - 1e-3


def test_flight_relative_to_the_planter_does_not_depend_on_the_ratio(planter: Planter) -> None:
    """In free flight, the path relative to the planter is the same at every constant machine speed."""
    paths = []
    for speed_km_h in (1.9, 1.4):
        frames: list[FallFrame] = []
        motion = Motion(planter.chain, speed_m_s=speed_km_h / 3.6, frequency_per_min=56)
        drop(planter, planter.rigid_ground, motion, opener_deg=75.0, frames=frames)
        paths.append([(f.block_x_m - f.hinge_x_m, f.block_y_m - f.hinge_y_m) for f in frames if f.block_y_m > 1e-4])
    flight = min(map(len, paths))
    assert flight > 60
    for left, right in itertools.islice(zip(*paths, strict=False), 60):
        assert left == pytest.approx(right, abs=2e-6)


@pytest.mark.parametrize(
    ("speed_km_h", "verdict"), [(1.9, FallVerdict.FORWARD), (1.65, FallVerdict.PUSHED), (1.4, FallVerdict.CLEAN)]
)
@pytest.mark.parametrize("step_s", [5e-4, 2e-4])
def test_paper_cases_have_the_paper_verdicts(
    planter: Planter, speed_km_h: float, verdict: FallVerdict, step_s: float
) -> None:
    """One geometry gives the three verdicts of [K] 2.2.2, with steps of 0.5 and 0.2 ms."""
    fall = case(planter, speed_km_h, step_s=step_s)
    assert verdict_of(fall.tilt_deg, fall.pushed_m) is verdict
    assert (fall.scrape_n_s > 0.0) == (verdict is not FallVerdict.CLEAN)
    if verdict is FallVerdict.PUSHED:
        assert 0.0 < fall.pushed_m < 0.02


def test_guide_plate_far_behind_the_block_never_touches_it(planter: Planter) -> None:
    far = dataclasses.replace(planter, chain=dataclasses.replace(planter.chain, guide_behind_m=0.1))
    fall = case(far, 1.9)
    assert fall.scrape_n_s == 0.0
    assert abs(fall.tilt_deg) < 1.0


def test_deeper_furrow_takes_the_block_out_of_reach(planter: Planter) -> None:
    """The lower the base of the block is below the tip, the less the guide plate pushes the block."""
    motion = motion_at(planter, 0.87)
    pushes = []
    for clearance_m in (0.0, 0.01, 0.03):
        ground = dataclasses.replace(planter.rigid_ground, clearance_m=clearance_m)
        pushes.append(drop(planter, ground, motion, opener_deg=75.0).scrape_n_s)
    assert pushes[0] > pushes[1] > pushes[2]
