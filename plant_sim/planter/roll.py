"""Fall of a rolled block across the row.

The contact with the guide plate is simulated in the plane of travel only. The roll of a block is simulated separately,
in the plane across the row, with the same block, ground and solver: the block leaves the plates with its roll, with
the vertical speed of the planter and, if the plates open unevenly, with a speed across the row. The opened plates and
loose soil, which can only limit the roll, are omitted. The two planes do not influence each other: a push by the guide
plate on a block that stands on one edge is not simulated.
"""

from __future__ import annotations

import math

from plant_sim.planter.contact import (
    LONGEST_S,
    LYING_RAD,
    REST_STEPS,
    STEP_S,
    Disturbance,
    add_block,
    add_floor,
    is_still,
    new_space,
)
from plant_sim.planter.ground import GroundSpec
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter

_MM = 1e3


def final_roll_deg(
    planter: Planter, ground: GroundSpec, motion: Motion, disturbance: Disturbance, *, opener_deg: float
) -> float:
    """Return the angle of the stem from the vertical at rest, across the row, degrees.

    Args:
        planter: Parameters of the planter.
        ground: Ground below the planter.
        motion: Motion of the planters.
        disturbance: Deviations, of which `roll_deg` and `uneven_s` are used.
        opener_deg: Phase on the bottom arc at which the opener starts to move the plates, degrees.
    """
    spec, grip, chain = planter.block, planter.grip, planter.chain
    roll_rad, half_m = math.radians(disturbance.roll_deg), spec.edge_m / 2
    free_rad = math.radians(opener_deg) + motion.omega_rad_s * grip.free_after_s(disturbance.uneven_s)
    space = new_space()
    add_floor(space, friction=ground.friction, restitution=ground.restitution)
    block = add_block(space, spec)
    hinge_m = chain.sprocket_radius_m * (1 - math.sin(free_rad))
    middle_m = hinge_m + ground.clearance_m + chain.block_top_m - half_m
    middle_m = max(middle_m, half_m * (math.cos(roll_rad) + abs(math.sin(roll_rad))))
    block.angle = -roll_rad
    block.position = (0.0, _MM * (middle_m + (spec.centre_m - half_m) * math.cos(roll_rad)))
    down_m_s = motion.chain_m_s * math.cos(free_rad)
    block.velocity = (_MM * grip.sideways_m_s(disturbance.uneven_s), -_MM * down_m_s)
    resting = 0
    for _ in range(round(LONGEST_S / STEP_S)):
        space.step(STEP_S)
        resting = resting + 1 if is_still(block) else 0
        if resting >= REST_STEPS or abs(block.angle) > LYING_RAD:
            break
    return -math.degrees(block.angle)
