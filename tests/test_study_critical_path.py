"""The critical path: known answers on small timelines, and on runs of the twin."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.bench.study.critical_path import Round, by_device, by_motion, critical_path, rounds
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.timeline import ARM, FEEDER, MOTIONS, Stretch, Throw, Timeline, TimelineRecorder
from plant_sim.bench.twin import Twin
from plant_sim.parameters import load_machine

Steps = list[tuple[str, int]]
"""Steps with the time of their ends, ms; the first begins at 0."""


def stretches(who: str, steps: Steps) -> tuple[Stretch, ...]:
    """Return the stretches of a sequence."""
    begins = [0, *(end_ms for _, end_ms in steps)]
    return tuple(Stretch(who, step, from_ms, to_ms) for from_ms, (step, to_ms) in zip(begins, steps, strict=False))


def line(
    left: Steps,
    right: Steps | None = None,
    tray: Steps | None = None,
    *,
    left_cups_ms: tuple[int, ...] = (),
    right_in_centre: tuple[tuple[int, int], ...] = (),
    row: int = 1,
) -> Timeline:
    """Return a run in which the left arm released at 0 ms and sets out for one row only."""
    sets_out = {each.from_ms: row for each in stretches(ARM["left"], left) if each.step == "approach row"}
    return Timeline(
        stretches={
            ARM["left"]: stretches(ARM["left"], left),
            ARM["right"]: stretches(ARM["right"], right or []),
            FEEDER: stretches(FEEDER, tray or []),
        },
        centre={"left": (), "right": right_in_centre},
        cups_ms={"left": left_cups_ms, "right": ()},
        approaches={"left": sets_out, "right": {}},
        releases_ms={"left": (0,), "right": ()},
        throws={"left": (Throw("left", 3, 0),), "right": ()},
    )


def told(timeline: Timeline, until_ms: int) -> list[tuple[str, str, int]]:
    """Return the left arm's path from 0 ms: who, what, how long."""
    return [(each.who, each.motion.name, each.length_ms) for each in critical_path(timeline, "left", 0, until_ms)]


def test_an_arm_that_is_there_before_its_twelfth_cup_leaves_the_path_to_the_carousel() -> None:
    """However long it moved, the twelve cups would not have come sooner."""
    cups_ms = tuple(range(100, 1201, 100))
    timeline = line([("open claws", 300), ("lower over cups", 900), ("wait for cups", 1200)], left_cups_ms=cups_ms)
    assert told(timeline, 1200) == [("left cups", "twelve cups pass", 1200)]


def test_an_arm_that_comes_after_its_twelfth_cup_waits_for_the_next_only() -> None:
    """The carousel has a share of less than a cup; the arm's motions have the rest."""
    cups_ms = tuple(range(50, 701, 50))  # twelfth at 600, release on the fourteenth
    timeline = line([("open claws", 200), ("lower over cups", 660), ("wait for cups", 700)], left_cups_ms=cups_ms)
    assert told(timeline, 700) == [
        ("left arm", "release", 200),
        ("left arm", "lift down", 460),
        ("left cups", "next cup", 40),
    ]


def test_an_arm_kept_out_of_the_centre_hands_over_to_the_arm_that_was_in_it() -> None:
    """From the moment the other left the centre back, in the middle of its step, that arm is on the path."""
    timeline = line(
        [("converge", 100), ("wait at feed", 410), ("approach row", 700), ("lift from row", 900)],
        [("approach row", 150), ("lift from row", 300), ("slide to feed", 600)],
        right_in_centre=((0, 400),),
        row=3,
    )
    assert told(timeline, 900) == [
        ("right arm", "slide in", 150),
        ("right arm", "lift up", 150),
        ("right arm", "slide out", 100),
        ("left arm", "wait at feed", 10),
        ("left arm", "slide in", 290),
        ("left arm", "lift up", 200),
    ]


def test_for_another_row_the_centre_keeps_nobody() -> None:
    """A wait that nothing known has ended stays on the path as the wait it is."""
    timeline = line(
        [("converge", 100), ("wait at feed", 410), ("approach row", 700)],
        [("slide to feed", 600)],
        right_in_centre=((0, 400),),
        row=2,
    )
    assert told(timeline, 700) == [
        ("left arm", "converge", 100),
        ("left arm", "wait at feed", 310),
        ("left arm", "slide in", 290),
    ]


def test_a_wait_for_the_tray_hands_over_to_the_feeder_and_it_to_the_arm_that_came_last() -> None:
    """Both arms came to feed before the tray moved; the later one is what it waited for."""
    timeline = line(
        [("slide to feed", 80), ("converge", 200), ("wait at feed", 710), ("approach row", 900)],
        [("lift from row", 100), ("slide to feed", 300), ("pause at feed", 800)],
        [("wait for an empty tray", 310), ("move tray out", 500), ("settle", 700), ("wait for an empty tray", 900)],
    )
    assert told(timeline, 900) == [
        ("right arm", "lift up", 100),
        ("right arm", "slide out", 200),
        ("tray feeder", "wait for an empty tray", 10),
        ("tray feeder", "tray out", 190),
        ("tray feeder", "tray settle", 200),
        ("left arm", "wait at feed", 10),
        ("left arm", "slide in", 190),
    ]


def test_the_path_begins_where_it_is_told_to_in_the_middle_of_a_step() -> None:
    """What was before does not count."""
    timeline = line([("open claws", 300), ("converge", 500)])
    path = critical_path(timeline, "left", 120, 500)
    assert [(each.motion.name, each.from_ms, each.to_ms) for each in path] == [
        ("release", 120, 300),
        ("converge", 300, 500),
    ]


def test_a_path_that_leaves_the_record_is_refused() -> None:
    """One line with the remedy."""
    timeline = line(
        [("wait at feed", 410), ("approach row", 700)], [("slide to feed", 10)], right_in_centre=((0, 400),), row=3
    )
    with pytest.raises(StudyError, match="right arm: nothing is recorded before 400 ms; begin the path at a later"):
        critical_path(timeline, "left", 0, 700)


def steps_of(who: str) -> st.SearchStrategy[Steps]:
    """Return any steps of a sequence that fill 1 s."""
    ends = st.lists(st.integers(1, 99), max_size=8, unique=True).map(lambda found: [*sorted(found), 100])
    return ends.flatmap(
        lambda found: st.lists(st.sampled_from(sorted(MOTIONS[who])), min_size=len(found), max_size=len(found)).map(
            lambda titles: [(title, 10 * end) for title, end in zip(titles, found, strict=True)]
        )
    )


@given(
    steps_of(ARM["left"]),
    steps_of(ARM["right"]),
    steps_of(FEEDER),
    st.sets(st.integers(1, 100), max_size=20),
    st.integers(0, 100),
    st.integers(1, 3),
)
def test_any_path_has_neither_gap_nor_overlap_and_adds_up(
    left: Steps, right: Steps, tray: Steps, cups: set[int], left_centre: int, row: int
) -> None:
    """Given any timeline, whatever the waits hand over to."""
    timeline = line(left, right, tray, left_cups_ms=tuple(10 * each for each in sorted(cups)),
                    right_in_centre=((0, 10 * left_centre),), row=row)  # fmt: skip
    for side in SIDES:
        path = critical_path(timeline, side, 0, 1000)
        assert (path[0].from_ms, path[-1].to_ms) == (0, 1000)
        assert all(one.to_ms == other.from_ms for one, other in pairwise(path))
        assert all(each.length_ms > 0 for each in path)
        assert sum(by_motion(path).values()) == sum(by_device(path).values()) == 1000


@cache
def watched(
    frequency_per_min: float, throttled: str = "", share: float = 1.0, row_spacing_m: float = 0.6
) -> dict[Side, tuple[Round, ...]]:
    """Return the rounds of two trays with the throttles of a device reduced to a share."""
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
    twin.watch(recorder)
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=400_000)
    timeline = recorder.timeline()
    return {side: rounds(timeline, side) for side in SIDES}


def into_row_two(found: dict[Side, tuple[Round, ...]], side: Side) -> Round:
    """Return an arm's first round from row 1 to row 2: it waits for nobody but its cups."""
    return next(each for each in found[side] if (each.since.row, each.throw.row) == (1, 2))


@pytest.mark.parametrize("frequency_per_min", [45.0, 75.0, 90.0])
def test_on_a_run_every_round_is_its_path(frequency_per_min: float) -> None:
    """Five rounds an arm, each from throw to throw without gap or overlap."""
    for found in watched(frequency_per_min).values():
        assert [each.changes_tray for each in found] == [False, False, True, False, False]
        for each in found:
            assert (each.path[0].from_ms, each.path[-1].to_ms) == (each.since.at_ms, each.throw.at_ms)
            assert all(one.to_ms == other.from_ms for one, other in pairwise(each.path))


def test_at_45_a_minute_no_arm_is_late_and_the_carousel_is_the_whole_path() -> None:
    """The default pace leaves every row more than two seconds."""
    for found in watched(45.0).values():
        assert all(each.missed_cups == 0 and each.margin_ms > 2_000 for each in found)
        assert all(set(by_device(each.path)) == {"carousel"} for each in found)


def test_at_75_a_minute_the_late_rounds_have_waited_for_the_other_arm_and_the_tray() -> None:
    """Row 3 of the arm that goes second into the centre, and row 1 of the arm that has to wait for the tray."""
    late = [each for found in watched(75.0).values() for each in found if each.missed_cups]
    assert late
    for each in late:
        assert each.margin_ms < 0
        kept = {segment.who for segment in each.path} & {FEEDER, ARM["right" if each.throw.side == "left" else "left"]}
        assert (FEEDER in kept) == each.changes_tray
        assert kept
        assert each.throw.row in (1, 3)


@pytest.mark.parametrize(("throttled", "share"), [("slide", 0.6), ("lift", 0.45)])
@pytest.mark.parametrize("side", SIDES)
def test_throttling_a_device_lengthens_its_share_alone_and_makes_it_the_bottleneck(
    side: Side, throttled: str, share: float
) -> None:
    """Where the arms set the pace, what a slower device adds to the round is on its own account."""
    fast = {"frequency_per_min": 90.0, "row_spacing_m": 0.5}
    runs = (watched(**fast), watched(**fast, throttled=throttled, share=share))
    before, after = (into_row_two(found, side) for found in runs)
    was, is_ = by_device(before.path), by_device(after.path)
    assert next(iter(is_)) == throttled
    assert is_[throttled] > 1.4 * was[throttled]
    for device in set(was) - {throttled, "carousel"}:
        assert is_[device] == pytest.approx(was[device], abs=60), device
    took = [each.throw.at_ms - each.since.at_ms - by_device(each.path).get("carousel", 0) for each in (before, after)]
    assert took[1] - took[0] == pytest.approx(is_[throttled] - was[throttled], abs=60)
