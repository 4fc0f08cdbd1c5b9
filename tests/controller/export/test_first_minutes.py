"""First ten minutes of each package: its README, performed with zeroed memory at the terminals, nothing preset."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from controller.export.packages.first_minutes import QUESTIONS
from controller.export.packages.package import PackageSource
from controller.fx.language.il import read_il
from controller.program.machine import build
from controller.program.operator.answers import Question
from controller.program.operator.answers import answers as commands
from tests.controller.export.package_rig import (
    PLACES,
    FxRig,
    PackageRig,
    files_of,
    package,
    parsed_program,
    program,
)
from tests.controller.export.readme_steps import CYCLE, FIRST, NEW, STOP, Step, answers, perform, table
from tests.controller.export.terminals import Rig, Terminals
from tests.controller.program.interlock_scene import MACHINE, TAGS
from tests.paths import ROOT
from tests.sampling import first_of
from tests.wiring import unwired

TARGETS = ["fx2n", "openplc", "codesys", "plain"]


def new(target: str, *, trays: int = 1) -> Rig:
    """Return a PLC that has never run, with a package and a plant."""
    if target == "fx2n":
        return FxRig(read_il(package(target)["transplanter.il"]), trays=trays)
    return PackageRig(target, program(target).plc(device_byte=PLACES[target].device_byte), trays=trays)


def until_it_works(steps: list[Step]) -> list[Step]:
    """Return the rows up to the first one in which the machine transplants."""
    return steps[: 1 + next(n for n, step in enumerate(steps) if step.result.startswith("takes"))]


def seedlings(rig: Rig) -> tuple[int, int]:
    """Return the seedlings that have left trays and claws, after a check that nothing happened to the machine."""
    assert not rig.module.plant.events
    counts = rig.module.plant.counts()
    return counts.in_cups + counts.P + counts.D + counts.T, counts.total


@pytest.mark.parametrize("target", first_of(TARGETS))
def test_the_first_start_of_the_readme_ends_in_work(target: str) -> None:
    steps = until_it_works(table(package(target)["README.txt"], FIRST))
    assert [int(step.lamp[0]) for step in steps if "flashes" in step.lamp] == [Question.NO_TRAY]
    assert perform(steps, new(target)) == []


@pytest.mark.nightly
@pytest.mark.parametrize("target", TARGETS)
def test_the_first_trial_of_the_readme_is_complete(target: str) -> None:
    """Nobody sets anything: 72 seedlings, and 144 on the FX2N, leave the trays."""
    trays = 2 if target == "fx2n" else 1
    rig = new(target, trays=trays)
    assert perform(table(package(target)["README.txt"], FIRST), rig) == []
    assert seedlings(rig) == (72 * trays, 72 * trays)


@pytest.mark.nightly
@pytest.mark.parametrize("target", TARGETS[1:] + TARGETS[:1])
def test_a_machine_declared_new_works_without_a_question(target: str) -> None:
    steps = until_it_works(table(package(target)["README.txt"], NEW))
    assert {step.lamp for step in steps} == {"off", "-"}
    assert perform(steps, new(target)) == []


@pytest.mark.parametrize("target", first_of(TARGETS))
def test_a_machine_may_be_declared_new_in_the_first_scan(target: str) -> None:
    """The relay is set before the PLC has scanned; the declaration is kept through a loss of power."""
    on, declared, homes, _ = until_it_works(table(package(target)["README.txt"], NEW))
    rig = new(target)
    assert perform([declared], rig) == []
    rig.power_cycle()
    assert perform([on, homes], rig) == []


@pytest.mark.nightly
@pytest.mark.parametrize("target", TARGETS)
def test_a_tray_in_a_machine_declared_new_is_conveyed_out_by_homing(target: str) -> None:
    """The tray that was in place does not move before X0, and no row of it is taken."""
    readme, rig = package(target)["README.txt"], new(target, trays=2)
    conveyor = rig.module.plant.conveyor
    assert perform(until_it_works(table(readme, FIRST)), rig) == []
    operator = Terminals(rig)
    operator.press("emergency_stop", 500)
    operator.switch_off(1_000, memory_lost=True)
    on, declared, homes, works = until_it_works(table(readme, NEW))
    standing, at_place = rig.module.plant.counts().in_tray, conveyor.placed_tray
    assert perform([on, declared], rig) == []
    assert (conveyor.placed_tray, rig.module.plant.counts().in_tray) == (at_place, standing)
    assert perform([homes], rig) == []
    assert at_place == 0
    assert conveyor.placed_tray == 1
    assert perform([works], rig) == []


@pytest.mark.nightly
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("title", [CYCLE, STOP])
def test_an_interrupted_trial_is_finished_as_the_readme_says(target: str, title: str) -> None:
    """The question after a power cycle depends on the memory that the runtime keeps."""
    readme, rig = package(target)["README.txt"], new(target)
    assert perform([*until_it_works(table(readme, FIRST)), *table(readme, title)], rig, readme) == []
    assert seedlings(rig) == (72, 72)


def test_the_readme_of_the_fx2n_names_the_alarms_that_are_not_exported() -> None:
    """They are those of the complete program that no instruction of the package uses, S904 among them."""
    files = package("fx2n")
    lines = [line.partition(";")[0] for line in files["transplanter.il"].splitlines() if "ZRST" not in line]
    words = {word for line in lines for word in line.split()}
    alarms = {str(d) for d in MACHINE.program.devices() if d.kind == "S" and d.number >= 900}
    named = re.search(r"Not exported: (.+?)\. ", files["README.txt"], re.DOTALL)
    assert named
    left_out = {*re.findall(r"S9\d\d", named[1])}
    assert left_out == alarms - words
    assert "S904" in left_out


@pytest.mark.nightly
def test_an_fx2n_with_a_low_battery_asks_about_a_tray_that_is_seen() -> None:
    """The memory is cleared although it is still there, and the trial is finished."""
    rig = new("fx2n")
    assert perform(until_it_works(table(package("fx2n")["README.txt"], FIRST)), rig) == []
    operator = Terminals(rig)
    operator.run(15_000)
    operator.switch_off(1_000, memory_lost=True)
    assert operator.rests(20_000)
    readme = package("openplc")["README.txt"]
    assert perform(table(readme, CYCLE)[2:], rig, readme) == []
    assert seedlings(rig) == (72, 72)


@pytest.mark.parametrize("target", first_of(TARGETS[1:]))
def test_a_coil_of_the_readme_answers_instead_of_a_button(target: str) -> None:
    """The relay that answers is at the place which the README names."""
    readme = package(target)["README.txt"]
    (place,) = re.findall(r"yes: press X24 for 2\.5 s, or (set M420 \(.+\))", readme)
    steps = until_it_works(table(readme, FIRST))
    steps[2] = replace(steps[2], action=place)
    assert perform(steps, new(target)) == []


@pytest.mark.nightly
@pytest.mark.parametrize("target", first_of(["openplc", "plain"]))
def test_a_package_without_the_amber_lamp_is_started_by_the_coil_of_its_readme(target: str) -> None:
    """The buttons answer nothing there: the same row with a press leaves the machine without work."""
    io_map = unwired("lamp_amber")
    files = files_of(target, PackageSource(build(io_map).program, io_map))
    code, byte = parsed_program(target, files), PLACES[target].device_byte
    steps = until_it_works(table(files["README.txt"], FIRST))
    assert steps[2].action.startswith("set M420 (")
    assert perform(steps, PackageRig(target, code.plc(device_byte=byte), trays=1)) == []
    steps[2] = replace(steps[2], action="press X24 for 2.5 s")
    assert perform(steps, PackageRig(target, code.plc(device_byte=byte), trays=1))


def test_the_answers_of_the_readmes_are_those_of_the_program() -> None:
    """Numbers, relays and buttons; X24 answers with the relay of a tray that is fed only if no tray is seen."""
    given = commands(TAGS)
    assert [each.flashes for each in QUESTIONS] == list(Question)
    for target in TARGETS:
        for (number, means), (button, relay) in answers(package(target)["README.txt"]).items():
            yes, no = given[Question(number)]
            assert str(yes if button == "X0" else no) == relay, (target, number, means)


@pytest.mark.parametrize("page", ["hil.md", "hil-bench.md", "operating.md"])
def test_the_guides_name_the_coils_that_answer(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert not {f"M{answer.relay}" for each in QUESTIONS for answer in each.answers} - set(re.findall(r"M4\d\d", text))


DAMAGES = [
    ("press X24 for 2.5 s", "press X24 for 1.5 s"),
    ("5 flashes", "4 flashes"),
    ("press X24 for 2.5 s", "press X0 for 2.5 s"),
]


@pytest.mark.nightly
@pytest.mark.parametrize(("right", "wrong"), DAMAGES)
def test_a_wrong_row_of_the_readme_is_noticed(right: str, wrong: str) -> None:
    readme = package("openplc")["README.txt"].replace(right, wrong, 1)
    assert perform(until_it_works(table(readme, FIRST)), new("openplc"))
