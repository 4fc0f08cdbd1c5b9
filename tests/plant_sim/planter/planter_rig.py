"""Motions of the paper's chain and random motions for tests."""

from __future__ import annotations

import dataclasses

from hypothesis import strategies as st

from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.parameters import load_planter

CHAIN = load_planter().chain
FREQUENCY_PER_MIN = 56.0


def motion_at(speed_km_h: float, model: MotionModel = MotionModel.RIGID, chain: ChainSpec = CHAIN) -> Motion:
    return Motion(chain, speed_m_s=speed_km_h / 3.6, frequency_per_min=FREQUENCY_PER_MIN, model=model)


def motion_of_ratio(ratio: float, model: MotionModel = MotionModel.RIGID, chain: ChainSpec = CHAIN) -> Motion:
    chain_m_s = Motion(chain, speed_m_s=1.0, frequency_per_min=FREQUENCY_PER_MIN).chain_m_s
    return Motion(chain, speed_m_s=chain_m_s / ratio, frequency_per_min=FREQUENCY_PER_MIN, model=model)


@st.composite
def motions(draw: st.DrawFn, models: tuple[MotionModel, ...] = tuple(MotionModel)) -> Motion:
    """Return a motion with random R, H, l, h, number of planters, machine speed, planting frequency and model."""
    chain = dataclasses.replace(
        CHAIN,
        sprocket_radius_m=draw(st.floats(0.03, 0.3)),
        centre_distance_m=draw(st.floats(0.2, 3.0)),
        planters=draw(st.integers(1, 12)),
        offset_m=draw(st.floats(0.0, 0.2)),
        tip_height_m=draw(st.floats(0.05, 0.5)),
    )
    return Motion(
        chain,
        speed_m_s=draw(st.floats(0.05, 3.0)),
        frequency_per_min=draw(st.floats(5.0, 200.0)),
        model=draw(st.sampled_from(models)),
    )
