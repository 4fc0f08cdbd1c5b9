"""Findings of random stories: planted defects are found, known causes are needed, stories by chance find nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from controller.program.machine import build
from controller.verify.mutants.sample import mutants_of
from plant_sim.cli.stories import accepted_harm
from plant_sim.stories.drawn.action import Deed, RandomStory, StoryAction, parse_story
from plant_sim.stories.drawn.guide import StoryGuide
from plant_sim.stories.drawn.harm import LOST, NOT_RECOVERED, Harm
from plant_sim.stories.drawn.known import KNOWN
from plant_sim.stories.drawn.play import PlayedStory, StoryPlayer
from plant_sim.stories.drawn.report import StoryRun
from plant_sim.stories.drawn.verdict import HarmClass, KnownHarm, StoryJudge
from plant_sim.twin.lock_step import Twin
from tests.plant_sim.stories.drawn.story_rig import MACHINE, PARAMETERS, judge, played
from tests.sampling import first_of
from tests.wiring import wired

STUCK = "coil memory: RST right.reached pick 2: right.slide_inward inverted"
"""Mutant with which the machine does not work again after some faults."""


def run_of(seed: int) -> StoryRun:
    """Return a run with the delivered program."""
    return StoryRun(MACHINE, PARAMETERS, accepted_harm, seed=seed)


@pytest.mark.parametrize(
    ("count", "least_share", "most_never", "most_quiet"),
    first_of([(5, 0.08, 23, 5), (8, 0.08, 22, 7), (50, 0.3, 3, 44)]),
)
def test_stories_find_nothing_new(count: int, least_share: float, most_never: int, most_quiet: int) -> None:
    """No violated requirement, no exception, no machine that stays at rest, no silent harm without a known cause."""
    run = run_of(seed=1)
    for number in range(count):
        run.play(number)
    run.minimise_findings(most_plays=20)
    lines = [*run.report.lines()]
    assert lines[-1] == "findings: none", "\n".join(lines)
    assert run.report.count == count
    assert run.report.classes[HarmClass.NONE] <= most_quiet, "the stories disturb too little"
    assert run.report.coverage.share_of_reached > least_share
    assert len(run.report.coverage.never) <= most_never


@pytest.mark.nightly
@pytest.mark.timeout(3_600)
@pytest.mark.parametrize("seed", [11, 12, 13, 14])
def test_two_thousand_stories_find_nothing_new(seed: int) -> None:
    """500 for each of four seeds; every kind of fault and action has an effect."""
    run = run_of(seed=seed)
    for number in range(500):
        run.play(number)
    run.minimise_findings()
    lines = [*run.report.lines()]
    assert lines[-1] == "findings: none", "\n".join(lines)
    assert run.report.coverage.never == ()
    assert run.report.coverage.share_of_reached > 0.7


@pytest.mark.parametrize("plays", first_of([4, 15]))
def test_an_interlock_that_is_left_out_is_found_and_minimised(plays: int) -> None:
    """A requirement is violated in the first stories; hardly any action is needed."""
    machine = build(MACHINE.io_map, without=["left: stop at the row"])
    run = StoryRun(machine, PARAMETERS, accepted_harm, seed=1)
    assert any(run.play(number).of_story is HarmClass.VIOLATION for number in range(3))
    run.minimise_findings(most_plays=plays)
    finding = next(iter(run.report.findings.values()))
    least = finding.sighting.played.story
    assert finding.sighting.of_story is HarmClass.VIOLATION
    assert len(least.actions) < finding.actions / 2
    assert run.replay(least).signature == finding.sighting.signature
    assert any("requirement left: inward, past the row" in line for line in run.report.lines())


def test_a_machine_that_does_not_work_again_is_found() -> None:
    [mutant] = [each for each in mutants_of(MACHINE.program) if str(each) == STUCK]
    run = StoryRun(replace(MACHINE, program=mutant.program), PARAMETERS, accepted_harm, seed=1)
    assert any(run.play(number).of_story is HarmClass.STUCK for number in range(12))


def test_an_exception_is_a_finding_with_the_command_that_replays_it(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = Twin.power_cycle

    def fails(twin: Twin, off_ms: int = 1_000) -> None:
        sound(twin, off_ms)
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(Twin, "power_cycle", fails)
    story = parse_story("seed=1 trays=1 work=0; 50 mend; 90 power kept for=100; 500 tend; 900 push =1.0")
    monkeypatch.setattr(StoryGuide, "story", lambda _self, _number: story)
    run = run_of(seed=1)
    run.play(0)
    run.minimise_findings()
    [finding] = run.report.findings.values()
    assert finding.sighting.of_story is HarmClass.CRASH
    [action] = finding.sighting.played.story.actions
    assert action.deed is Deed.POWER
    text = "\n".join(run.report.lines())
    assert "ZeroDivisionError in test_findings.py" in text
    assert f"--replay '{finding.sighting.played.story}'" in text


@pytest.mark.parametrize("known", first_of([(each,) for each in KNOWN]), ids=lambda known: known.name)
def test_a_known_cause_still_does_harm(known: KnownHarm) -> None:
    """Else it has been mended, and the entry is deleted; without the cause there is no harm."""
    story = parse_story(known.replay)
    assert judge().of_played(played(known.replay)).known == known.name
    rest = tuple(action for action in story.actions if action.kind != known.cause)
    others = [kind for harm in played(str(story.with_actions(rest))).harms for kind in harm.kinds]
    assert not known.kinds & {*others} or "double" in others  # the other fault of a story of two does other harm


@pytest.mark.nightly
def test_ground_pulses_tell_a_false_cup_pulse_at_standstill() -> None:
    [known] = [each for each in KNOWN if each.part == "cup_pulse"]
    player = StoryPlayer(build(wired("ground_pulse")), PARAMETERS)
    assert player.play(parse_story(known.replay)).harms == []


MENDED = (
    "seed=541 trays=3 work=30540; 31100 press emergency_stop for=530; 31570 push =19.6",
    "seed=613 trays=3 work=39830; 40690 press stop for=2300; 42150 fault halved_flags:right.cup_pulse =0.733 for=3010",
    "seed=1 trays=2 work=9000; 10000 fault doubled_pulses:left.cup_pulse =0.75 for=8400; 10030 command stop",
    "seed=755 trays=3 work=0; 11910 tend; 26470 tend; "
    "26780 fault doubled_pulses:left.cup_pulse =0.75 for=18400; 26810 command stop",
    "seed=131 trays=3 work=34030; 10150 speed =0.0; 16210 command stop; "
    "39750 fault halved_flags:right.cup_pulse =0.523",
    "seed=891 trays=3 work=30700; 9940 fault stuck_off:left.claws_spread for=970",
)
"""Stories that did harm before the program asked about the tray, and checked cups and switches at every time."""


def test_an_arm_that_a_damaged_memory_takes_out_of_service_works_again() -> None:
    """Away from feed, it is off home after each homing until the operator returns it to service in Stopped."""
    story = (
        "seed=321 trays=3 work=43320; 24820 command stop; 34390 tend; 39920 tend; 43480 power damaged =0.416 for=330"
    )
    assert played(f"{story}; 44860 tend").harms == []


@pytest.mark.parametrize("text", first_of(MENDED))
def test_a_mended_cause_does_no_harm(text: str) -> None:
    assert judge().of_played(played(text)).of_story in {HarmClass.NONE, HarmClass.TOLD}


def harmed(*kinds: str, **values: object) -> PlayedStory:
    """Return a played story with one harm, after a fault that the fault matrix expects to do no harm."""
    action = StoryAction(5, Deed.FAULT, "jammed:left.slide")
    harm = replace(Harm(900, 5, dict.fromkeys(kinds, "planted"), acted=(action,)), **values)  # type: ignore[arg-type]
    return PlayedStory(RandomStory(1, 1, 0, (action,)), [harm])


PUSH = StoryAction(5, Deed.PUSH, size=9.0)
DOUBLED = StoryAction(5, Deed.FAULT, "doubled_pulses:left.cup_pulse", 0.5)
CLASSES = [
    (harmed("torn"), HarmClass.SILENT),
    (harmed("torn", alarms=("tray_jam",)), HarmClass.TOLD),
    (harmed("torn", ordered=(PUSH,)), HarmClass.ORDERED),
    (harmed("torn", acted=(PUSH,)), HarmClass.KNOWN),
    (harmed("double", acted=(PUSH,)), HarmClass.SILENT),
    (harmed(NOT_RECOVERED, acted=(PUSH,)), HarmClass.STUCK),
    (harmed(NOT_RECOVERED, acted=(DOUBLED,)), HarmClass.STUCK),
    (harmed("stems_cut", LOST, acted=(StoryAction(5, Deed.FAULT, "jammed:left.lift"),)), HarmClass.HIDDEN),
    (harmed("torn", acted=(StoryAction(5, Deed.FAULT, "jammed:left.lift"),)), HarmClass.SILENT),
    (harmed("dropped", LOST, acted=(StoryAction(5, Deed.FAULT, "jammed:left.claws"),)), HarmClass.HIDDEN),
    (harmed("arms_collide", acted=(StoryAction(5, Deed.FAULT, "jammed:left.claws"),)), HarmClass.SILENT),
    (harmed(LOST, acted=(StoryAction(5, Deed.SPEED, size=0.0),)), HarmClass.HIDDEN),
    (harmed("arm_through_tray", acted=(StoryAction(5, Deed.AIR, size=0.0),)), HarmClass.HIDDEN),
    (harmed("torn", blind=(StoryAction(5, Deed.POWER, "old", 0.5),)), HarmClass.HIDDEN),
    (harmed("requirement x", blind=(StoryAction(5, Deed.POWER, "old", 0.5),)), HarmClass.HIDDEN),
    (harmed("requirement x", alarms=("tray_jam",), ordered=(PUSH,)), HarmClass.VIOLATION),
    (harmed("opposite_coils", blind=(StoryAction(5, Deed.POWER, "old", 0.5),)), HarmClass.VIOLATION),
    (harmed(NOT_RECOVERED, alarms=("tray_jam",), ordered=(PUSH,)), HarmClass.STUCK),
    (PlayedStory(RandomStory(1, 1, 0)), HarmClass.NONE),
    (PlayedStory(RandomStory(1, 1, 0), crash="ValueError in x.py:1: y"), HarmClass.CRASH),
]


@pytest.mark.parametrize(("story", "expected"), first_of(CLASSES, len(CLASSES)))
def test_the_class_of_a_harm(story: PlayedStory, expected: HarmClass) -> None:
    assert judge().of_played(story).of_story is expected


@pytest.mark.nightly
def test_silent_harm_that_an_order_hides_is_found() -> None:
    """An order before it would excuse it; the story is played again without the order."""
    strict = StoryJudge(StoryPlayer(MACHINE, PARAMETERS), accepted_harm)
    order = "46000 override left.lift_extend for=100"
    excused = played(KNOWN[0].replay.replace("50000 tend", f"{order}; 50000 tend"))
    assert strict.of_played(excused).of_story is HarmClass.ORDERED
    assert strict.sighting(excused).of_story is HarmClass.SILENT
    assert judge().sighting(excused).of_story is HarmClass.ORDERED


def test_rows_that_are_conveyed_out_uncounted_are_lost_and_those_taken_off_are_not() -> None:
    """A tray that is pushed out of the machine by hand takes its rows along; the program does not count them."""
    pushed = played("seed=1 trays=1 work=0; " + "; ".join(f"{500 + number} push =60.0" for number in range(20)))
    assert any(LOST in harm.kinds for harm in pushed.harms)
    taken = played("seed=1 trays=2 work=9000; 100 press emergency_stop for=500; 2000 take_off; 9000 tend; 14000 tend")
    assert not any(LOST in harm.kinds for harm in taken.harms)
