"""Critical path of known small timelines and of runs of the twin."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.machine.parameters import load_machine
from plant_sim.study.errors import StudyError
from plant_sim.study.throughput.critical_path import Round, by_device, by_motion, critical_path, rounds
from plant_sim.study.throughput.timeline import ARM, FEEDER, MOTIONS, StepInterval, Throw, Timeline, TimelineRecorder
from plant_sim.twin.lock_step import Twin
from tests.sampling import examples, first_of

Steps = list[tuple[str, int]]
"""Steps with their end times, ms; the first starts at 0."""


def intervals(sequence: str, steps: Steps) -> tuple[StepInterval, ...]:
    """Return the intervals of a sequence."""
    begins = [0, *(end_ms for _, end_ms in steps)]
    return tuple(
        StepInterval(sequence, step, from_ms, to_ms) for from_ms, (step, to_ms) in zip(begins, steps, strict=False)
    )


def line(
    left: Steps,
    right: Steps | None = None,
    tray: Steps | None = None,
    *,
    left_cups_ms: tuple[int, ...] = (),
    right_in_centre: tuple[tuple[int, int], ...] = (),
    row: int = 1,
) -> Timeline:
    """Return a timeline in which the left arm has released a row at 0 ms and approaches only one row."""
    sets_out = {each.from_ms: row for each in intervals(ARM["left"], left) if each.step == "approach row"}
    return Timeline(
        intervals={
            ARM["left"]: intervals(ARM["left"], left),
            ARM["right"]: intervals(ARM["right"], right or []),
            FEEDER: intervals(FEEDER, tray or []),
        },
        centre={"left": (), "right": right_in_centre},
        cups_ms={"left": left_cups_ms, "right": ()},
        approaches={"left": sets_out, "right": {}},
        releases_ms={"left": (0,), "right": ()},
        throws={"left": (Throw("left", 3, 0),), "right": ()},
    )


def left_path(timeline: Timeline, until_ms: int) -> list[tuple[str, str, int]]:
    """Return the critical path of the left arm from 0 ms: sequence, motion and duration."""
    return [(each.sequence, each.motion.name, each.length_ms) for each in critical_path(timeline, "left", 0, until_ms)]


def test_the_path_of_an_early_arm_is_the_carousel() -> None:
    """The path consists only of the time for twelve cups to pass, which a faster arm would not shorten."""
    cups_ms = tuple(range(100, 1201, 100))
    timeline = line([("open claws", 300), ("lower over cups", 900), ("wait for cups", 1200)], left_cups_ms=cups_ms)
    assert left_path(timeline, 1200) == [("left cups", "twelve cups pass", 1200)]


def test_a_late_arm_waits_for_the_next_cup_only() -> None:
    """The carousel accounts for less than one cup interval and the motions of the arm for the rest."""
    cups_ms = tuple(range(50, 701, 50))  # twelfth at 600, release on the fourteenth
    timeline = line([("open claws", 200), ("lower over cups", 660), ("wait for cups", 700)], left_cups_ms=cups_ms)
    assert left_path(timeline, 700) == [
        ("left arm", "release", 200),
        ("left arm", "lift down", 460),
        ("left cups", "next cup", 40),
    ]


def test_a_wait_for_the_centre_continues_with_the_other_arm() -> None:
    """The other arm is on the path up to the time it leaves the centre, in the middle of its step."""
    timeline = line(
        [("converge", 100), ("wait at feed", 410), ("approach row", 700), ("lift from row", 900)],
        [("approach row", 150), ("lift from row", 300), ("slide to feed", 600)],
        right_in_centre=((0, 400),),
        row=3,
    )
    assert left_path(timeline, 900) == [
        ("right arm", "slide in", 150),
        ("right arm", "lift up", 150),
        ("right arm", "slide out", 100),
        ("left arm", "wait at feed", 10),
        ("left arm", "slide in", 290),
        ("left arm", "lift up", 200),
    ]


def test_the_centre_blocks_row_three_only() -> None:
    """A wait before row 2 is attributed to the waiting arm, even if the other arm is in the centre."""
    timeline = line(
        [("converge", 100), ("wait at feed", 410), ("approach row", 700)],
        [("slide to feed", 600)],
        right_in_centre=((0, 400),),
        row=2,
    )
    assert left_path(timeline, 700) == [
        ("left arm", "converge", 100),
        ("left arm", "wait at feed", 310),
        ("left arm", "slide in", 290),
    ]


def test_a_wait_for_the_tray_continues_with_the_feeder_and_the_later_arm() -> None:
    """Both arms reached feed before the tray moved; the feeder waited for the later one."""
    timeline = line(
        [("slide to feed", 80), ("converge", 200), ("wait at feed", 710), ("approach row", 900)],
        [("lift from row", 100), ("slide to feed", 300), ("pause at feed", 800)],
        [("wait for an empty tray", 310), ("move tray out", 500), ("settle", 700), ("wait for an empty tray", 900)],
    )
    assert left_path(timeline, 900) == [
        ("right arm", "lift up", 100),
        ("right arm", "slide out", 200),
        ("tray feeder", "wait for an empty tray", 10),
        ("tray feeder", "tray out", 190),
        ("tray feeder", "tray settle", 200),
        ("left arm", "wait at feed", 10),
        ("left arm", "slide in", 190),
    ]


def test_the_path_can_start_in_the_middle_of_a_step() -> None:
    """The part of the step before the start of the path is not included."""
    timeline = line([("open claws", 300), ("converge", 500)])
    path = critical_path(timeline, "left", 120, 500)
    assert [(each.motion.name, each.from_ms, each.to_ms) for each in path] == [
        ("release", 120, 300),
        ("converge", 300, 500),
    ]


def test_a_path_outside_the_recording_is_rejected() -> None:
    """The error is one line with the remedy."""
    timeline = line(
        [("wait at feed", 410), ("approach row", 700)], [("slide to feed", 10)], right_in_centre=((0, 400),), row=3
    )
    with pytest.raises(StudyError, match="right arm: no record before 400 ms; start the path at a later"):
        critical_path(timeline, "left", 0, 700)


def steps_of(sequence: str) -> st.SearchStrategy[Steps]:
    """Return a strategy for the steps of a sequence, with a total duration of 1 s."""
    ends = st.lists(st.integers(1, 99), max_size=8, unique=True).map(lambda times: [*sorted(times), 100])
    return ends.flatmap(
        lambda times: st.lists(
            st.sampled_from(sorted(MOTIONS[sequence])), min_size=len(times), max_size=len(times)
        ).map(lambda titles: [(title, 10 * end) for title, end in zip(titles, times, strict=True)])
    )


@examples(40, nightly=100)
@given(
    steps_of(ARM["left"]),
    steps_of(ARM["right"]),
    steps_of(FEEDER),
    st.sets(st.integers(1, 100), max_size=20),
    st.integers(0, 100),
    st.integers(1, 3),
)
def test_any_path_is_contiguous_and_complete(
    left: Steps, right: Steps, tray: Steps, cups: set[int], left_centre: int, row: int
) -> None:
    """For any timeline and any cause of the waits, the segments cover the time of the path without gap or overlap."""
    timeline = line(
        left,
        right,
        tray,
        left_cups_ms=tuple(10 * each for each in sorted(cups)),
        right_in_centre=((0, 10 * left_centre),),
        row=row,
    )
    for side in SIDES:
        path = critical_path(timeline, side, 0, 1000)
        assert (path[0].from_ms, path[-1].to_ms) == (0, 1000)
        assert all(one.to_ms == other.from_ms for one, other in pairwise(path))
        assert all(each.length_ms > 0 for each in path)
        assert sum(by_motion(path).values()) == sum(by_device(path).values()) == 1000


@cache
def observed_rounds(
    frequency_per_min: float, throttled: str = "", share: float = 1.0, row_spacing_m: float = 0.6
) -> dict[Side, tuple[Round, ...]]:
    """Return the rounds of a run with two trays and with the throttles of a device reduced to a fraction."""
    machine = load_machine()
    names = {
        "slide": ("slide.throttle_conductance_m3_s_pa",),
        "lift": ("lift.extend_conductance_m3_s_pa", "lift.retract_conductance_m3_s_pa"),
    }.get(throttled, ())
    now = {name: getattr(getattr(machine, name.partition(".")[0]), name.partition(".")[2]) for name in names}
    machine = machine.with_values(
        {name: share * value for name, value in now.items()}
        | {"cups.planting_frequency_per_min": frequency_per_min, "layout.row_spacing_m": row_spacing_m}
    )
    twin, recorder = Twin(trays=2, parameters=machine, set_points={"trays_target": 2}), TimelineRecorder()
    recorder.attach(twin)
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=400_000)
    timeline = recorder.timeline()
    return {side: rounds(timeline, side) for side in SIDES}


def round_to_row_two(all_rounds: dict[Side, tuple[Round, ...]], side: Side) -> Round:
    """Return the first round of an arm from row 1 to row 2, which waits for cups only."""
    return next(each for each in all_rounds[side] if (each.since.row, each.throw.row) == (1, 2))


@pytest.mark.parametrize("frequency_per_min", first_of([90.0, 45.0, 75.0]))
def test_every_round_of_a_run_equals_its_path(frequency_per_min: float) -> None:
    """Each arm has five rounds; each path extends from throw to throw without gap or overlap."""
    for arm_rounds in observed_rounds(frequency_per_min).values():
        assert [each.changes_tray for each in arm_rounds] == [False, False, True, False, False]
        for each in arm_rounds:
            assert (each.path[0].from_ms, each.path[-1].to_ms) == (each.since.at_ms, each.throw.at_ms)
            assert all(one.to_ms == other.from_ms for one, other in pairwise(each.path))


def test_at_45_per_minute_the_carousel_is_the_complete_path() -> None:
    """The default pace leaves a margin of more than two seconds for every row."""
    for arm_rounds in observed_rounds(45.0).values():
        assert all(each.missed_cups == 0 and each.margin_ms > 2_000 for each in arm_rounds)
        assert all(set(by_device(each.path)) == {"carousel"} for each in arm_rounds)


def test_at_75_per_minute_late_rounds_waited_for_the_other_arm_and_the_tray() -> None:
    """Late rounds with row 3 waited for the other arm to leave the centre, and those with row 1 for the tray."""
    late = [each for arm in observed_rounds(75.0).values() for each in arm if each.missed_cups]
    assert late
    for each in late:
        assert each.margin_ms < 0
        others = {segment.sequence for segment in each.path} & {
            FEEDER,
            ARM["right" if each.throw.side == "left" else "left"],
        }
        assert (FEEDER in others) == each.changes_tray
        assert others
        assert each.throw.row in (1, 3)


@pytest.mark.parametrize(("throttled", "share"), [("slide", 0.6), ("lift", 0.45)])
@pytest.mark.parametrize("side", first_of(SIDES))
def test_throttling_a_device_lengthens_only_its_share_of_the_path(side: Side, throttled: str, share: float) -> None:
    """If the arms set the pace, a slower device lengthens the round by its additional time only."""
    fast = {"frequency_per_min": 90.0, "row_spacing_m": 0.5}
    runs = (observed_rounds(**fast), observed_rounds(**fast, throttled=throttled, share=share))
    before, after = (round_to_row_two(run, side) for run in runs)
    was, is_ = by_device(before.path), by_device(after.path)
    assert next(iter(is_)) == throttled
    assert is_[throttled] > 1.4 * was[throttled]
    for device in set(was) - {throttled, "carousel"}:
        assert is_[device] == pytest.approx(was[device], abs=60), device
    took = [each.throw.at_ms - each.since.at_ms - by_device(each.path).get("carousel", 0) for each in (before, after)]
    assert took[1] - took[0] == pytest.approx(is_[throttled] - was[throttled], abs=60)
