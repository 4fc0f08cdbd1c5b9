"""Times of the program against the travel times of the machine: at a start, in the proof, and in the twin."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from controller.cli.machine import start_values
from controller.common.errors import InputError
from controller.core.expr import Timer, Word
from controller.core.program import Program
from controller.core.rungs import OnDelay, Rung
from controller.core.sequence import Sequence
from controller.program.requirements.proof import specification
from controller.program.requirements.travel_times import DELIVERED, TravelTimes, misfits
from controller.program.tags import SIDES, ArmTags, Side
from plant_sim.twin.commissioning import (
    MisfitError,
    check_fit,
    constants_file,
    default_parameters,
    set_points_of,
    travel_times_of,
)
from plant_sim.twin.lock_step import Twin
from tests.controller.program.interlock_scene import MACHINE, TAGS

CHECK = "times fit the machine"
DEFAULT = dict(MACHINE.program.set_points)


@dataclass(frozen=True)
class Believed:
    """Time that the program believes.

    Attributes:
        timer: Function that returns its timer.
        least_ms: Smallest permitted preset for the delivered machine, ms.
        most_ms: Largest permitted preset, ms; None = limited only by the time limits of the steps.
    """

    timer: Callable[[ArmTags], Timer]
    least_ms: int
    most_ms: int | None


BELIEVED = {
    "lift_least": Believed(lambda a: a.t_lift_way, 110, 320),
    "belt_least": Believed(lambda a: a.t_belt_way, 300, 890),
    "slide_least": Believed(lambda a: a.t_slide_way, 410, 1_200),
    "hop_least": Believed(lambda a: a.t_slide_hop, 70, 200),
    "lift_whole": Believed(lambda a: a.t_pressed["lift"], 750, None),
    "belt_whole": Believed(lambda a: a.t_pressed["belt"], 940, None),
    "slide_whole": Believed(lambda a: a.t_pressed["slide"], 2_530, None),
    "clamp": Believed(lambda a: a.t_closing, 130, None),
    "release": Believed(lambda a: a.t_opening, 130, None),
}
"""Presets are multiples of 10 ms."""


def timed(timer: Timer, ms: int) -> Program:
    """Return the program with another preset of one timer."""

    def changed(rung: Rung | Sequence) -> Rung | Sequence:
        return replace(rung, preset=ms) if isinstance(rung, OnDelay) and rung.timer == timer else rung

    blocks = tuple(replace(block, items=tuple(map(changed, block.items))) for block in MACHINE.program.blocks)
    program: Program = replace(MACHINE.program, blocks=blocks)
    return program


def limited(ms: int, sequence: str, title: str) -> Program:
    """Return the program with another time limit of one step."""
    program = MACHINE.program

    def changed(item: Rung | Sequence) -> Rung | Sequence:
        return _limited(item, ms, title) if isinstance(item, Sequence) and item.name == sequence else item

    blocks = tuple(replace(block, items=tuple(map(changed, block.items))) for block in program.blocks)
    limited_program: Program = replace(program, blocks=blocks)
    return limited_program


def _limited(sequence: Sequence, ms: int, title: str) -> Sequence:
    steps = [
        replace(step, watch=replace(step.watch, ms=ms)) if step.title == title and step.watch is not None else step
        for step in sequence.steps
    ]
    changed = copy(sequence)
    changed.steps = tuple(steps)
    return changed


def test_the_delivered_program_fits_the_delivered_machine() -> None:
    assert misfits(MACHINE.program, TAGS, DELIVERED) == ()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name", BELIEVED)
def test_each_time_that_is_believed_has_limits(name: str, side: Side) -> None:
    """The check of the proof accepts the limits and nothing beyond them, on either side."""
    believed = BELIEVED[name]
    timer = believed.timer(TAGS.arms[side])
    check = next(check for check in specification(MACHINE).checks if check.name == CHECK)
    assert check.of_program is not None
    assert check.of_program(timed(timer, believed.least_ms)).holds
    assert not check.of_program(timed(timer, believed.least_ms - 10)).holds
    if believed.most_ms is not None:
        assert check.of_program(timed(timer, believed.most_ms)).holds
        assert not check.of_program(timed(timer, believed.most_ms + 10)).holds


@pytest.mark.parametrize(
    ("sequence", "title", "least_ms"),
    [
        ("left arm", "approach row", 3_600),
        ("right arm", "lift from row", 1_600),
        ("left arm", "spread", 1_400),
        ("right arm", "close claws", 300),
        ("left homing", "out low", 3_600),
        ("right homing", "raise loaded", 1_600),
    ],
)
def test_a_step_must_last_until_its_arrival_is_believed(sequence: str, title: str, least_ms: int) -> None:
    assert misfits(limited(least_ms, sequence, title), TAGS, DELIVERED) == ()
    (line,) = misfits(limited(least_ms - 100, sequence, title), TAGS, DELIVERED)
    assert line.startswith(f"{sequence}: {title}: limit {least_ms - 100} ms, but the ")


def test_the_proof_names_the_travel_times() -> None:
    times = TravelTimes(lift_ms=1_600)
    specified = specification(MACHINE, times)
    assert "lift 320 to 1600 ms" in specified.assumptions[-1]
    check = next(check for check in specified.checks if check.name == CHECK)
    result = check.run()
    assert not result.holds
    assert "left lift: its arrival is believed after 1500 ms, but the travel takes 1600 ms" in result.lines


# at a start


def given(file: Path | None, *assignments: str) -> dict[Word, int]:
    """Return the values of a start."""
    return start_values(MACHINE, argparse.Namespace(constants=file, set_points=assignments))


@pytest.mark.parametrize(
    ("text", "assignments", "message"),
    [
        (
            "lift_ms: 1600\n",
            (),
            "constants.yaml: left lift: its arrival is believed after 1500 ms, but the travel takes 1600",
        ),
        ("claws_ms: 210\n", (), "constants.yaml: left.claws closing: believed after 200 ms, but takes 210 ms, and 3"),
        (
            "row_1_shortest_ms: 370\n",
            (),
            "constants.yaml: left slide: a switch is believed after 900 ms, but can come on",
        ),
        ("{}\n", ("clamp=12",), "constants.yaml: left.claws closing: believed after 120 ms, but takes 130 ms"),
        ("{}\n", ("slide_least=40",), "constants.yaml: left slide: a switch that fails on is believed after 400 ms"),
    ],
)
def test_a_start_that_does_not_fit_the_machine_is_refused(
    tmp_path: Path, text: str, assignments: tuple[str, ...], message: str
) -> None:
    file = tmp_path / "constants.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        given(file, *assignments)
    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)


def test_a_constant_can_make_another_machine_fit(tmp_path: Path) -> None:
    file = tmp_path / "constants.yaml"
    file.write_text("row_1_ms: 450\nrow_1_shortest_ms: 370\nslide_least: 28\n", encoding="utf-8")
    assert given(file) == {TAGS.sp.slide_least: 28}


# the twin


@pytest.mark.parametrize("row_spacing_m", [0.35, 0.6, 0.8])
def test_the_file_that_the_twin_derives_fits(tmp_path: Path, row_spacing_m: float) -> None:
    """For each row spacing of the paper, the controller accepts the derived file."""
    machine = default_parameters().with_values({"layout.row_spacing_m": row_spacing_m})
    file = tmp_path / "constants.yaml"
    file.write_text(constants_file(machine), encoding="utf-8")
    assert given(file) == {getattr(TAGS.sp, name): value for name, value in set_points_of(machine).items()}
    check_fit(MACHINE, machine, set_points_of(machine))


def test_the_default_times_are_those_of_the_delivered_machine() -> None:
    """The longest way to row 1 is that of the largest row spacing; other times differ only by rounding."""
    derived, widest = (
        travel_times_of(default_parameters().with_values({"layout.row_spacing_m": spacing})) for spacing in (0.6, 0.8)
    )
    assert DELIVERED.row_1_ms == widest.row_1_ms
    rounded = {"lift_shortest_ms": 1, "belt_ms": 5, "row_shortest_ms": 1}
    for name in (
        "lift_ms",
        "lift_shortest_ms",
        "belt_ms",
        "belt_shortest_ms",
        "row_1_shortest_ms",
        "row_ms",
        "row_shortest_ms",
    ):
        assert abs(getattr(DELIVERED, name) - getattr(derived, name)) <= rounded.get(name, 0), name


def test_the_twin_refuses_constants_that_do_not_fit_its_machine() -> None:
    with pytest.raises(
        MisfitError, match=r"^arms_may_meet: 1, but layout\.arms_may_meet_in_plant of the machine is false"
    ):
        Twin(set_points={"arms_may_meet": 1})
    with pytest.raises(MisfitError, match="believed after 120 ms, but takes 130 ms"):
        Twin(set_points={"clamp": 12})
    with pytest.raises(MisfitError, match="its arrival is believed after 1500 ms, but the travel takes 1510 ms"):
        Twin(parameters=default_parameters().with_values({"lift.stroke_m": 0.302}))
