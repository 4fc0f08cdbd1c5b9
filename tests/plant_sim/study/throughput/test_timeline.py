"""Timeline of a run: motions of all steps, intervals without gaps, and all throws."""

from __future__ import annotations

from collections import defaultdict
from functools import cache
from itertools import pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.program.states import State
from controller.program.tags import SIDES, STEPPED
from plant_sim.study.errors import StudyError
from plant_sim.study.throughput.timeline import ARM, MOTIONS, StepInterval, Timeline, TimelineRecorder, motion_of
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.sampling import first_of

TWIN = Twin()


@cache
def recorded(release_lead: int, *, every_scan: bool = False) -> tuple[Timeline, list[tuple[int, list[str]]]]:
    """Return the timeline of a tray and, if every scan is observed, the active steps after it."""
    twin = Twin(trays=1, set_points={"trays_target": 1, "release_lead": release_lead})
    recorder = TimelineRecorder()
    steps: list[tuple[int, list[str]]] = []
    recorder.attach(twin)
    if every_scan:
        twin.watch(lambda twin: steps.append((twin.now_ms, twin.active_steps())))
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=200_000)
    return recorder.timeline(), steps


@pytest.mark.parametrize("for_ms", first_of([35_000, 60_000]))
def test_a_timeline_in_machine_code_equals_that_of_every_scan(for_ms: int) -> None:
    """Calls at changes only, and calls after every scan, record the same timeline."""
    twins = [Twin(trays=1, set_points={"trays_target": 1}) for _ in range(2)]
    recorders = [TimelineRecorder() for _ in twins]
    recorders[0].attach(twins[0])
    twins[1].watch(recorders[1])
    for twin in twins:
        twin.home()
        twin.start()
        twin.run_for(for_ms)
    assert recorders[0].timeline() == recorders[1].timeline()


def test_every_step_has_a_motion_and_every_motion_has_a_step() -> None:
    """A new step must be added to the motions of the arms or the tray feeder, and a removed step deleted from them."""
    declared = {each.name: set(each.bits) for each in TWIN.machine.program.sequences() if each.name in STEPPED}
    assert {sequence: set(motions) for sequence, motions in MOTIONS.items()} == declared


def test_a_step_is_a_wait_if_it_has_no_output_and_no_fixed_time() -> None:
    """The critical path skips exactly the waiting steps of the program."""
    for sequence in TWIN.machine.program.sequences():
        for step in sequence.steps if sequence.name in MOTIONS else ():
            waits = not step.hold and step.dwell is None
            assert (motion_of(sequence.name, step.title).kind == "waits") == waits, step.title


def test_different_motions_have_different_names() -> None:
    """Durations are summed by motion name, so motions with equal names would be merged."""
    for motions in MOTIONS.values():
        assert len({motion.name for motion in motions.values()}) == len(motions)


def test_an_unknown_step_is_rejected() -> None:
    """The error is one line with sequence, step and the file to edit."""
    with pytest.raises(StudyError, match=r"left arm: unknown step 'dance'; add it to .*timeline\.py"):
        motion_of("left arm", "dance")


def test_the_intervals_match_the_active_steps_after_every_scan() -> None:
    """For a complete tray, every scan is in the interval of its active step."""
    timeline, steps = recorded(25, every_scan=True)
    assert len(steps) > 6_000
    for sequence, intervals in timeline.intervals.items():
        spans = iter(intervals)
        span: StepInterval | None = None
        for at_ms, names in steps:
            on = [name.removeprefix(f"{sequence}: ") for name in names if name.startswith(f"{sequence}: ")]
            if not on:
                continue
            if span is None or at_ms >= span.to_ms:
                span = next(spans)
            assert [span.step] == on, at_ms
            assert span.from_ms <= at_ms < span.to_ms


@pytest.mark.parametrize("release_lead", [25, 53])
def test_each_arm_throws_three_rows_twelve_cups_apart(release_lead: int) -> None:
    """Throws are twelve cups apart even with a release delay of zero, whose step is never active after a scan."""
    timeline, _ = recorded(release_lead)
    for side in SIDES:
        assert [throw.row for throw in timeline.throws[side]] == [1, 2, 3]
        assert timeline.releases_ms[side][1:] == tuple(throw.at_ms for throw in timeline.throws[side])
        for since_ms, until_ms in pairwise(timeline.releases_ms[side]):
            assert until_ms in timeline.cups_ms[side]
            assert len([at_ms for at_ms in timeline.cups_ms[side] if since_ms < at_ms <= until_ms]) == 12


def test_only_one_arm_at_a_time_is_in_the_centre_except_at_row_two() -> None:
    """An arm is in the centre from its approach to row 2 until it is there, and to row 3 until it is back at pick 2."""
    timeline, _ = recorded(25)
    occupied = {
        side: {timeline.approaches[side][from_ms]: (from_ms, to_ms) for from_ms, to_ms in timeline.centre[side]}
        for side in SIDES
    }
    for row, end in ((2, "settle at row"), (3, "slide to feed")):
        for side in SIDES:
            left_it = timeline.before(ARM[side], occupied[side][row][1])
            assert left_it is not None
            assert left_it.step == end
    for (one, left), (other, right) in product(occupied["left"].items(), occupied["right"].items()):
        assert one == other == 2 or left[1] <= right[0] or right[1] <= left[0]


def test_dwells_last_their_set_point_plus_at_most_one_scan() -> None:
    """The dwells are 0.5 s at feed ([P]) and 0.2 s for clamping."""
    timeline, _ = recorded(25)
    for sequence in ARM.values():
        took: dict[str, list[int]] = defaultdict(list)
        for each in timeline.intervals[sequence]:
            took[motion_of(sequence, each.step).name].append(each.to_ms - each.from_ms)
        assert all(500 <= each <= 500 + SCAN_MS for each in took["pause at feed"])
        assert all(200 <= each <= 200 + SCAN_MS for each in took["clamp"])
        assert len(took["slide in"]) == 3


@given(
    st.lists(
        st.tuples(*(st.none() | st.integers(0, len(MOTIONS[sequence]) - 1) for sequence in ("left arm", "right arm"))),
        min_size=1,
        max_size=60,
    )
)
def test_intervals_of_any_steps_have_no_gap_and_no_overlap(scans: list[tuple[int | None, ...]]) -> None:
    """For any active steps in each scan, the intervals match these steps and do not overlap."""
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
        intervals = timeline.intervals[name]
        assert all(one.to_ms <= other.from_ms for one, other in pairwise(intervals))
        titles = list(sequences[name].bits)
        for index, on in enumerate(ons):
            interval = timeline.before(name, began_ms + (index + 1) * SCAN_MS)
            assert (interval and interval.step) == (None if on is None else titles[on])
