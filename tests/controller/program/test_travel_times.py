"""Times of the program against the travel times of the machine: at a start, in the proof, and in the twin."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

import pytest

from controller.cli.machine import start_values
from controller.cli.main import main
from controller.common.errors import InputError
from controller.core.expr import Timer, Word
from controller.core.program import Program
from controller.core.rungs import Annunciate, OnDelay, Rung
from controller.core.sequence import Sequence
from controller.core.specification import ComputedProperty
from controller.program.requirements.homing import explore
from controller.program.requirements.homing_trial import HomingTrial
from controller.program.requirements.proof import specification
from controller.program.requirements.travel_times import DELIVERED, MachineData, TravelTimes, misfits
from controller.program.tags import SIDES, ArmTags, Side
from controller.verify.mutants.judgement import Judgement
from controller.verify.mutants.result import Fate
from controller.verify.mutants.sample import mutants_of
from plant_sim.twin.commissioning import (
    MisfitError,
    check_fit,
    constants_file,
    default_parameters,
    needs_confirmation,
    set_points_of,
    travel_times_of,
)
from plant_sim.twin.lock_step import Twin
from tests.controller.program.interlock_scene import MACHINE, TAGS
from tests.sampling import first_of, one_in

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
    "lift_least": Believed(lambda a: a.t_lift_way, 160, 320),
    "belt_least": Believed(lambda a: a.t_belt_way, 450, 890),
    "slide_least": Believed(lambda a: a.t_slide_way, 580, 1_140),
    "hop_least": Believed(lambda a: a.t_slide_hop, 80, 140),
    "lift_whole": Believed(lambda a: a.t_pressed["lift"], 1_100, None),
    "belt_whole": Believed(lambda a: a.t_pressed["belt"], 970, None),
    "slide_whole": Believed(lambda a: a.t_pressed["slide"], 3_250, None),
    "clamp": Believed(lambda a: a.t_closing, 160, None),
    "release": Believed(lambda a: a.t_opening, 160, None),
}
"""Presets are multiples of 10 ms."""


def timed(timer: Timer, ms: int) -> Program:
    """Return the program with another preset of one timer."""

    def changed(rung: Rung | Sequence) -> Rung | Sequence:
        if isinstance(rung, OnDelay | Annunciate) and rung.timer == timer:
            return replace(rung, preset=ms)
        return rung

    blocks = tuple(replace(block, items=tuple(map(changed, block.items))) for block in MACHINE.program.blocks)
    program: Program = replace(MACHINE.program, blocks=blocks)
    return program


@cache
def check_of_the_machine() -> ComputedProperty:
    """Return the check of the times in the proof of the delivered machine."""
    return next(check for check in specification(MACHINE).checks if check.name == CHECK)


def limited(ms: int, sequence: str, title: str) -> Program:
    """Return the program with another time limit of one step."""
    steps = (step for each in MACHINE.program.sequences() if each.name == sequence for _, step in each)
    watch = next(step.watch for step in steps if step.title == title)
    assert watch is not None
    return timed(watch.timer, ms)


def test_the_delivered_program_fits_the_delivered_machine() -> None:
    assert misfits(MACHINE.program, TAGS, MachineData()) == ()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name", BELIEVED)
def test_each_time_that_is_believed_has_limits(name: str, side: Side) -> None:
    """The check of the proof accepts the limits and nothing beyond them, on either side."""
    believed = BELIEVED[name]
    timer = believed.timer(TAGS.arms[side])
    check = check_of_the_machine()
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
    assert misfits(limited(least_ms, sequence, title), TAGS, MachineData()) == ()
    (line,) = misfits(limited(least_ms - 100, sequence, title), TAGS, MachineData())
    assert line.startswith(f"{sequence}: {title}: limit {least_ms - 100} ms, but the ")


def test_the_proof_names_the_travel_times() -> None:
    specified = specification(MACHINE, MachineData(TravelTimes(lift_ms=1_600)))
    assert "lift 320 to 1600 ms" in specified.assumptions[-1]
    check = next(check for check in specified.checks if check.name == CHECK)
    result = check.run()
    assert not result.holds
    assert "left lift: its arrival is believed after 1500 ms, but the travel takes 1600 ms" in result.lines


def test_a_long_dwell_needs_a_long_step() -> None:
    """The dwell is a machine constant; the limit of its step exceeds it."""
    program = limited(400, "right arm", "open claws")
    assert misfits(program, TAGS, MachineData(values={TAGS.sp.release: 39})) == ()
    (line,) = misfits(program, TAGS, MachineData(values={TAGS.sp.release: 40}))
    assert line == "right arm: open claws: limit 400 ms, but the claws needs 400 ms"


@pytest.mark.nightly
def test_the_travel_model_has_the_travel_times() -> None:
    """Each switch is at the time of the travel to it, and the exploration of homing uses the same times."""
    times = TravelTimes(lift_ms=1_000, belt_ms=900, row_1_ms=2_000, row_ms=300)
    devices = HomingTrial(MACHINE, times, limit_ms=1).model.devices["right"]
    assert devices["lift"].switches == {"down": 0, "up": 1_000}
    assert devices["belt"].switches == {"converged": 0, "spread": 900}
    assert devices["slide"].switches == {"feed": 0, "pick 1": 2_000, "pick 2": 2_300, "pick 3": 2_600}
    fast = explore(MACHINE, TravelTimes(lift_ms=500, row_1_ms=1_300), every=4_000)
    slow = explore(MACHINE, every=4_000)
    assert fast.longest is not None
    assert slow.longest is not None
    assert fast.longest.ms < slow.longest.ms


@pytest.mark.nightly
@pytest.mark.parametrize(
    "text",
    first_of(
        [
            "left arm conditions: OUT left.lift travel: 120 ms instead of 250 ms",
            "right arm conditions: OUT right.lift pressed: 750 ms instead of 1500 ms",
            "alarms: ANS left.limit: lift from row: 1200 ms instead of 2500 ms",
        ]
    ),
)
def test_a_mutant_of_a_time_is_killed_by_the_check(text: str) -> None:
    mutant = next(each for each in mutants_of(MACHINE.program) if str(each) == text)
    result = Judgement(specification(MACHINE), {}).by_proof(mutant)
    assert result is not None
    assert (result.fate, result.evidence) == (Fate.PROOF, CHECK)


@pytest.mark.parametrize(
    ("text", "proved"),
    one_in(
        2,
        [
            ("row_1_ms: 1170\nrow_1_shortest_ms: 320\nslide_least: 28\n", True),
            ("clamp: 12\n", False),
            ("lift_ms: 1600\n", False),
        ],
    ),
)
def test_prove_judges_the_machine_of_the_file(tmp_path: Path, text: str, *, proved: bool) -> None:
    """As a start with the same file."""
    file = tmp_path / "constants.yaml"
    file.write_text(text, encoding="utf-8")
    assert main(["prove", "--goal", CHECK, "--constants", str(file)]) == (0 if proved else 1)


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
        (
            "claws_ms: 210\n",
            (),
            "constants.yaml: left claws closing: believed after 200 ms, but takes 210",
        ),
        (
            "row_1_shortest_ms: 370\n",
            (),
            "constants.yaml: left slide: a switch is believed after 900 ms, but can come on",
        ),
        ("{}\n", ("clamp=12",), "constants.yaml: left claws closing: believed after 120 ms, but takes 160 ms"),
        ("{}\n", ("slide_least=57",), "constants.yaml: left slide: a switch that fails on is believed after 570 ms"),
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
    file.write_text("row_1_ms: 1170\nrow_1_shortest_ms: 320\nslide_least: 28\n", encoding="utf-8")
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


def test_the_default_times_cover_the_machines_with_600_to_800_mm_between_rows() -> None:
    """They differ only by rounding from those that the twin derives."""
    narrow, wide = (
        travel_times_of(default_parameters().with_values({"layout.row_spacing_m": spacing})) for spacing in (0.6, 0.8)
    )
    covered = replace(narrow, row_1_ms=wide.row_1_ms)
    for each in fields(TravelTimes):
        assert abs(getattr(DELIVERED, each.name) - getattr(covered, each.name)) <= 3, each.name


@pytest.mark.parametrize(("may_meet", "row_spacing_m"), [(False, 0.6), (True, 0.6), (False, 0.8)])
def test_a_machine_with_other_constants_needs_a_confirmation(*, may_meet: bool, row_spacing_m: float) -> None:
    machine = default_parameters().with_values(
        {"layout.arms_may_meet_in_plant": may_meet, "layout.row_spacing_m": row_spacing_m}
    )
    assert set_points_of(machine)["arms_may_meet"] == may_meet
    assert needs_confirmation(machine) is (may_meet or row_spacing_m != 0.6)


def test_the_twin_refuses_constants_that_do_not_fit_its_machine() -> None:
    with pytest.raises(
        MisfitError, match=r"^arms_may_meet: 1, but layout\.arms_may_meet_in_plant of the machine is false"
    ):
        Twin(set_points={"arms_may_meet": 1})
    with pytest.raises(MisfitError, match="believed after 120 ms, but takes 160 ms"):
        Twin(set_points={"clamp": 12})
    with pytest.raises(MisfitError, match="its arrival is believed after 1500 ms, but the travel takes 1510 ms"):
        Twin(parameters=default_parameters().with_values({"lift.stroke_m": 0.232}))
