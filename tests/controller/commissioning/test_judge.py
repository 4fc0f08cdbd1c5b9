"""Verdicts on wires, directions of axes and the lease of a held key, without a field."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.commissioning.axes import AXES, AXIS_OF, GROUP_OF
from controller.commissioning.hold import LEASE_MS, LONGEST_MS, HoldToRun
from controller.commissioning.judge import WireResult, judge_input, judge_output
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map

IO_MAP = load_io_map(DEFAULT_IO_MAP)
REST = {point.tag: point.tag in ("left.lift_down", "left.slide_at_feed") for point in IO_MAP.inputs}
SLIDE = GROUP_OF["left.slide_at_feed"]


def test_axes_name_wired_points() -> None:
    for axis in AXES:
        assert all(tag in IO_MAP for tag in (*axis.sensors, axis.forward, axis.backward))
    assert len(AXIS_OF) == 2 * len(AXES)


@pytest.mark.parametrize(
    ("at", "changes", "expected"),
    [
        ("feed", [], None),
        ("feed", [("feed", False)], 1),
        ("pick_3", [("pick_3", False)], -1),
        ("pick_1", [("pick_1", False)], 0),
        ("pick_1", [("pick_1", False), ("pick_2", True)], 1),
        ("pick_2", [("pick_2", False), ("pick_1", True)], -1),
        ("", [("feed", True)], -1),
        ("", [("pick_3", True)], 1),
        ("", [("pick_2", True)], 0),
        ("", [("pick_2", True), ("pick_2", False), ("pick_1", True)], -1),
    ],
)
def test_direction_of_a_slide(at: str, changes: list[tuple[str, bool]], expected: int | None) -> None:
    before = {f"left.slide_at_{at}": True}
    assert SLIDE.direction(before, [(f"left.slide_at_{tag}", active) for tag, active in changes]) == expected


@given(st.sampled_from(IO_MAP.inputs), st.sampled_from(IO_MAP.inputs), st.booleans())
def test_an_input_is_correct_only_if_it_alone_becomes_active(point, other, active) -> None:  # type: ignore[no-untyped-def]
    operated = REST | {other.tag: active}
    released = REST | {point.tag: False}
    found = judge_input(point, released, operated)
    alone = other.tag == point.tag or released[other.tag] == active
    became_active = not released[point.tag] and operated[point.tag]
    left = other.tag in getattr(GROUP_OF.get(point.tag), "sensors", ()) and not active
    assert (found.result is WireResult.OK) == (became_active and (alone or left))


def test_an_axis_moved_by_hand_may_leave_its_other_sensor() -> None:
    pick = IO_MAP["left.slide_at_pick_1"]
    moved = REST | {"left.slide_at_feed": False, pick.tag: True}
    assert judge_input(pick, REST, moved).result is WireResult.OK
    assert judge_input(pick, REST, moved | {"start": True}).others == ("start",)


def test_an_output_that_moves_two_axes_is_bridged() -> None:
    changes = [("left.lift_down", False), ("left.slide_at_feed", False)]
    found = judge_output("left.lift_retract", REST, changes)
    assert found is not None
    assert (found.result, found.others) == (WireResult.BRIDGED, ("left.slide_inward",))


def test_a_held_key_is_limited_and_must_be_released() -> None:
    held = HoldToRun()
    on = []
    for now_ms in range(0, 2 * LONGEST_MS, 100):
        held.press(now_ms)
        on.append(held.is_on(now_ms))
    assert on[0] is False
    assert sum(on) * 100 == LONGEST_MS
    later_ms = 2 * LONGEST_MS + LEASE_MS
    held.press(later_ms)
    held.press(later_ms + 50)
    assert held.is_on(later_ms + 50)


def test_two_presses_further_apart_than_the_lease_have_no_effect() -> None:
    held = HoldToRun()
    for now_ms in range(0, 10_000, LEASE_MS):
        held.press(now_ms)
        assert not held.is_on(now_ms)
