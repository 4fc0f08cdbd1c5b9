"""The timeline of a run: every step named, every scan in one stretch, every throw seen."""

from __future__ import annotations

from collections import defaultdict
from functools import cache
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.program.states import State
from controller.program.tags import SIDES, STEPPED
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.timeline import (
    ARM,
    MOTIONS,
    Stretch,
    Timeline,
    TimelineRecorder,
    motion_of,
)
from plant_sim.bench.twin import SCAN_MS, Twin

TWIN = Twin()


@cache
def recorded(release_delay: int) -> tuple[Timeline, list[tuple[int, list[str]]]]:
    """Return the timeline of a tray, and the steps that were on after every scan."""
    twin = Twin(trays=1, set_points={"trays_target": 1, "release_delay": release_delay})
    recorder, steps = TimelineRecorder(), []
    twin.watch(recorder)
    twin.watch(lambda twin: steps.append((twin.now_ms, twin.active_steps())))
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=200_000)
    return recorder.timeline(), steps


def test_every_step_of_arms_and_tray_feeder_has_a_motion_and_no_motion_lacks_its_step() -> None:
    """A new step of the program makes this fail until it is named; one that is gone, until it is struck out."""
    declared = {each.name: set(each.bits) for each in TWIN.machine.program.sequences() if each.name in STEPPED}
    assert {who: set(motions) for who, motions in MOTIONS.items()} == declared


def test_a_step_waits_exactly_if_it_holds_nothing_and_takes_no_fixed_time() -> None:
    """What the critical path may pass over is what the program itself calls waiting."""
    for sequence in TWIN.machine.program.sequences():
        for step in sequence.steps if sequence.name in MOTIONS else ():
            waits = not step.hold and step.dwell is None
            assert (motion_of(sequence.name, step.title).kind == "waits") == waits, step.title


def test_motions_that_differ_have_names_that_differ() -> None:
    """Lengths are summed by motion: two of one name would be one."""
    for motions in MOTIONS.values():
        assert len({motion.name for motion in motions.values()}) == len(motions)


def test_a_step_without_a_name_is_refused() -> None:
    """One line: the sequence, the step, where to name it."""
    with pytest.raises(StudyError, match=r"left arm: step 'dance' is no known motion; name it in .*timeline\.py"):
        motion_of("left arm", "dance")


def test_the_stretches_are_the_steps_that_were_on_after_every_scan() -> None:
    """Given a whole tray, each scan lies in the stretch of the step that was on."""
    timeline, steps = recorded(6)
    for who, stretches in timeline.stretches.items():
        spans = iter(stretches)
        span: Stretch | None = None
        for at_ms, names in steps:
            on = [name.removeprefix(f"{who}: ") for name in names if name.startswith(f"{who}: ")]
            if not on:
                continue
            if span is None or at_ms >= span.to_ms:
                span = next(spans)
            assert [span.step] == on, at_ms
            assert span.from_ms <= at_ms < span.to_ms


@pytest.mark.parametrize("release_delay", [0, 6])
def test_each_arm_throws_three_rows_twelve_cups_apart(release_delay: int) -> None:
    """With no release delay, too, of which then no scan sees the step."""
    timeline, _ = recorded(release_delay)
    for side in SIDES:
        assert [throw.row for throw in timeline.throws[side]] == [1, 2, 3]
        assert timeline.releases_ms[side][1:] == tuple(throw.at_ms for throw in timeline.throws[side])
        for since_ms, until_ms in pairwise(timeline.releases_ms[side]):
            assert until_ms in timeline.cups_ms[side]
            assert len([at_ms for at_ms in timeline.cups_ms[side] if since_ms < at_ms <= until_ms]) == 12


def test_only_with_row_three_an_arm_is_in_the_centre_and_one_at_a_time() -> None:
    """Each arm is there once a tray, from setting out for row 3 until it is back beyond pick 2."""
    timeline, _ = recorded(6)
    (left,), (right,) = timeline.centre["left"], timeline.centre["right"]
    assert left[1] <= right[0] or right[1] <= left[0]
    for side, (from_ms, to_ms) in zip(SIDES, (left, right), strict=True):
        assert timeline.approaches[side][from_ms] == 3
        left_it = timeline.before(ARM[side], to_ms)
        assert left_it is not None
        assert left_it.step == "slide to feed"


def test_dwells_take_the_time_that_is_set_and_a_scan_at_most() -> None:
    """The paper's 0.5 s at feed, the clamping dwell of 0.2 s."""
    timeline, _ = recorded(6)
    for who in ARM.values():
        took: dict[str, list[int]] = defaultdict(list)
        for each in timeline.stretches[who]:
            took[motion_of(who, each.step).name].append(each.to_ms - each.from_ms)
        assert all(500 <= each <= 500 + SCAN_MS for each in took["pause at feed"])
        assert all(200 <= each <= 200 + SCAN_MS for each in took["clamp"])
        assert len(took["slide in"]) == 3


@given(
    st.lists(
        st.tuples(*(st.none() | st.integers(0, len(MOTIONS[who]) - 1) for who in ("left arm", "right arm"))),
        min_size=1,
        max_size=60,
    )
)
def test_whatever_the_steps_do_the_stretches_have_neither_gap_nor_overlap(scans: list[tuple[int | None, ...]]) -> None:
    """Given any steps scan by scan, times without a step among them, each is in its stretch and no other."""
    sequences = {each.name: each for each in TWIN.machine.program.sequences()}
    names = ("left arm", "right arm")
    states, recorder = TWIN.plc.memory.S, TimelineRecorder()
    bits = {name: [bit.number for bit in sequences[name].bits.values()] for name in names}
    for arm in TWIN.machine.tags.arms.values():
        TWIN.plc.write(arm.row_is[1], True)
    began_ms = TWIN.now_ms
    for scan in scans:
        for name, on in zip(names, scan, strict=True):
            for index, number in enumerate(bits[name]):
                states[number] = index == on
        recorder(TWIN)
        TWIN.clock.advance(SCAN_MS)
    timeline = recorder.timeline()
    for name, ons in zip(names, zip(*scans, strict=True), strict=True):
        stretches = timeline.stretches[name]
        assert all(one.to_ms <= other.from_ms for one, other in pairwise(stretches))
        titles = list(sequences[name].bits)
        for index, on in enumerate(ons):
            stretch = timeline.before(name, began_ms + (index + 1) * SCAN_MS)
            assert (stretch and stretch.step) == (None if on is None else titles[on])
