"""End of homing: its upper bound, and its exploration from every place and memory, with and without a stuck switch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from controller.cli.main import main
from controller.common.modbus.io_map import Polarity
from controller.core.expr import FALSE, Bit, Expr, Word, any_of, leaves
from controller.core.program import Block
from controller.core.rungs import OnDelay, Out, Rst, Rung
from controller.core.sequence import Sequence, Step, To
from controller.program.alarms.table import ARM_ALARM_NUMBERS
from controller.program.interlocks import BELT, LIFT, SLIDE
from controller.program.machine import Transplanter, build
from controller.program.places import REST_MS
from controller.program.requirements.homing import describe, explore, explore_stuck_switches
from controller.program.requirements.homing_starts import arm_starts
from controller.program.requirements.homing_trial import Ending, HomingStart, HomingTrial
from controller.program.requirements.time_limit import bounded, time_limit
from controller.program.requirements.travel_times import DELIVERED
from controller.program.states import State
from controller.program.tags import SIDES, Side
from tests.controller.verify.proof_rig import MACHINE
from tests.paths import DOCS
from tests.sampling import first_of
from tests.wiring import wired

TAGS = MACHINE.tags
SAMPLE, FEWER = 160, 320
COMPLETE_S = 1_800
"""Time limit of a complete exploration, s; it takes three minutes of processor time."""


def changed(change: Callable[[Rung], Rung | None]) -> Transplanter:
    """Return the machine with a rung changed, or removed if the change returns None."""

    def items(block: Block) -> tuple[Rung | Sequence, ...]:
        changed = (item if isinstance(item, Sequence) else change(item) for item in block.items)
        return tuple(item for item in changed if item is not None)

    program = MACHINE.program
    blocks = tuple(replace(block, items=items(block)) for block in program.blocks)
    assert blocks != program.blocks
    return replace(MACHINE, program=replace(program, blocks=blocks))


# ---- upper bound ----------------------------------------------------------------------------------------------


def test_the_bound_is_the_sum_of_the_time_limits() -> None:
    """T adds the limits of putting a row back, of moving out and of discarding a load, and those of a new tray."""
    limit = time_limit(MACHINE)
    assert limit.arm.steps[:4] == ("decide", "lower to put back", "put back", "raise empty")
    assert limit.arm.ms == 7 * 2_500 + 2 * 3_000 + 5_000 + 2_500 + 1_000
    assert limit.tray.ms == 3_200 + 100 + 200 + 12_000 + 200
    assert limit.ms == 47_950


@pytest.mark.nightly
def test_prove_prints_the_bound(capsys: pytest.CaptureFixture[str]) -> None:
    """`prove` reports T; the invariants on which it depends are proved with it."""
    assert main(["prove", "--verbose", "--goal", "homing ends within T"]) == 0
    report = capsys.readouterr().out
    assert "T = 48.0 s (arm 32.0 s, tray feeder 15.7 s)" in report
    assert "left homing: waits only for an answer" in report


def test_a_step_that_repeats_has_no_bound() -> None:
    """If a later step of homing returned to an earlier one, T would not exist."""
    home = MACHINE.homings["left"]
    steps = [_returning(step) if step.title == "converge" else step for step in home.steps]
    looping = Sequence(home.name, home.first.number, steps)
    result = bounded(replace(MACHINE, homings={**MACHINE.homings, "left": looping}))
    assert (result.holds, result.lines) == (
        False,
        ("left homing: step 'open at feed' can be repeated without a limit",),
    )


def _returning(step: Step) -> Step:
    return replace(step, go=[*step.go, To("open at feed", FALSE)])


# ---- exploration ----------------------------------------------------------------------------------------------


@pytest.mark.timeout(COMPLETE_S)
@pytest.mark.parametrize("every", first_of([FEWER, SAMPLE, 1]))
def test_every_start_ends_in_idle(every: int) -> None:
    """Without a fault and with true answers, at most three homings lead from any place and memory to Idle.

    One start in 320 is examined; all of them with ``--nightly``.
    """
    found = explore(MACHINE, every=every)
    assert [describe(*dead_end) for dead_end in found.dead_ends] == []
    assert found.starts > 36_000 // every
    if every == 1:
        page = (DOCS / "proof.md").read_text(encoding="utf-8")
        assert f"from {found.starts:,} starts" in page
        assert f"({found.homings:,} in all)" in page
    assert found.longest is not None
    assert found.longest.ms <= time_limit(MACHINE).ms


@pytest.mark.nightly
@pytest.mark.timeout(1_200)
@pytest.mark.parametrize("scan_ms", [20, 40])
def test_every_state_of_the_rows_ends_in_idle(scan_ms: int) -> None:
    """Row states that homing does not distinguish, and both arms, do not change the result."""
    found = explore(MACHINE, thorough=True, every=37, scan_ms=scan_ms)
    assert [describe(*dead_end) for dead_end in found.dead_ends] == []
    assert found.starts > 10_000


@pytest.mark.nightly
@pytest.mark.timeout(COMPLETE_S)
@pytest.mark.parametrize("every", first_of([SAMPLE, 1]))
def test_a_stuck_switch_ends_homing_in_time(every: int) -> None:
    """With any switch stuck, homing ends within T in Idle, an alarm or a question, and in Idle after the repair."""
    found = explore_stuck_switches(MACHINE, every=every)
    assert [describe(*dead_end) for dead_end in found.dead_ends] == []
    assert found.starts > 35_000 // every


@pytest.mark.nightly
@pytest.mark.parametrize("side", SIDES)
def test_without_its_question_an_arm_that_has_not_gripped_is_a_dead_end(side: Side) -> None:
    """The rule that only claws that have gripped may be lifted then blocks the lift in every homing."""
    arm = TAGS.arms[side]
    asked: Expr = arm.row_in_doubt | (arm.row_in_progress & arm.sensed_at_feed)
    machine = changed(lambda rung: Out(arm.ask, asked) if isinstance(rung, Out) and rung.target == arm.ask else rung)
    ends = [ending for _, endings in explore(machine, every=SAMPLE).dead_ends for ending in endings[-1:]]
    assert ends
    assert {"home: raise loaded"} == {alarm_key(ending, side) for ending in ends}


@pytest.mark.nightly
def test_an_answer_without_effect_is_a_dead_end() -> None:
    """If the answer "no" did not reset the load, the question would be asked again in every homing."""
    arm = TAGS.arms["left"]
    no = TAGS.commands.loaded_no["left"]
    machine = changed(
        lambda rung: (
            None if isinstance(rung, Rst) and rung.target == arm.loaded and no in set(leaves(rung.when)) else rung
        )
    )
    dead_ends = explore(machine, every=SAMPLE).dead_ends
    assert dead_ends
    assert all("left" in endings[0].asks for _, endings in dead_ends)
    assert all(endings[1].asks == ("left",) for _, endings in dead_ends), "asked again"


@pytest.mark.nightly
def test_an_arm_that_homing_compares_with_its_earlier_places_is_a_dead_end() -> None:
    """With a long release dwell, an arm moved by hand would raise the alarm of a change at rest every time."""
    arm = TAGS.arms["left"]
    at_rest = OnDelay(arm.t_rest, REST_MS, when=~any_of(*(arm.coils[name] for name in (*LIFT, *SLIDE, *BELT))))
    machine = changed(lambda rung: at_rest if isinstance(rung, OnDelay) and rung.timer == arm.t_rest else rung)
    ends = [endings[-1] for _, endings in explore(machine, every=SAMPLE).dead_ends]
    assert ends
    assert all(ARM_ALARM_NUMBERS["unbidden"][0] in ending.alarms for ending in ends)


def test_a_machine_that_does_not_move_ends_in_an_alarm() -> None:
    """The time limit of the step is reported, not a homing that goes on; the situation names its devices."""
    trial = HomingTrial(MACHINE, limit_ms=60_000)
    slide = trial.model.devices["left"]["slide"]
    lift = trial.model.devices["left"]["lift"]
    stuck = dict.fromkeys((*slide.inputs.values(), *lift.inputs.values()), False)
    known: dict[Bit | Word, int] = {arm.claws_known: 1 for arm in TAGS.arms.values()}
    situation = HomingStart({lift.position: DELIVERED.lift_ms, slide.position: 900, **known}, stuck=stuck)
    trial.begin(situation)
    ending = trial.home()
    assert (ending.state, ending.explained) == (State.HELD, True)
    assert alarm_key(ending, "left") == "home: raise empty"
    assert f"left lift={DELIVERED.lift_ms}" in describe(situation, [ending])
    assert "X1 stuck off" in describe(situation, [ending])


def test_the_starts_cover_every_place_and_every_memory() -> None:
    """The devices are at each switch, confirmed or not, and between; the memory has every permitted combination."""
    model = HomingTrial(MACHINE, limit_ms=1).model
    starts = arm_starts(model, all_rows=True)
    assert len({(start.positions, start.reached) for start in starts}) == 5 * 11 * 5
    assert len({start.claws for start in starts}) == 14
    assert len({start.rows for start in starts}) == 4**3
    assert len({start.last for start in starts if start.last}) == 3 * 5 * 3


@pytest.mark.parametrize("polarity", [Polarity.NORMALLY_OPEN, Polarity.NORMALLY_CLOSED])
def test_an_input_whose_absence_raises_an_alarm_is_on_at_rest(polarity: Polarity) -> None:
    """The air pressure is needed, whatever its polarity; an empty magazine is not."""
    io_map = wired("air_pressure_ok", "magazine_empty")
    points = (replace(each, polarity=polarity) if each.optional else each for each in io_map.inputs)
    trial = HomingTrial(build(replace(io_map, inputs=tuple(points))), limit_ms=60_000)
    known: dict[Bit | Word, int] = {arm.claws_known: 1 for arm in trial.machine.tags.arms.values()}
    trial.begin(HomingStart(known))
    ending = trial.home()
    assert (ending.explained, ending.alarms) == (True, ())


def alarm_key(ending: Ending, side: Side) -> str:
    """Return the key of the only alarm at the end of a homing, which is of the given arm."""
    [alarm] = [MACHINE.alarms.of(number) for number in ending.alarms]
    assert alarm.side == side
    return alarm.key
