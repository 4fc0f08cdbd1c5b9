"""Random commands and inputs: no requirement is violated and every invariant holds.

Random scenarios of commands, terminal levels, system bits, set-points, power losses and waits are run on the program
with its monitors. If an interlock rule is omitted, the same rig must detect the resulting violation.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from controller.program.machine import build
from controller.program.states import Mode, State
from controller.program.tags import SIDES, Side
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.program.modes.stories import (
    Act,
    Await,
    Button,
    GoOn,
    InTurn,
    PowerLoss,
    Press,
    Renew,
    Rig,
    SetPoint,
    Shortage,
    StepOn,
    Story,
    SystemBit,
    Terminal,
    ToAndFro,
    Wait,
)
from tests.sampling import first_of, one_in

SCANS_MS = (10, 20, 50)
"""Scan periods, ms; even the longest one is short enough to detect every switch that is passed."""
NAMES = [command.name for command in MACHINE.tags.commands]
ORDERS = [name for name in NAMES if not name.startswith("jog_")]
JOGS = [bit.name.removeprefix("command.") for bit in MACHINE.tags.commands.jog.values()]
ANSWERS = [
    ("tray_full", "cups_empty"),
    ("tray_none", "left_loaded_yes", "right_loaded_yes"),
    ("tray_same", "left_loaded_no", "right_loaded_no", "cups_empty"),
    ("left_discard", "right_discard", "cups_empty"),
]
LIMITS = {name: MACHINE.tags.sp.limits[getattr(MACHINE.tags.sp, name)] for name in MACHINE.tags.sp.names()}


def set_points() -> Iterator[st.SearchStrategy[SetPoint]]:
    for name, (lowest, highest) in LIMITS.items():
        yield st.builds(SetPoint, st.just(name), st.sampled_from((lowest, highest)) | st.integers(lowest, highest))


PERIODS = st.sampled_from(SCANS_MS)
WAITS = st.builds(Wait, PERIODS, st.integers(1, 60))
LONG_WAITS = st.builds(Wait, st.just(50), st.integers(20, 400))
SET_POINTS = st.one_of(*set_points())
SETTINGS = st.sampled_from(
    [
        SetPoint("descend_at_count", 12),
        SetPoint("converge_at", 1),
        SetPoint("trays_target", 1),
        SetPoint("no_tray", 10),
        SetPoint("arms_may_meet", 1),
    ]
)
"""Set-points that select alternative paths through the sequences."""
MODES = st.sampled_from([*Mode, *[Mode.CONTINUOUS] * len(Mode)])
GOING_ON = st.builds(GoOn, MODES, st.sampled_from(ANSWERS), WAITS, st.sampled_from(["stop", "abort"]))
STOPS = st.one_of(
    st.builds(Button, st.sampled_from(["start", "stop", "emergency_stop"]), WAITS),
    st.builds(SystemBit, st.integers(0, len(MACHINE.tags.system.bits()) - 1), WAITS),
    st.builds(PowerLoss, st.booleans()),
)
TAKEN_BACK = st.builds(
    ToAndFro, st.sampled_from([("hold", "unhold"), ("suspend", "unsuspend")]), LONG_WAITS, LONG_WAITS
)
ANY_STEP = st.sampled_from([bit for sequence in MACHINE.program.sequences() for bit, _ in sequence])
WORKING_STEP = st.sampled_from([bit for side in SIDES for bit, _ in MACHINE.cycles[side]])
ANYWHERE, AT_WORK = (st.builds(Await, step, st.just(300)) for step in (ANY_STEP, WORKING_STEP))
HAPPENINGS = (
    WAITS,
    st.builds(Press, st.tuples(st.sampled_from(ORDERS)), WAITS),
    st.builds(Press, st.tuples(st.sampled_from(NAMES), st.sampled_from(NAMES)), WAITS),
    st.builds(Renew, st.sampled_from(JOGS), st.integers(1, 40)),
    st.builds(Terminal, st.sampled_from([point.number for point in MACHINE.io_map.inputs]), st.booleans(), WAITS),
    st.builds(Shortage, st.booleans(), LONG_WAITS),
    st.builds(StepOn, st.integers(1, 3), st.integers(1, 12)),
    TAKEN_BACK,
    SET_POINTS,
    STOPS,
)
ACTS: st.SearchStrategy[Act] = st.one_of(
    *HAPPENINGS,
    GOING_ON,
    st.builds(InTurn, st.tuples(ANYWHERE, st.one_of(*HAPPENINGS))),
    st.builds(InTurn, st.tuples(AT_WORK, STOPS, GOING_ON)),
    st.builds(InTurn, st.tuples(AT_WORK, WAITS, STOPS, GOING_ON)),
)


@st.composite
def stories(draw: st.DrawFn) -> Story:
    """Draw a scenario that begins with a machine in operation."""
    begins: list[Act] = [*draw(st.lists(SETTINGS, max_size=2)), draw(GOING_ON)]
    acts = draw(st.lists(ACTS, min_size=2, max_size=8))
    return Story(draw(st.booleans()), draw(st.integers(0, 2**32 - 1)), [*begins, *acts])


AT_ONCE, QUITE_LONG = Wait(50, 2), Wait(50, 200)
WORK = GoOn(Mode.CONTINUOUS, ("cups_empty",), AT_ONCE, stop="abort")


def rare(side: Side) -> dict[str, tuple[Act, ...]]:
    """Return situations that are rare in random scenarios, each as a sequence of actions."""

    def until(title: str) -> tuple[Act, ...]:
        return WORK, Await(MACHINE.cycles[side][title], 600)

    emergency_stop = Button("emergency_stop", AT_ONCE)
    switch = MACHINE.io_map[f"{side}.slide_at_pick_1"].number
    down = MACHINE.io_map[f"{side}.lift_down"].number
    edge = MACHINE.io_map["tray_front_edge"].number
    manual = GoOn(Mode.MANUAL, (), AT_ONCE)
    return {
        "emergency stop while clamping": (*until("close claws"), emergency_stop, WORK),
        "power loss while clamping": (*until("close claws"), PowerLoss(memory_lost=False), WORK, WORK),
        "lift rises while clamping": (
            *until("close claws"),
            Press(("abort",), AT_ONCE),
            Terminal(down, level=False, then=InTurn(tuple(Press((name,), AT_ONCE) for name in ("clear", "reset")))),
        ),
        "emergency stop on the way in": (*until("approach row"), Wait(50, 10), emergency_stop, WORK),
        "emergency stop on the way out": (*until("slide to feed"), Wait(50, 10), emergency_stop, WORK),
        "emergency stop with a load at feed": (*until("wait for cups"), emergency_stop, WORK),
        "emergency stop on the way up": (*until("lift from row"), Wait(50, 6), emergency_stop, WORK),
        "slide past the row": (*until("settle at row"), Terminal(switch, level=False, then=AT_ONCE), Wait(50, 10)),
        "empty arm raised manually": (
            *until("wait at feed"),
            manual,
            Renew(f"jog_{side}_slide_inward", 10),
            Renew(f"jog_{side}_lift_retract", 5),
            WORK,
        ),
        "row discarded": (GoOn(Mode.CONTINUOUS, (f"{side}_discard",), Wait(50, 100)),),
        "stop over cups at rest": (
            *until("wait for cups"),
            Shortage(cups=True, meanwhile=Press(("stop",), QUITE_LONG)),
        ),
        "cups awaited above": (
            SetPoint("descend_at_count", 12),
            *until("close claws"),
            Shortage(cups=True, meanwhile=QUITE_LONG),
        ),
        "empty arm raised to converge": (SetPoint("converge_at", 1), *until("raise empty"), Wait(50, 60)),
        "held and resumed": (*until("approach row"), ToAndFro(("hold", "unhold"), QUITE_LONG, QUITE_LONG)),
        "suspended and resumed": (*until("approach row"), ToAndFro(("suspend", "unsuspend"), AT_ONCE, QUITE_LONG)),
        "complete": (*until("approach row"), AT_ONCE, Press(("complete",), Wait(50, 600))),
        "no tray in the magazine": (SetPoint("no_tray", 10), Shortage(cups=False, meanwhile=WORK), WORK),
        "something in the gap behind the tray": (
            WORK,
            Await(MACHINE.feeder["index"], 2_000),
            Terminal(edge, level=True, then=AT_ONCE),
            WORK,
        ),
        "the tray emptied": (WORK, Await(MACHINE.feeder["move tray out"], 2_000), Wait(50, 100)),
    }


STEPS = {bit.name for sequence in MACHINE.program.sequences() for bit, _ in sequence}
SEARCH = settings(database=None, max_examples=500, suppress_health_check=[HealthCheck.too_slow])


def search(rig: Rig, how: settings) -> None:
    """Run random scenarios on a rig.

    Raises:
        AssertionError: A scan violates a requirement or an invariant.
    """

    @how
    @given(stories())
    def run(story: Story) -> None:
        rig.run(story)

    run()


@pytest.mark.parametrize("examples", first_of([40, 90, SEARCH.max_examples]))
def test_no_requirement_or_invariant_is_violated_in_random_scenarios(examples: int) -> None:
    """No scan of the rare situations or of the random scenarios violates a requirement or an invariant."""
    rig = Rig(MACHINE)
    for story in (story for side in SIDES for story in rare(side).values()):
        rig.run(Story(follows=True, seed=1, acts=[*story]))
    search(rig, settings(SEARCH, derandomize=True, max_examples=examples))
    assert {*State, *Mode, *STEPS} - rig.visited == set()
    assert rig.checked > 300 * examples


@pytest.mark.nightly
@pytest.mark.timeout(1_800)
def test_ten_thousand_new_random_scenarios() -> None:
    search(Rig(MACHINE), settings(SEARCH, max_examples=10_000))


def jogging(side: Side, *jogs: str) -> Story:
    """Return a scenario that jogs an empty arm at home, one output after another."""
    home = (WORK, Await(MACHINE.cycles[side]["wait at feed"], 600), GoOn(Mode.MANUAL, (), AT_ONCE))
    return Story(follows=True, seed=1, acts=[*home, *(Renew(f"jog_{jog}", 6) for jog in jogs)])


@pytest.mark.parametrize(
    ("rule", "jogs", "broken"),
    one_in(
        3,
        [
            ("left: inward ready", ["left_claws_close", "left_slide_inward"], "left: inward, claws not open"),
            ("left: down at feed only", ["left_slide_inward", "left_lift_extend"], "left: down away from feed"),
            (
                "left: outward clear",
                ["left_slide_inward", "left_lift_retract", "left_slide_outward"],
                "left: outward, not up",
            ),
            ("left: spread only when up at feed", ["left_spread"], "left: spread, not up at feed"),
            (
                "left: close only at row or feed",
                ["left_slide_inward", "left_claws_close"],
                "left: close away from row and feed",
            ),
            ("tray: arms at feed", ["left_slide_inward", "tray_run"], "tray moves with an arm away from feed"),
        ],
    ),
)
def test_jogging_without_an_interlock_violates_a_requirement(rule: str, jogs: list[str], broken: str) -> None:
    """If a rule is omitted, the rig names the violated requirement; with all rules, the same jogging violates none."""
    story = jogging("left", *jogs)
    Rig(MACHINE).run(story)
    with pytest.raises(AssertionError, match=broken):
        Rig(build(MACHINE.io_map, without=[rule])).run(story)


@pytest.mark.nightly
def test_random_scenarios_detect_a_missing_interlock() -> None:
    rig = Rig(build(MACHINE.io_map, without=["left: no arm fault"]))
    with pytest.raises(AssertionError, match="left: coil on during a fault"):
        search(rig, settings(SEARCH, derandomize=True, phases=[Phase.generate]))
