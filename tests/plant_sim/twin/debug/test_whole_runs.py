"""Whole trials and random stories, recorded and returned to: equal to a second run, stored scan by scan without it."""

from __future__ import annotations

import random
from collections.abc import Callable
from hashlib import blake2b
from typing import Any

import pytest

from plant_sim.faults import parse_fault
from plant_sim.stories.drawn import play
from plant_sim.stories.drawn.action import RandomStory
from plant_sim.stories.drawn.draw import StoryDraw
from plant_sim.stories.drawn.harm import HarmWatch
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.trial import run_trial
from tests.plant_sim.stories.drawn.story_rig import menu, player

SEEKS = 120


def digest(twin: Twin) -> bytes:
    """Return a digest of every device of the program and every value of the plant."""
    plant = twin.plant
    memory: bytes = twin.runtime.plc.execution.save()
    rest = repr((plant.box.save(), plant.counts(), twin.runtime.released, plant.time_ms, twin.now_ms))
    return blake2b(b"".join((memory, plant.state.tobytes(), plant.params.tobytes(), rest.encode()))).digest()


class ScanWitness:
    """Recorder that ends each run after one scan, and stores the state after it."""

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self.digests = [digest(twin)]
        self._begun_ms = 0
        twin.recorder = self

    def begin(self, until_ms: int) -> int:
        self._begun_ms = self.twin.now_ms
        return min(until_ms, self._begun_ms + SCAN_MS)

    def end(self) -> None:
        if self.twin.now_ms > self._begun_ms:
            self.digests.append(digest(self.twin))
            self._begun_ms = self.twin.now_ms

    def watch(self, call: Callable[[], None]) -> None:
        call()

    def switch_off(self, off_ms: int) -> None:
        """Store nothing."""

    def switch_on(self) -> None:
        """Store nothing."""


def compare(recorder: TwinRecorder, witness: ScanWitness) -> None:
    line = recorder.close()
    assert line.last + 1 == len(witness.digests)
    chance = random.Random(1)
    twin = recorder.twin
    for scan in [line.last, *(chance.randint(line.first, line.last) for _ in range(SEEKS))]:
        line.seek(scan)
        assert digest(twin) == witness.digests[scan], scan


TRIALS: tuple[dict[str, Any], ...] = (
    {"seed": 3, "trays": 1, "faults": [parse_fault("stuck_off:left.lift_up@30s..33s")]},
    {"seed": 1},
    {
        "seed": 5,
        "faults": [parse_fault("jammed:right.lift@40s..46s"), parse_fault("low_supply:supply=0.3MPa@60s..70s")],
    },
    {"seed": 8, "seedlings": 100, "faults": [parse_fault("leak:left.slide.plus=2e-9")]},
)


@pytest.mark.nightly
@pytest.mark.parametrize("settings", TRIALS)
def test_a_recorded_trial_is_that_of_the_report_and_can_be_returned_to(settings: dict[str, Any]) -> None:
    found: list[Any] = []
    reports = [run_trial(**settings, prepare=attached(kind, found)) for kind in (TwinRecorder, ScanWitness)]
    plain = run_trial(**settings)
    assert [{**report.record(), "wall_s": 0} for report in reports] == [{**plain.record(), "wall_s": 0}] * 2
    compare(*found)


def attached(kind: type[Any], found: list[Any]) -> Callable[[Twin], None]:
    return lambda twin: found.append(kind(twin))


STORIES = [StoryDraw(menu(), f"recorded {number}").story() for number in range(12)]


@pytest.mark.nightly
@pytest.mark.parametrize("story", STORIES, ids=lambda story: str(story.seed))
def test_a_random_story_can_be_returned_to(story: RandomStory, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[Any] = []
    for kind in (TwinRecorder, ScanWitness):
        monkeypatch.setattr(play, "HarmWatch", attaching(HarmWatch, kind, found))
        player().play(story)
        monkeypatch.undo()
    compare(*found)


def attaching(watch: Any, kind: type[Any], found: list[Any]) -> Callable[..., Any]:
    """Return a factory that attaches a recorder when the play begins, after the seedlings have been prepared."""

    def make(twin: Twin, *arguments: Any) -> Any:
        found.append(kind(twin))
        return watch(twin, *arguments)

    return make
