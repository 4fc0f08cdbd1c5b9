"""Limits within which no seedling is affected: omitting the looks within them changes nothing, for any motion."""

from __future__ import annotations

import random

import numpy as np
import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.crop.quiet import POSE_OUTSIDE, ROW_OUTSIDE, between
from plant_sim.crop.seedling import Location
from plant_sim.machine.kernel import POSITIONS
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from tests.sampling import first_of

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
LOOKS = 6_000
ARM = len(POSITIONS)
SLIDE, LIFT, CLAWS, SPREADER, CHAIN, SPEED, STIRRED, FREED, SLIPS, CLAMP = range(ARM)


class AnyMotion:
    """Random motion of both arms and the trays, which often passes and touches the thresholds of the rules."""

    def __init__(self, plant: Plant, seed: int) -> None:
        self._draws = random.Random(f"motion {seed}")
        self._claws = plant.left.claws
        self._plant = plant
        self.positions = plant.positions.copy()
        self._goals = [self._goal() for _ in range(2)]
        self._trays_m_look = 0.0
        self._tray_speeds_m = [0.0] * (2 if seed % 2 else 12) + [0.001, 0.003, -0.001]

    def step(self, now_s: float) -> np.ndarray:
        """Return the positions after another look."""
        draws = self._draws
        for side in range(2):
            own = self.positions[ARM * side : ARM * (side + 1)]
            if draws.random() < 0.03:
                self._goals[side] = self._goal()
            if draws.random() < 0.02:
                self._goals[side][CLAWS] = draws.choice([0.0, MACHINE.claws.stroke_m])
            before = own.copy()
            for axis, speed_m in ((SLIDE, 0.011), (LIFT, 0.009), (CLAWS, 0.002), (SPREADER, 0.03)):
                way_m = self._goals[side][axis] - own[axis]
                own[axis] += max(-speed_m, min(speed_m, way_m))
            if before[CLAWS] < self._claws.frees_above_m <= own[CLAWS]:
                own[FREED] = now_s - draws.uniform(0.0, 0.01)
            own[STIRRED] += not np.array_equal(before[: SPREADER + 1], own[: SPREADER + 1])
            own[SPEED] = draws.choice([0.0, 0.045, 0.045, 0.09])
            own[CHAIN] += 0.01 * own[SPEED]
            own[CLAMP] = draws.uniform(0.0, 5e5) if draws.random() < 0.9 else draws.uniform(-1e5, 3e4)
            own[SLIPS] += draws.random() < 0.001
        if draws.random() < 0.02:
            self._trays_m_look = draws.choice(self._tray_speeds_m)
        if self._plant.conveyor.placed_tray is not None and draws.random() < 0.5:
            self._trays_m_look = 0.0
        self.positions[-1] += self._trays_m_look
        return self.positions

    def _goal(self) -> list[float]:
        draws = self._draws
        if draws.random() < 0.5:  # towards a regular grip
            return [draws.choice(MACHINE.columns_m[:3]), MACHINE.lift.stroke_m, MACHINE.claws.stroke_m, 0.0]
        column_m = draws.choice([*MACHINE.columns_m[:4], 0.0, 0.0])
        reach_m = MACHINE.handling.reach_m
        slide_m = max(0.0, column_m + draws.choice([0.0, 0.0, 0.004, -0.004, 0.007, -0.007, reach_m, -1.1 * reach_m]))
        rise_m = draws.choice([0.0, 0.0, 0.0, 0.008, 0.03, 0.06, 0.09, MACHINE.lift.stroke_m])
        claws_m = draws.choice([0.0, MACHINE.claws.stroke_m])
        return [slide_m, MACHINE.lift.stroke_m - rise_m, claws_m, draws.choice([0.0, 0.0, MACHINE.spreader.travel_m])]


def is_quiet(plant: Plant) -> bool:
    """Apply the limits as the kernel of the twin does."""
    trays, trays_m, quiet = plant.limits.trays[0], plant.positions[-1], True
    if trays_m != trays["followed_m"] and not trays["low_m"] < trays_m < trays["high_m"]:
        quiet = False
    for side in range(2):
        limits, own = plant.limits.quiet[side], plant.positions[ARM * side : ARM * (side + 1)]
        if own[CHAIN] >= limits["chain_below_m"] or plant.time_ms / 1000 >= limits["until_s"]:
            limits["outside"], quiet = ROW_OUTSIDE, False
        inside = bool(np.all(limits["low"] < own[:CHAIN]) and np.all(own[:CHAIN] < limits["high"]))
        if not inside or own[SLIPS] != limits["slips"] or own[CLAMP] >= limits["clamp_below_pa"]:
            limits["outside"], quiet = POSE_OUTSIDE, False
            continue
        limits["slide_m"], limits["peak_pa"] = own[SLIDE], max(limits["peak_pa"], own[CLAMP])
        if limits["down_m"] - own[LIFT] > limits["gripped_rise_m"]:
            limits["least_pa"] = min(limits["least_pa"], own[CLAMP])
    if quiet:
        trays["passed_m"] = trays_m
    return quiet


def crop(plant: Plant) -> dict[str, object]:
    """Return everything that the crop remembers."""
    found: dict[str, object] = {
        "seedlings": [seedling.location for seedling in plant.seedlings],
        "incidents": list(plant.events),
        "trays": plant.conveyor.save(),
    }
    for side, arm in plant.arms.items():
        grip, row = arm.grip, arm.row
        found[f"{side} grip"] = (grip.extracted, grip.delivered, grip.slipped, grip._closed, grip._loosened)
        found[f"{side} held"] = [(each.tray, each.column, each.along) for each in grip.held]
        found[f"{side} history"] = grip.history.save()
        found[f"{side} sweep"] = arm._sweep.save()
        found[f"{side} row"] = (row.missed_cups, list(row.recent), row.off_m, row.filled, row.lands_s, row.leaves_at_m)
    return found


def replant(plant: Plant) -> None:
    """Put every lost seedling back into its cell, so that the arms continue to meet seedlings."""
    for seedling in plant.seedlings:
        if seedling.location >= Location.LOST_PICK:
            plant.seedlings.move(seedling, Location.STANDING)


@pytest.mark.parametrize("seed", first_of(range(40)))
def test_looks_within_the_limits_change_nothing(seed: int) -> None:
    every, few = (Plant(IO_MAP, MACHINE, seed=seed, trays=3) for _ in range(2))
    motion, draws = AnyMotion(every, seed), random.Random(seed)
    few.limit()
    looks = held = 0
    for number in range(LOOKS):
        every.positions[:] = few.positions[:] = motion.step((every.time_ms + 10) / 1000)
        every.time_ms += 10
        every._apply_motion()
        few.time_ms += 10
        if not is_quiet(few):
            few.look()
            looks += 1
        if draws.random() < 0.01:
            few.adopt(few.time_ms, few.y)
            found, expected = crop(few), crop(every)
            assert [name for name in expected if expected[name] != found[name]] == [], f"look {number}"
            few.limit()
        held += any(arm.grip.held for arm in every.arms.values())
        if every.counts().in_tray < 180:
            few.adopt(few.time_ms, few.y)
            for plant in (every, few):
                replant(plant)
            few.limit()
    assert looks < 0.95 * LOOKS
    assert held + len(every.events) > 20


def test_limits_are_the_neighbouring_thresholds() -> None:
    low, high = between(0.5, [0.2, 0.4, 0.6, 0.9])
    assert 0.4 < low < 0.4 + 1e-8
    assert 0.6 - 1e-8 < high < 0.6


def test_a_value_at_a_threshold_is_outside_its_limits() -> None:
    low, high = between(0.4, [0.2, 0.4, 0.6])
    assert not low < 0.4 < high
    assert between(0.4, []) == (-np.inf, np.inf)
