"""Contact of a released block with the planter and the ground, in the plane of travel.

The library pymunk simulates rigid bodies in two dimensions: the block with its stem, the guide plate, which follows its
path regardless of contact, and the bottom of the furrow. The guide plate is a fork: the stem passes between its prongs,
so the plate touches the cube only (assumption; the shape is not published). The plates grip across the plane of
travel. Their effect is Coulomb friction between planter and block, with the normal force `GripSpec.force_n`; the moment
of the friction is that of a square contact area. Planter and guide plate follow the polygon of the chain. In the
simulation, lengths are in mm and forces in mN.

Time step and solver settings are fixed, and nothing is random: equal arguments give equal results on one computer.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import pymunk

from plant_sim.planter.block import BlockSpec
from plant_sim.planter.grip import GripSpec
from plant_sim.planter.ground import GroundSpec
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.polygon import polygon_path_m
from plant_sim.planter.separation import GRAVITY_M_S2

STEP_S: Final = 5e-4
"""Time step, s. A step of 0.2 ms gives the same verdicts (tests/plant_sim/planter/test_contact.py)."""

LONGEST_S: Final = 1.2
"""Longest simulated time after the start of the opening, s."""

LYING_RAD: Final = math.radians(80.0)
"""Angle from the vertical at which a block counts as lying, and the simulation ends, rad."""
REST_STEPS: Final = 80
"""Number of steps without motion after which a block is at rest."""

_MM: Final = 1e3
_ITERATIONS: Final = 20
"""Passes of the solver over the contacts and joints in a step, which are solved one after another."""
_SLOP_MM: Final = 0.02
"""Overlap that the solver permits, mm, so that resting contacts persist from step to step."""
_BIAS: Final = 5e-4
"""Share of an overlap that is left after 1 s."""
_GROUND, _GUIDE, _BLOCK = 1, 2, 3
_PLATE_MM: Final = 2.0
_PLATE_HEIGHT_MM: Final = 150.0
_FLOOR_MM: Final = (-2_000.0, 6_000.0)
_MEAN_RADIUS: Final = 0.3826
"""Mean distance of the points of a square from its centre, divided by its edge: the lever arm of the friction."""
_REST_MM_S, _REST_RAD_S = 3.0, 0.1
_CLEAR_M: Final = 0.01
"""Height of the guide plate above the highest point of the cube at which it cannot touch the block any more, m."""


class FallFrame(NamedTuple):
    """Positions at one time, along the row from the lowest point of the hinge.

    Attributes:
        time_s: Time since the hinge was at its lowest point, s.
        hinge_x_m: Position of the hinge along the row, m.
        hinge_y_m: Height of the hinge above its lowest point, m.
        block_x_m: Position of the middle of the base of the block along the row, m.
        block_y_m: Height of this point above the bottom of the furrow, m.
        tilt_rad: Angle of the stem from the vertical, forward positive, rad.
    """

    time_s: float
    hinge_x_m: float
    hinge_y_m: float
    block_x_m: float
    block_y_m: float
    tilt_rad: float


class Disturbance(NamedTuple):
    """Deviations of one fall from the nominal one.

    Attributes:
        behind_m: Distance of the block behind its nominal position in the planter, m. A block that the guide plate
            would penetrate touches it instead.
        pitch_deg: Angle of the stem from the vertical in the plates, forward positive, degrees.
        roll_deg: Angle of the stem from the vertical in the plates, across the row, degrees; `drop` does not use it.
        uneven_s: Delay of the second plate at the opening, s.
        slope_deg: Slope of the bottom of the furrow, positive if it falls in the direction of travel, degrees.
    """

    behind_m: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    uneven_s: float = 0.0
    slope_deg: float = 0.0


UNDISTURBED: Final = Disturbance()


class Fall(NamedTuple):
    """Result of one simulated fall.

    Attributes:
        along_m: Middle of the base at rest, measured from the hinge at its lowest point, forward positive, m.
        tilt_deg: Angle of the stem from the vertical at rest, forward positive, degrees.
        pushed_m: Displacement of the centre of mass from the first contact with the ground until rest, m; 0 if the
            guide plate did not touch the block on the ground.
        scrape_n_s: Impulse between guide plate and block after the first contact with the ground, N s.
        landed_deg: Phase of the planter on the bottom arc at the first contact with the ground, degrees; more than 180
            on the straight segment; nan without contact.
        rested: True if the block was at rest at the end of the simulated time.
    """

    along_m: float
    tilt_deg: float
    pushed_m: float
    scrape_n_s: float
    landed_deg: float
    rested: bool


def drop(
    planter: Planter,
    ground: GroundSpec,
    motion: Motion,
    *,
    opener_deg: float,
    disturbance: Disturbance = UNDISTURBED,
    step_s: float = STEP_S,
    frames: list[FallFrame] | None = None,
) -> Fall:
    """Simulate the fall of one block from the start of the opening until it is at rest.

    Args:
        planter: Parameters of the planter.
        ground: Ground below the planter.
        motion: Motion of the planters, in the model `MotionModel.RIGID`.
        opener_deg: Phase on the bottom arc at which the opener starts to move the plates, degrees.
        disturbance: Deviations from the nominal fall.
        step_s: Time step, s.
        frames: List to which the positions at every step are appended.
    """
    return _Drop(planter, ground, motion, disturbance, opener_deg=opener_deg, step_s=step_s).run(frames)


class _Drop:
    """One simulated fall."""

    def __init__(
        self,
        planter: Planter,
        ground: GroundSpec,
        motion: Motion,
        disturbance: Disturbance,
        *,
        opener_deg: float,
        step_s: float,
    ) -> None:
        self._planter, self._ground, self._motion, self._step_s = planter, ground, motion, step_s
        self._opener_deg, self._uneven_s = opener_deg, disturbance.uneven_s
        self._space = new_space()
        self._path, self._lowest_s = self._hinge_path_mm(opener_deg)
        self._guide = self._add_guide(ground)
        add_floor(
            self._space,
            friction=ground.friction,
            restitution=ground.restitution,
            slope_rad=math.radians(disturbance.slope_deg),
        )
        self._block = add_block(self._space, planter.block)
        self._grip = self._place(disturbance)
        self._free_step = math.ceil(planter.grip.free_after_s(disturbance.uneven_s) / step_s)
        self._touched_mm: float | None = None
        self._touched_step = 0
        self._scrape_mn_s = 0.0
        self._in_soil = False
        self._space.on_collision(_GROUND, _BLOCK, post_solve=self._on_ground)
        self._space.on_collision(_GUIDE, _BLOCK, post_solve=self._on_guide)

    def run(self, frames: list[FallFrame] | None) -> Fall:
        """Simulate until the block is at rest or lies on the ground, or `LONGEST_S` has passed."""
        block, guide, step_s = self._block, self._guide, self._step_s
        path: list[tuple[float, float]] = self._path.tolist()
        speeds: list[tuple[float, float]] = (np.diff(self._path, axis=0) / step_s).tolist()
        # the guide plate can push the cube until its lower edge has risen above it, whatever the tilt
        clear_mm = _MM * (math.sqrt(2) * self._planter.block.edge_m + _CLEAR_M)
        clear = int(np.argmax(self._path[:, 1] > clear_mm)) if self._path[-1, 1] > clear_mm else len(path)
        resting, rested, self._index = 0, False, 0
        for index, speed in enumerate(speeds):
            self._index = index
            if index <= self._free_step:
                self._release(index * step_s)
            # contacts act on the velocity; the position removes the drift of its integration
            guide.position, guide.velocity = path[index], speed
            self._space.step(step_s)
            # here and not in the callback of the contact, which pymunk calls within a step
            if self._touched_mm is not None and not self._in_soil:
                add_soil(self._space, block, self._planter.block, self._ground)
                self._in_soil = True
            if frames is not None:
                frames.append(self._frame(index + 1))
            if index > clear - REST_STEPS:
                resting = resting + 1 if is_still(block) else 0
                rested = resting >= REST_STEPS and index >= clear
            if rested or abs(block.angle) > LYING_RAD:
                break
        return self._fall(rested)

    def _hinge_path_mm(self, opener_deg: float) -> tuple[np.ndarray, float]:
        """Return the positions of the hinge at every step, mm, and the time until its lowest point, s."""
        motion = self._motion
        start_s, lowest_s = motion.time_at_s(opener_deg), motion.time_at_s(90.0)
        times_s = start_s + self._step_s * np.arange(round(LONGEST_S / self._step_s) + 1)
        lowest_m = motion.position_m(lowest_s)[0, 0]
        return _MM * (polygon_path_m(motion, times_s) - lowest_m), lowest_s - start_s

    def _add_guide(self, ground: GroundSpec) -> pymunk.Body:
        """Add the guide plate as a body whose origin is the hinge."""
        chain = self._planter.chain
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        x_mm = -_MM * chain.guide_behind_m - _PLATE_MM
        low_mm = _MM * (ground.clearance_m + chain.guide_above_m) + _PLATE_MM
        plate = pymunk.Segment(body, (x_mm, low_mm), (x_mm, low_mm + _PLATE_HEIGHT_MM), _PLATE_MM)
        plate.friction, plate.elasticity, plate.collision_type = self._planter.grip.guide_friction, 0.0, _GUIDE
        plate.filter = pymunk.ShapeFilter(categories=_GUIDE)
        body.position = tuple(self._path[0])
        self._space.add(body, plate)
        return body

    def _place(self, disturbance: Disturbance) -> tuple[pymunk.PivotJoint, pymunk.GearJoint]:
        """Place the block between the plates and return their friction.

        The plates hold the cube at its centre. Their friction is represented by joints that oppose relative motion
        without correcting positions.
        """
        chain, spec, block = self._planter.chain, self._planter.block, self._block
        forward_rad = math.radians(disturbance.pitch_deg)
        sine, cosine, half_m = math.sin(forward_rad), math.cos(forward_rad), spec.edge_m / 2
        reach_m = half_m * (cosine + abs(sine))
        ahead_m = max(-disturbance.behind_m, reach_m - chain.guide_behind_m)
        high_m = self._ground.clearance_m + chain.block_top_m - half_m
        middle = pymunk.Vec2d(*(self._path[0] + _MM * np.array([ahead_m, high_m])))
        block.angle = -forward_rad
        block.position = middle + _MM * (spec.centre_m - half_m) * pymunk.Vec2d(sine, cosine)
        block.velocity = tuple((self._path[1] - self._path[0]) / self._step_s)
        pivot = pymunk.PivotJoint(self._guide, block, middle)
        gear = pymunk.GearJoint(self._guide, block, 0.0, 1.0)
        pivot.max_bias = gear.max_bias = 0.0
        self._space.add(pivot, gear)
        return pivot, gear

    def _release(self, since_s: float) -> None:
        """Set the friction of the plates at a time since the start of the opening."""
        grip: GripSpec = self._planter.grip
        pivot, gear = self._grip
        # two plates
        pivot.max_force = 2 * grip.friction * grip.force_n(since_s, self._uneven_s) * 1e3
        gear.max_force = pivot.max_force * _MEAN_RADIUS * _MM * self._planter.block.edge_m

    def _on_ground(self, _arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        if self._touched_mm is None:
            self._touched_mm, self._touched_step = self._block.position.x, self._index

    def _on_guide(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        if self._touched_mm is not None:
            self._scrape_mn_s += arbiter.total_impulse.length

    def _base_mm(self) -> tuple[float, float]:
        """Return the position of the middle of the base of the block, mm."""
        x, y = self._block.local_to_world((0.0, -_MM * self._planter.block.centre_m))
        return float(x), float(y)

    def _frame(self, index: int) -> FallFrame:
        hinge_x, hinge_y = self._path[index] / _MM
        x_mm, y_mm = self._base_mm()
        time_s = index * self._step_s - self._lowest_s
        return FallFrame(time_s, float(hinge_x), float(hinge_y), x_mm / _MM, y_mm / _MM, -self._block.angle)

    def _fall(self, rested: bool) -> Fall:
        block, motion = self._block, self._motion
        touched = self._touched_mm is not None
        pushed_mm = block.position.x - self._touched_mm if self._touched_mm is not None and self._scrape_mn_s else 0.0
        landed_deg = self._opener_deg + math.degrees(motion.omega_rad_s * self._touched_step * self._step_s)
        return Fall(
            along_m=self._base_mm()[0] / _MM,
            tilt_deg=-math.degrees(block.angle),
            pushed_m=pushed_mm / _MM,
            scrape_n_s=self._scrape_mn_s / 1e3,
            landed_deg=landed_deg if touched else math.nan,
            rested=rested,
        )


def new_space() -> pymunk.Space:
    """Return an empty pymunk space with gravity and fixed solver settings."""
    space = pymunk.Space()
    space.gravity = (0.0, -_MM * GRAVITY_M_S2)
    space.iterations = _ITERATIONS
    space.collision_slop = _SLOP_MM
    space.collision_bias = _BIAS
    return space


def is_still(block: pymunk.Body) -> bool:
    """Return True if a block does not move."""
    return block.velocity.length < _REST_MM_S and abs(block.angular_velocity) < _REST_RAD_S


def add_floor(space: pymunk.Space, *, friction: float, restitution: float, slope_rad: float = 0.0) -> None:
    """Add the bottom of the furrow, a plane through the origin.

    Args:
        space: Space to which the floor is added.
        friction: Coefficient of friction with the block.
        restitution: Coefficient of restitution with the block.
        slope_rad: Slope, positive if the floor falls in the direction of travel, rad.
    """
    thick_mm = 10.0
    along = np.array([math.cos(slope_rad), -math.sin(slope_rad)])
    down = thick_mm * np.array([-math.sin(slope_rad), -math.cos(slope_rad)])
    start, end = (tuple(x * along + down) for x in _FLOOR_MM)
    floor = pymunk.Segment(space.static_body, start, end, thick_mm)
    floor.friction, floor.elasticity, floor.collision_type = friction, restitution, _GROUND
    space.add(floor)


def add_block(space: pymunk.Space, spec: BlockSpec) -> pymunk.Body:
    """Add an upright block with its stem, with the centre of mass at the origin.

    pymunk multiplies the coefficients of friction and restitution of the two bodies in contact. Those of the block are
    1, so the coefficients of the other body apply.
    """
    body = pymunk.Body(spec.mass_kg, spec.inertia_kg_m2 * _MM**2)
    half, stem, centre = _MM * spec.edge_m / 2, _MM * spec.stem_diameter_m / 2, _MM * spec.centre_m
    top, height = _MM * spec.edge_m - centre, _MM * spec.height_m - centre
    cube = pymunk.Poly(body, [(-half, -centre), (half, -centre), (half, top), (-half, top)])
    rod = pymunk.Poly(body, [(-stem, top), (stem, top), (stem, height), (-stem, height)])
    rod.filter = pymunk.ShapeFilter(mask=pymunk.ShapeFilter.ALL_MASKS() ^ _GUIDE)
    for shape in (cube, rod):
        shape.friction = shape.elasticity = 1.0
        shape.collision_type = _BLOCK
    space.add(body, cube, rod)
    return body


def add_soil(space: pymunk.Space, body: pymunk.Body, spec: BlockSpec, ground: GroundSpec) -> None:
    """Add the loose soil around the base of a standing block as plastic resistance to displacement and tilting."""
    if not ground.soil_n(spec):
        return
    anchor = (0.0, _MM * (ground.cover_m / 2 - spec.centre_m))
    x, y = body.local_to_world(anchor)
    reach_mm = _MM * spec.height_m
    slide = pymunk.GrooveJoint(space.static_body, body, (x, y - reach_mm), (x, y + reach_mm), anchor)
    turn = pymunk.GearJoint(space.static_body, body, body.angle, 1.0)
    slide.max_bias = turn.max_bias = 0.0
    # N in mN, N m in mN mm
    slide.max_force, turn.max_force = ground.soil_n(spec) * 1e3, ground.soil_nm(spec) * 1e6
    space.add(slide, turn)
