"""Whatever is ordered, whenever, and whatever the terminals say: no requirement is broken, every invariant holds.

Sequences of orders, terminals, system bits, set-points, losses of power and time are drawn at random and run on the
program with its monitors; the same rig with one interlock taken out shows that it would see what goes wrong.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from random import Random
from typing import Any, Protocol

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from interlock_scene import MACHINE
from stand_in import StandIn

from controller.core.compile import expression
from controller.core.devices import Memory
from controller.core.expr import Bit
from controller.core.scan import Plc
from controller.core.specification import Specification
from controller.program.machine import Transplanter, build
from controller.program.proof import specification
from controller.program.states import Mode, State
from controller.program.tags import SIDES, Side

SCANS_MS = (10, 20, 50)
"""Periods of a scan: a slow one still sees every switch that is passed."""
FLIPPED = 0.15
"""Share of the scans in which a terminal that nothing binds changes its level."""

Check = Callable[[Memory], str]


def compiled(specification: Specification) -> Check:
    """Return a function that names the first requirement broken, or invariant lost, in a memory; '' if none is."""
    kinds = ("X", "Y", "M", "S", "T", "C", "D", "TV", "CV")
    lines = [f"    if {expression(each.never)}: return {each.name!r}" for each in specification.requirements]
    lines += [f"    if not ({expression(each.holds)}): return {each.name!r}" for each in specification.invariants]
    text = "\n".join(["def check(m):", *(f"    {kind} = m.{kind}" for kind in kinds), *lines, "    return ''"])
    namespace: dict[str, Any] = {}
    exec(compile(text, "<specification>", "exec"), namespace)  # noqa: S102 - text made from checked declarations
    check: Check = namespace["check"]
    return check


class Rig:
    """The program with its monitors in RUN, switched on and off many times.

    Attributes:
        checked: Scans after which everything has been checked.
    """

    def __init__(self, machine: Transplanter) -> None:
        self.machine, self.tags = machine, machine.tags
        self.specification = specification(machine)
        self._situations: set[tuple[int, ...]] = set()
        self.checked = 0
        self._plc = Plc(self.specification.watched, input_filter_ms=0)
        self._new = copy.deepcopy(self._plc.memory)
        self._check = compiled(self.specification)
        self._steps = {bit.number: bit.name for sequence in machine.program.sequences() for bit, _ in sequence}

    @property
    def visited(self) -> set[State | Mode | str]:
        """Every state, mode and step that has been on after a scan, over all runs."""
        found: set[State | Mode | str] = set()
        for state, mode, *steps in self._situations:
            found |= {State(state), Mode(mode), *(name for number, name in self._steps.items() if steps[number])}
        return found

    def run(self, story: Story) -> None:
        """Switch a new machine on and let a story happen.

        Raises:
            AssertionError: Something that must never be, was; or an invariant was lost.
        """
        self._random, self._now_ms = Random(story.seed), 0
        self._stand_in = StandIn(self.machine.io_map) if story.follows else None
        self._levels = self.machine.io_map.safe_inputs()
        self._image = self.machine.io_map.safe_outputs()
        known = {bit.number: self._random.random() < 0.5 for bit in self.specification.remembered}
        self._switch_on({}, known)
        self.scan(10)
        for act in story.acts:
            act.on(self)

    def read(self, device: Bit) -> int:
        """Read a device after a scan."""
        return self._plc.read(device)

    def write(self, values: Mapping[Any, int]) -> None:
        """Write devices before the next scan."""
        for device, value in values.items():
            self._plc.write(device, value)

    def press(self, name: str) -> None:
        """Give an order for the next scan."""
        self._plc.press(self.tags.commands[name])

    def terminal(self, number: int, level: bool | None) -> None:
        """Hold what a terminal senses; None lets it go."""
        if self._stand_in is None:
            self._levels[number] = bool(level)
        elif level is None:
            self._stand_in.stuck.pop(number, None)
        else:
            self._stand_in.stuck[number] = level

    def button(self, tag: str, *, pressed: bool) -> None:
        """Press or let go a button."""
        point = self.machine.io_map[tag]
        if self._stand_in is None:
            self._levels[point.number] = point.level(pressed)
        elif pressed:
            self._stand_in.pressed.add(tag)
        else:
            self._stand_in.pressed.discard(tag)

    def mend(self) -> None:
        """Let every switch and button go, and end what ails the system."""
        self.write(dict.fromkeys(self.tags.system.bits(), 0))
        if self._stand_in is not None:
            self._stand_in.stuck.clear()
            self._stand_in.pressed.clear()

    def supply(self, *, cups: bool = True, trays: bool = True) -> None:
        """Let the tractor drive or stand, and fill or empty the magazine."""
        if self._stand_in is not None:
            self._stand_in.cups_come, self._stand_in.trays_come = cups, trays

    def lose_power(self, *, memory_lost: bool) -> None:
        """Switch off and on again; the monitors keep what they know of the machine."""
        known = {bit.number: self._plc.memory.M[bit.number] for bit in self.specification.remembered}
        kept = {} if memory_lost else self._plc.retained()
        self._switch_on(kept, known)
        self._plc.write(self.tags.system.memory_lost, memory_lost)
        self._now_ms += 1_000
        self.scan(10)

    def scan(self, ms: int, times: int = 1) -> None:
        """Let time pass scan by scan, and look after each."""
        memory, steps = self._plc.memory, 1 + max(self._steps)
        state, mode = self.tags.machine.state.number, self.tags.machine.mode.number
        for _ in range(times):
            self._now_ms += ms
            self._image = self._plc.scan(self._now_ms, self._inputs(ms))
            wrong = self._check(memory)
            assert not wrong, wrong
            self._situations.add((memory.D[state], memory.D[mode], *memory.S[:steps]))
        self.checked += times

    def _inputs(self, ms: int) -> list[bool]:
        if self._stand_in is not None:
            return self._stand_in.advance(ms, self._image)
        if self._random.random() < FLIPPED:
            number = self._random.randrange(len(self._levels))
            self._levels[number] = not self._levels[number]
        return self._levels

    def _switch_on(self, kept: Mapping[str, int], known: Mapping[int, bool]) -> None:
        for kind in fields(Memory):
            getattr(self._plc.memory, kind.name)[:] = getattr(self._new, kind.name)
        self._plc.scans = 0
        if kept:
            self._plc.restore(kept)
        for number, on in known.items():
            self._plc.memory.M[number] = on


# what may happen


@dataclass(frozen=True)
class Wait:
    """Time passes."""

    ms: int
    scans: int

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.scan(self.ms, self.scans)


@dataclass(frozen=True)
class Press:
    """One or two orders at once, and a while after them."""

    commands: tuple[str, ...]
    then: Wait

    def on(self, rig: Rig) -> None:
        """Happen."""
        for name in self.commands:
            rig.press(name)
        self.then.on(rig)


@dataclass(frozen=True)
class Renew:
    """An output held by hand: the order is given scan after scan."""

    output: str
    scans: int

    def on(self, rig: Rig) -> None:
        """Happen."""
        for _ in range(self.scans):
            rig.press(self.output)
            rig.scan(50)


@dataclass(frozen=True)
class Button:
    """A button pressed for a while."""

    tag: str
    held: Wait

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.button(self.tag, pressed=True)
        self.held.on(rig)
        rig.button(self.tag, pressed=False)
        rig.scan(10)


@dataclass(frozen=True)
class Terminal:
    """A switch or a wire that says something else for a while."""

    number: int
    level: bool
    then: Wait

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.terminal(self.number, self.level)
        self.then.on(rig)
        rig.terminal(self.number, None)


@dataclass(frozen=True)
class SystemBit:
    """Something of the runtime goes wrong for a while."""

    index: int
    then: Wait

    def on(self, rig: Rig) -> None:
        """Happen."""
        bit = rig.tags.system.bits()[self.index]
        rig.write({bit: 1})
        self.then.on(rig)
        rig.write({bit: 0})


@dataclass(frozen=True)
class SetPoint:
    """A set-point takes any value that the runtime lets through."""

    name: str
    value: int

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.write({getattr(rig.tags.sp, self.name): self.value})


@dataclass(frozen=True)
class PowerLoss:
    """The power goes and comes."""

    memory_lost: bool

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.lose_power(memory_lost=self.memory_lost)


@dataclass(frozen=True)
class Shortage:
    """No cups come while something happens, or no trays."""

    cups: bool
    meanwhile: Act

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.supply(cups=not self.cups, trays=self.cups)
        self.meanwhile.on(rig)
        rig.supply()


@dataclass(frozen=True)
class ToAndFro:
    """Two orders of which one takes the other back, with time between."""

    orders: tuple[str, str]
    between: Wait
    then: Wait

    def on(self, rig: Rig) -> None:
        """Happen."""
        for name, wait in zip(self.orders, (self.between, self.then), strict=True):
            rig.press(name)
            wait.on(rig)


@dataclass(frozen=True)
class GoOn:
    """An operator sets the machine to work again in some mode: mends, stops, clears, answers, homes and starts."""

    mode: Mode
    answers: tuple[str, ...]
    work: Wait
    stop: str = "stop"

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.mend()
        orders = ((self.stop,), ("clear",), (f"mode_{self.mode.name.lower()}", *self.answers), ("reset",))
        for commands in orders:
            for name in commands:
                rig.press(name)
            rig.scan(10, 3)
        rig.scan(50, 110)
        rig.press("start")
        rig.scan(10, 2)
        self.work.on(rig)


@dataclass(frozen=True)
class StepOn:
    """Step mode's button, pressed for one of its sequences again and again."""

    sequence: int
    presses: int

    def on(self, rig: Rig) -> None:
        """Happen."""
        rig.write({rig.tags.sp.step_sequence: self.sequence})
        for _ in range(self.presses):
            rig.press("step")
            rig.scan(50, 16)


@dataclass(frozen=True)
class Await:
    """Time passes until a step is on, or long enough."""

    step: Bit
    scans: int

    def on(self, rig: Rig) -> None:
        """Happen."""
        for _ in range(self.scans):
            rig.scan(50)
            if rig.read(self.step):
                return


@dataclass(frozen=True)
class InTurn:
    """One thing after another."""

    acts: tuple[Act, ...]

    def on(self, rig: Rig) -> None:
        """Happen."""
        for act in self.acts:
            act.on(rig)


class Act(Protocol):
    """Something that may happen to a machine."""

    def on(self, rig: Rig, /) -> None:
        """Happen."""


@dataclass(frozen=True)
class Story:
    """What happens to a new machine.

    Attributes:
        follows: Whether its switches follow its coils; otherwise they say anything.
        seed: Decides what is not drawn one by one: what the monitors believe at first, what terminals say.
        acts: What happens, in order.
    """

    follows: bool
    seed: int
    acts: list[Act] = field(default_factory=list)


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
"""Those that lead the sequences other ways."""
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
    """Draw a story that begins with a machine set to work."""
    begins: list[Act] = [*draw(st.lists(SETTINGS, max_size=2)), draw(GOING_ON)]
    acts = draw(st.lists(ACTS, min_size=2, max_size=8))
    return Story(draw(st.booleans()), draw(st.integers(0, 2**32 - 1)), [*begins, *acts])


AT_ONCE, QUITE_LONG = Wait(50, 2), Wait(50, 200)
WORK = GoOn(Mode.CONTINUOUS, ("cups_empty",), AT_ONCE, stop="abort")


def rare(side: Side) -> dict[str, tuple[Act, ...]]:
    """Return turns that seldom come by in stories drawn at random, each told once."""

    def until(title: str) -> tuple[Act, ...]:
        return WORK, Await(MACHINE.cycles[side][title], 600)

    emergency_stop = Button("emergency_stop", AT_ONCE)
    switch = MACHINE.io_map[f"{side}.slide_at_pick_1"].number
    by_hand = GoOn(Mode.MANUAL, (), AT_ONCE)
    return {
        "emergency stop while clamping": (*until("close claws"), emergency_stop, WORK),
        "power loss while clamping": (*until("close claws"), PowerLoss(memory_lost=False), WORK, WORK),
        "emergency stop on the way in": (*until("approach row"), Wait(50, 10), emergency_stop, WORK),
        "emergency stop on the way out": (*until("slide to feed"), Wait(50, 10), emergency_stop, WORK),
        "emergency stop on the way up": (*until("lift from row"), Wait(50, 6), emergency_stop, WORK),
        "gone past the row": (*until("settle at row"), Terminal(switch, level=False, then=AT_ONCE), Wait(50, 10)),
        "lifted empty by hand": (
            *until("wait at feed"), by_hand,
            Renew(f"jog_{side}_slide_inward", 10), Renew(f"jog_{side}_lift_retract", 5), WORK),
        "load given away": (GoOn(Mode.CONTINUOUS, (f"{side}_discard",), Wait(50, 100)),),
        "stop over standing cups": (
            *until("wait for cups"), Shortage(cups=True, meanwhile=Press(("stop",), QUITE_LONG))),
        "cups awaited above": (
            SetPoint("descend_at_count", 12), *until("close claws"), Shortage(cups=True, meanwhile=QUITE_LONG)),
        "empty arm raised to converge": (SetPoint("converge_at", 1), *until("raise empty"), Wait(50, 60)),
        "held and gone on": (*until("approach row"), ToAndFro(("hold", "unhold"), QUITE_LONG, QUITE_LONG)),
        "suspended and gone on": (*until("approach row"), ToAndFro(("suspend", "unsuspend"), AT_ONCE, QUITE_LONG)),
        "complete": (*until("approach row"), AT_ONCE, Press(("complete",), Wait(50, 600))),
        "no tray in the magazine": (SetPoint("no_tray", 10), Shortage(cups=False, meanwhile=WORK), WORK),
        "the tray emptied": (WORK, Await(MACHINE.feeder["move tray out"], 2_000), Wait(50, 100)),
    }  # fmt: skip


STEPS = {bit.name for sequence in MACHINE.program.sequences() for bit, _ in sequence}
SEARCH = settings(deadline=None, database=None, max_examples=500, suppress_health_check=[HealthCheck.too_slow])


def search(rig: Rig, how: settings) -> None:
    """Let a rig run through stories drawn at random.

    Raises:
        AssertionError: After some scan something was as it must not be.
    """

    @how
    @given(stories())
    def run(story: Story) -> None:
        rig.run(story)

    run()


def test_nothing_forbidden_is_on_and_no_invariant_is_lost_whatever_happens() -> None:
    """Given the rare turns and five hundred stories drawn at random, every scan of them is as it must be."""
    rig = Rig(MACHINE)
    for story in (story for side in SIDES for story in rare(side).values()):
        rig.run(Story(follows=True, seed=1, acts=[*story]))
    search(rig, settings(SEARCH, derandomize=True))
    assert {*State, *Mode, *STEPS} - rig.visited == set()
    assert rig.checked > 100_000


@pytest.mark.nightly
@pytest.mark.timeout(1_800)
def test_ten_thousand_stories_drawn_anew_every_time() -> None:
    search(Rig(MACHINE), settings(SEARCH, max_examples=10_000))


def by_hand(side: Side, *jogs: str) -> Story:
    """Return a story of hands that jog an empty arm at home, one output after another."""
    home = (WORK, Await(MACHINE.cycles[side]["wait at feed"], 600), GoOn(Mode.MANUAL, (), AT_ONCE))
    return Story(follows=True, seed=1, acts=[*home, *(Renew(f"jog_{jog}", 6) for jog in jogs)])


@pytest.mark.parametrize(
    ("rule", "jogs", "broken"),
    [
        ("left: inward ready", ["left_claws_close", "left_slide_inward"], "left: inward, claws not open"),
        ("left: down at feed only", ["left_slide_inward", "left_lift_extend"], "left: down away from feed"),
        ("left: outward clear", ["left_slide_inward", "left_lift_retract", "left_slide_outward"], "left: outward low"),
        ("left: spread up at feed", ["left_spread"], "left: spread, not up at feed"),
        ("left: clamp at a place", ["left_slide_inward", "left_claws_close"], "left: close nowhere"),
        ("tray: arms at feed", ["left_slide_inward", "tray_run"], "tray, arm away from feed"),
    ],
)
def test_with_an_interlock_taken_out_hands_break_a_requirement(rule: str, jogs: list[str], broken: str) -> None:
    """Given one rule less, the rig names what it had prevented; with all of them the same hands do no harm."""
    story = by_hand("left", *jogs)
    Rig(MACHINE).run(story)
    with pytest.raises(AssertionError, match=broken):
        Rig(build(MACHINE.io_map, without=[rule])).run(story)


def test_with_an_interlock_taken_out_stories_drawn_at_random_find_it() -> None:
    rig = Rig(build(MACHINE.io_map, without=["left: no fault of the arm"]))
    with pytest.raises(AssertionError, match="left: coil with a fault"):
        search(rig, settings(SEARCH, derandomize=True, phases=[Phase.generate]))
