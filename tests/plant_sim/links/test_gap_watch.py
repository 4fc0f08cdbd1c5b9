"""Gaps between output writes, and the seedlings lost with them.

The exported program drives the machine in simulated time through the module, as a PLC does. During a gap the PLC goes
on with the last inputs that it has received, and its outputs do not arrive.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cache

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.gap_watch import GapWatch
from plant_sim.links.io_module import IoModule, ModuleFault
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS
from tests.plant_sim.links.plc.plc_rig import ProgramOfPlc, module_of, reference

LIMIT_MS = 50
GAP_MS = 430
WORST_MS = 32_290
"""Time at which a gap of 430 ms costs most, among the scans from 32.2 s to 32.4 s: the claws are about to grip."""
HARMLESS_MS = 20_500
WATCHDOG_MS = 500


@dataclass
class Run:
    """Trial of two trays with a gap.

    Attributes:
        module: The module.
        said: Reported lines.
    """

    module: IoModule
    said: list[str]


def run(*, gap_at_ms: int | None, until_ms: int, watchdog_ms: int = WATCHDOG_MS, gap_ms: int = GAP_MS) -> Run:
    presses = reference(2, None).presses
    module, program = module_of(2, watchdog_ms=watchdog_ms), ProgramOfPlc(2)
    plant, said = module.plant, list[str]()
    watch = GapWatch(module, limit_ms=LIMIT_MS, tell=said.append)
    received = plant.x
    while plant.time_ms < until_ms:
        now_ms = plant.time_ms
        plant.box.start = any(0 <= now_ms - press_ms < 100 for press_ms in presses)
        in_gap = gap_at_ms is not None and 0 < now_ms - gap_at_ms < gap_ms
        received = received if in_gap else plant.x
        outputs = program.scan(received)
        if not in_gap:
            with contextlib.suppress(ModuleFault):
                module.write_as("192.168.3.250:502", dict(enumerate(outputs)))
        module.advance(SCAN_MS)
    watch.finish()
    return Run(module, said)


@cache
def sound() -> Run:
    """Return a run without a gap."""
    return run(gap_at_ms=None, until_ms=WORST_MS + 10_000)


def test_a_gap_that_costs_seedlings_is_told_in_one_line() -> None:
    """At the worst moment a gap of 430 ms costs 25 seedlings; without it, the plant loses at most 2 of them."""
    done = run(gap_at_ms=WORST_MS, until_ms=60_000)
    gap, losses = done.said
    assert gap == "gap of 430 ms between output writes of 192.168.3.250:502 at 32290 ms (limit 50 ms)"
    assert losses == (
        "gap of 430 ms between output writes of 192.168.3.250:502 at 32290 ms: 25 seedlings lost (P 13, D 12, T 0), "
        "2 incidents from the gap to the end of the following cycle; usual without a gap: 0.0"
    )
    timing, counts = done.module.timing, done.module.plant.counts()
    assert (timing.gaps, timing.longest_gap_ms, timing.seedlings_lost_after_gaps) == (1, 430, 25)
    assert counts.P + counts.D + counts.T >= 25
    counts = sound().module.plant.counts()
    assert counts.P + counts.D + counts.T <= 2


def test_a_gap_that_costs_nothing_is_told_without_losses() -> None:
    done = run(gap_at_ms=HARMLESS_MS, until_ms=24_000)
    assert done.said == ["gap of 430 ms between output writes of 192.168.3.250:502 at 20500 ms (limit 50 ms)"]
    assert done.module.timing.seedlings_lost_after_gaps == 0


def test_a_run_without_a_gap_is_silent() -> None:
    done = sound()
    assert done.said == []
    assert (done.module.timing.gaps, done.module.timing.longest_gap_ms) == (0, SCAN_MS)


def test_a_trip_of_the_watchdog_is_told_at_once() -> None:
    done = run(gap_at_ms=HARMLESS_MS, until_ms=21_500, watchdog_ms=100)
    (trip,) = done.said  # the module refuses the outputs, so that the gap does not end
    assert trip == ("output watchdog tripped at 20601 ms: outputs safe; last write by 192.168.3.250:502 at 20500 ms")


class Scene:
    """Module that is written by hand."""

    def __init__(self, limit_ms: int = LIMIT_MS) -> None:
        self.module = module_of(watchdog_ms=10_000)
        self.said: list[str] = []
        self.watch = GapWatch(self.module, limit_ms=limit_ms, tell=self.said.append)

    def write_after(self, for_ms: int) -> None:
        self.module.advance(for_ms)
        self.module.write_as("client", {0: False})

    def lose(self, number: int) -> None:
        """Lose a seedling and report an incident."""
        seedlings = self.module.plant.seedlings
        seedling = [one for one in seedlings if one.location.name == "STANDING"][number]
        seedlings.move(seedling, type(seedling.location).LOST_CARRY)

    def cycle(self, side: str) -> None:
        """Move an arm away from the feed position, and back."""
        for position_m in (0.1, 0.0):
            self.module.plant.arms[side].slide.place(position_m)
            for observe in self.module.observers:
                observe()


def test_the_limit_is_not_a_gap_but_a_millisecond_more_is() -> None:
    scene = Scene()
    scene.write_after(10)
    scene.write_after(LIMIT_MS)
    assert scene.said == []
    scene.write_after(LIMIT_MS + 1)
    assert scene.said == ["gap of 51 ms between output writes of client at 60 ms (limit 50 ms)"]


def test_the_window_ends_with_the_second_cycle_of_the_slower_arm() -> None:
    scene = Scene()
    scene.write_after(10)
    scene.cycle("left")
    scene.lose(0)
    scene.write_after(10)
    scene.lose(1)
    scene.write_after(60)
    for side in ("left", "left", "left", "right"):
        scene.cycle(side)
    scene.lose(2)
    assert len(scene.said) == 1
    scene.cycle("right")
    assert scene.said[1] == (
        "gap of 60 ms between output writes of client at 20 ms: 2 seedlings lost (P 0, D 2, T 0) from the gap to the "
        "end of the following cycle; usual without a gap: 5.0"
    )
    scene.lose(3)
    scene.watch.finish()
    assert len(scene.said) == 2


def test_further_gaps_belong_to_the_window_and_are_told_once_per_second() -> None:
    scene = Scene()
    scene.write_after(10)
    for gap_ms in (60, 200, 80):
        scene.write_after(gap_ms)
    scene.lose(0)
    scene.watch.finish()
    assert scene.said[0] == "gap of 60 ms between output writes of client at 10 ms (limit 50 ms)"
    assert scene.said[1:] == [
        "3 gaps of up to 200 ms between output writes of client from 10 ms: 1 seedling lost (P 0, D 1, T 0) from the "
        "gap to the end of the run; no cycle without a gap to compare with"
    ]
    assert scene.module.timing.gaps == 3


def test_a_gap_that_does_not_end_is_told_at_the_end_of_the_run() -> None:
    scene = Scene()
    scene.write_after(10)
    scene.module.advance(300)
    scene.lose(0)
    scene.watch.finish()
    assert scene.said == [
        "gap of 300 ms between output writes of client at 10 ms: 1 seedling lost (P 0, D 1, T 0) from the gap to the "
        "end of the run; no cycle without a gap to compare with"
    ]


def test_a_machine_that_stops_after_a_gap_is_told_after_20_s() -> None:
    scene = Scene()
    scene.write_after(10)
    scene.write_after(60)
    scene.lose(0)
    for _ in range(399):
        scene.write_after(50)
    scene.module.advance(49)
    assert len(scene.said) == 1
    scene.module.advance(1)
    assert "1 seedling lost (P 0, D 1, T 0) from the gap to a standstill of 20 s" in scene.said[1]


def test_nothing_is_a_gap_before_the_first_write() -> None:
    scene = Scene()
    scene.module.advance(1_000)
    scene.write_after(10)
    assert (scene.said, scene.module.timing.gaps) == ([], 0)


@pytest.mark.parametrize("limit_ms", [0, -1])
def test_a_limit_must_be_positive(limit_ms: int) -> None:
    with pytest.raises(ValueError, match="must be 1 ms or more"):
        Scene(limit_ms)


def test_a_gap_that_lasts_until_the_end_is_the_longest() -> None:
    io_map = load_io_map(DEFAULT_IO_MAP)
    module = IoModule(Plant(io_map, load_machine(), seed=1, trays=1), io_map)
    watch = GapWatch(module, limit_ms=50, tell=lambda _line: None)
    module.write_as("client", {0: False})
    module.advance(400)
    watch.finish()
    assert (module.timing.gaps, module.timing.longest_gap_ms) == (1, 400)
