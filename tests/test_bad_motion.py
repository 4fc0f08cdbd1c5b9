"""What bad motion of the real machine does to seedlings: the failures that it must cause grow, and no others.

Whole trials of a tray on the twin. The same seeds undisturbed have the very same seedlings, so that what differs is
the motion alone and chance decides nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from statistics import fmean
from typing import NamedTuple

import pytest

from controller.program.tags import SIDES
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.nominal import MotionWatch, RowMotion
from plant_sim.bench.trial import run_trial
from plant_sim.bench.twin import Twin
from plant_sim.faults import Fault
from plant_sim.parameters import load_machine

SEEDS = (1, 2, 3)
SEEDLINGS = 72 * len(SEEDS)
STANDSTILL_MS = 120_000


class Pooled(NamedTuple):
    """Trials with all seeds together.

    Attributes:
        pick: Lost while picking.
        carry: Lost while carrying.
        throw: Lost while throwing.
        rows: What every row that was thrown felt.
    """

    pick: int
    carry: int
    throw: int
    rows: tuple[RowMotion, ...]

    def mean(self, name: str) -> float:
        """Return the mean size of something that the rows felt."""
        return fmean(abs(getattr(row, name)) for row in self.rows)


@dataclass
class Tractor:
    """Monitor that stops the tractor for a time whenever both arms wait loaded over their cups."""

    stops: bool
    _until_ms: int = 0
    _stood_with: set[int] = field(default_factory=set)

    def __call__(self, twin: Twin) -> None:
        """Stop it, or let it go on."""
        cycles = len(twin.cycles())
        if twin.now_ms >= self._until_ms:
            twin.plant.planting_frequency_per_min = twin.parameters.cups.planting_frequency_per_min
        is_loaded = all(twin.plant.arms[side].grip.held and twin.in_step(f"{side} arm", "wait for cups")
                        for side in SIDES)  # fmt: skip
        if self.stops and is_loaded and cycles not in self._stood_with:
            self._stood_with.add(cycles)
            self._until_ms = twin.now_ms + STANDSTILL_MS
            twin.plant.planting_frequency_per_min = 0.0


def trial(
    seed: int,
    values: Mapping[str, float] | None = None,
    *,
    release_delay: int | None = None,
    faults: tuple[Fault, ...] = (),
    stops: bool = False,
) -> tuple[TrialReport, list[RowMotion]]:
    """Run a tray on a machine that differs in some values, and watch what the rows feel."""
    watch, tractor = MotionWatch(), Tractor(stops)

    def see(twin: Twin) -> None:
        watch(twin)
        tractor(twin)

    report = run_trial(
        seed=seed, trays=1, parameters=load_machine().with_values(dict(values or {})), faults=faults, progress=see,
        set_points={} if release_delay is None else {"release_delay": release_delay},
    )  # fmt: skip
    return report, watch.rows


def pooled(
    values: Mapping[str, float] | None = None,
    *,
    release_delay: int | None = None,
    faults: tuple[Fault, ...] = (),
    stops: bool = False,
) -> Pooled:
    """Run all seeds; every trial completes without alarm, and every seedling is accounted for."""
    pick = carry = throw = 0
    rows: list[RowMotion] = []
    for seed in SEEDS:
        report, felt = trial(seed, values, release_delay=release_delay, faults=faults, stops=stops)
        assert report.completed, report.reason
        assert report.accounted
        assert report.alarms == []
        pick, carry, throw = pick + report.P, carry + report.D, throw + report.T
        rows += felt
    return Pooled(pick, carry, throw, tuple(rows))


@cache
def undisturbed() -> Pooled:
    """Return the machine as it is."""
    return pooled()


def test_undisturbed_the_machine_is_that_of_the_papers_optimum() -> None:
    """216 seedlings lose 5 %, 3 standard deviations either way; six rows of each tray are watched."""
    found = undisturbed()
    assert found.pick + found.carry + found.throw == pytest.approx(0.051 * SEEDLINGS, abs=9.7)
    assert len(found.rows) == 6 * len(SEEDS)


@pytest.mark.parametrize(
    ("brake_n", "band_m", "more_mm", "more"), [(40.0, 0.005, 1.0, 1), (20.0, 0.0065, 2.0, 20), (10.0, 0.0075, 3.0, 100)]
)
def test_a_slide_that_runs_on_costs_pick_failures_alone(
    brake_n: float, band_m: float, more_mm: float, more: int
) -> None:
    """Given a worn brake, and switches long enough to hide it, the claws close beside the stems.

    What is never picked can neither break nor fall beside: D and T do not grow.
    """
    good, bad = undisturbed(), pooled({"slide.brake_n": brake_n, "slide.switch_band_m": band_m})
    assert bad.pick >= good.pick + more
    assert bad.carry <= good.carry
    assert bad.throw <= good.throw
    if bad.rows:  # a row of which no stem was gripped is never thrown
        assert bad.mean("across_m") > good.mean("across_m") + 1e-3 * more_mm


@pytest.mark.timeout(240)
def test_an_overrun_that_a_switch_sees_costs_nothing_but_time() -> None:
    """Given no brake at all, the arm has left the band of its switch before it clamps: alarm, Held, no stem touched."""
    report, _ = trial(1, {"slide.brake_n": 0.0})
    assert not report.completed
    assert set(report.alarms) == {f"{side} slide went off the pick position after arriving" for side in SIDES}
    assert report.P == report.D == report.T == 0


@pytest.mark.timeout(240)
def test_so_does_a_check_valve_that_leaks() -> None:
    """Given a check valve that lets the trapped air out, the slide is not where it should be; nothing is gripped."""
    leaks = tuple(Fault("leaking_check_valve", f"{side}.slide.minus", size=5e-10) for side in SIDES)
    report, _ = trial(1, faults=leaks)
    assert not report.completed
    assert {text.split(" slide")[0] for text in report.alarms} == set(SIDES)
    assert report.P == report.D == report.T == 0


def test_a_late_release_costs_throw_failures_alone_and_the_more_the_later() -> None:
    """Given 200, 300, 400 ms where 60 are right: at 45 mm/s the cups are 6, 11, 15 mm on; their mouth spares 16."""
    late = [undisturbed(), *(pooled(release_delay=delay) for delay in (20, 30, 40))]
    assert all(found.pick == late[0].pick and found.carry == late[0].carry for found in late)
    assert all(later.throw > sooner.throw for sooner, later in pairwise(late))
    assert late[-1].throw > 0.3 * SEEDLINGS
    offsets = [found.mean("throw_along_m") for found in late]
    assert [offset - offsets[0] for offset in offsets[2:]] == pytest.approx([0.0108, 0.0153], abs=0.0015)


@pytest.mark.parametrize("how", ["set", "fault"])
def test_low_claw_pressure_leaves_plugs_in_their_cells(how: str) -> None:
    """Given 0.25 and 0.15 MPa, set so or by a regulator that has slipped: more P each time.

    Stems are spared, so D does not grow; of those that are picked, a loose grip throws more beside, as the paper says.
    """

    def at(mpa: float) -> Pooled:
        if how == "set":
            return pooled({"crop.claw_pressure_mpa": mpa})
        return pooled(faults=(Fault("low_claw_supply", "supply", size=1e6 * mpa),))

    good, low, lowest = undisturbed(), at(0.25), at(0.15)
    assert good.pick + 5 <= low.pick < lowest.pick - 20
    assert good.carry >= low.carry >= lowest.carry
    assert lowest.throw / (SEEDLINGS - lowest.pick) > good.throw / (SEEDLINGS - good.pick)
    assert low.mean("force_n") == pytest.approx(0.78 * 0.25 / 0.040, rel=0.05)


def test_high_claw_pressure_cuts_stems() -> None:
    """Given 0.6 MPa: stems are cut in picking and break in carrying; no plug stays."""
    good, high = undisturbed(), pooled({"crop.claw_pressure_mpa": 0.60})
    assert high.pick > good.pick + 5
    assert high.carry / (SEEDLINGS - high.pick) > good.carry / (SEEDLINGS - good.pick)


@pytest.mark.timeout(240)
def test_stems_that_are_held_long_break() -> None:
    """Given a tractor that stands for two minutes with every load: more D; picking and throwing are as ever."""
    good, long = undisturbed(), pooled(stops=True)
    assert long.mean("held_s") > good.mean("held_s") + 0.8 * STANDSTILL_MS / 1000
    assert long.carry > 1.5 * good.carry
    assert long.pick == good.pick
    assert long.throw <= good.throw


def test_a_higher_drop_costs_throw_failures_alone() -> None:
    """Given 150 and 300 mm instead of 80, a plug drifts 1.4 and 1.9 times as far."""
    drops = [undisturbed(), *(pooled({"handling.drop_height_m": height}) for height in (0.15, 0.30))]
    assert all(found.pick == drops[0].pick and found.carry == drops[0].carry for found in drops)
    assert all(higher.throw > lower.throw for lower, higher in pairwise(drops))
    assert drops[-1].throw > 0.15 * SEEDLINGS
