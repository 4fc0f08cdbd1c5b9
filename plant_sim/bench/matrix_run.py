"""One case of the fault matrix: a whole trial with one fault, and an operator who mends it where it stops work."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

from controller.io_map import DEFAULT_IO_MAP, IoMap, load_io_map
from controller.program.states import State
from controller.program.tags import SIDES
from plant_sim.bench.matrix_lookout import Lookout, Signal
from plant_sim.bench.monitors import keep_watch
from plant_sim.bench.recovery import clear, home_again, mend, questions
from plant_sim.bench.twin import NotReachedError, Twin
from plant_sim.crop.seedling import CELLS_ALONG, SeedlingCounts
from plant_sim.faults import FAULTS, Fault
from plant_sim.parameters import DEFAULT_MACHINE, Machine, load_machine

TRAY_LIMIT_MS = 300_000
"""Longest time allowed for a tray without rest; at 45 cups/min one takes 50 s."""
LOOK_MS = 6_000
"""How long the operator looks at a machine at rest before anything is done; every alarm at rest has come by then."""
SUSPENDED_MS = 10_000
"""A Suspended machine that could go on has done so by then."""
ROUNDS = 3
"""So often the operator tries to bring the machine back to work."""

RESTS = (State.HELD, State.ABORTED, State.STOPPED, State.SUSPENDED)
"""States in which the machine has stopped work and waits for somebody."""


@dataclass
class Outcome:
    """What came of a case.

    Attributes:
        fault: What broke.
        signal: What told first; None: nothing did.
        state: PackML state in which the machine came to rest, or ended; its name.
        trips: What the monitors found, by kind.
        asked: What the operator was asked.
        in_doubt: Seedlings of the rows and trays asked about.
        away: Arms without an alarm that were not at feed when the machine was Held.
        rounds: How often the operator had to bring it back to work.
        counts: Where the seedlings are at the end.
        lost: Seedlings that are lost or left behind beyond those of an undisturbed run.
        passed: Whether a tray went through the machine unseen, and the operator ended the trial without it.
        reason: Why the trial was not completed, or does not count its trays and rows once; empty if all is well.
    """

    fault: Fault
    counts: SeedlingCounts
    lost: int
    signal: Signal | None = None
    state: str = ""
    trips: dict[str, str] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    in_doubt: int = 0
    away: list[str] = field(default_factory=list)
    rounds: int = 0
    passed: bool = False
    reason: str = ""

    @property
    def recovered(self) -> bool:
        """Whether the trial was completed, everything in it counted once, and nothing left in trays or claws."""
        return not self.reason and not self.left

    @property
    def left(self) -> int:
        """Seedlings left in trays or claws."""
        return self.counts.in_tray + self.counts.in_claw


@dataclass(frozen=True, slots=True)
class Setting:
    """What every case of a matrix has in common.

    Attributes:
        seed: Seed of the plant.
        trays: Trays of a trial, 72 seedlings each.
        io_map: File of the wires.
        machine: File of the parameters.
    """

    seed: int = 1
    trays: int = 2
    io_map: Path = DEFAULT_IO_MAP
    machine: Path = DEFAULT_MACHINE

    def twin(self, *faults: Fault) -> Twin:
        """Switch a machine on.

        Raises:
            IoMapError: the wires cannot be used.
            MachineError: the parameters cannot.
        """
        twin = Twin(
            seed=self.seed,
            trays=self.trays,
            io_map=_io_map(self.io_map),
            parameters=_machine(self.machine),
            set_points={"trays_target": self.trays},
            faults=faults,
        )
        twin.plant.seedlings.make_typical()  # whatever is lost is lost to the fault
        return twin


@cache
def _io_map(path: Path) -> IoMap:
    return load_io_map(path)


@cache
def _machine(path: Path) -> Machine:
    return load_machine(path)


class Undisturbed(NamedTuple):
    """A trial without a fault.

    Attributes:
        begins_ms: When it goes to Execute, ms.
        ends_ms: When it is Complete, ms.
        counts: Where the seedlings are.
        cycles: Rows thrown.
    """

    begins_ms: int
    ends_ms: int
    counts: SeedlingCounts
    cycles: int


@cache
def undisturbed(setting: Setting) -> Undisturbed:
    """Run a trial without a fault."""
    twin = setting.twin()
    twin.home()
    twin.start()
    begins_ms = twin.now_ms
    twin.run_until_state(State.COMPLETE, within_ms=setting.trays * TRAY_LIMIT_MS)
    return Undisturbed(begins_ms, twin.now_ms, twin.plant.counts(), thrown(twin))


def thrown(twin: Twin) -> int:
    """Return how many rows the program says it has thrown."""
    return sum(twin.plc.read(twin.machine.tags.arms[side].cycles) for side in SIDES)


def run_case(fault: Fault, setting: Setting) -> Outcome:
    """Let a fault strike in a trial, and the operator bring the machine back wherever it stops.

    Args:
        fault: What breaks, and when; it stays until it is mended.
        setting: Machine and trial.
    """
    lasts = FAULTS[fault.kind].lasts
    twin = setting.twin(fault) if lasts else setting.twin()
    outcome = Outcome(fault, twin.plant.counts(), 0, trips=keep_watch(twin))
    lookout = Lookout(twin, fault.start_ms)
    if not lasts:
        twin.plant.faults.add(fault)
    try:
        twin.home()
        twin.start()
        _work(twin, outcome, setting.trays)
    except NotReachedError as error:
        outcome.reason = str(error)
    outcome.signal = lookout.signal
    outcome.state = outcome.state or twin.state.name
    _account(twin, outcome, undisturbed(setting), setting.trays)
    return outcome


def _work(twin: Twin, outcome: Outcome, trays: int) -> None:
    """Run to Complete, with the operator's help where the machine comes to rest.

    Raises:
        NotReachedError: it does not come there.
    """
    while True:
        twin.run_until(
            lambda: twin.state in RESTS or twin.state is State.COMPLETE,
            within_ms=trays * TRAY_LIMIT_MS,
            what="Complete, or rest",
        )
        if twin.state is State.COMPLETE:
            return
        outcome.state = outcome.state or twin.state.name
        outcome.rounds += 1
        if outcome.rounds > ROUNDS:
            raise NotReachedError(f"stopped again and again; {twin.situation()}")
        _help(twin, outcome)


def _help(twin: Twin, outcome: Outcome) -> None:
    """Look, mend, clear, answer, home and start.

    Raises:
        NotReachedError: the machine does not go on.
    """
    if twin.state is State.HELD:
        outcome.away += away_from_feed(twin)
    twin.run_for(LOOK_MS)
    _look(twin, outcome)
    if any(fault.name == outcome.fault.name for fault in twin.plant.faults.active):
        mend(twin, outcome.fault)
    if twin.state is State.SUSPENDED:
        conveyor = twin.plant.conveyor
        if not conveyor.front_m and not conveyor.in_magazine:
            outcome.passed = True
            twin.command("complete")
            twin.run_until_state(State.COMPLETE, within_ms=TRAY_LIMIT_MS)
            return
        twin.press("start")
        twin.run_until(lambda: twin.state is not State.SUSPENDED, within_ms=SUSPENDED_MS, what="work")
        return
    if twin.state is State.ABORTED:
        clear(twin)
    _look(twin, outcome)
    for question in home_again(twin):
        _note(twin, outcome, question)
    twin.start()


def away_from_feed(twin: Twin) -> list[str]:
    """Return the arms that have no alarm of their own and are not at feed."""
    feed_m = twin.parameters.handling.feed_tolerance_m
    arms = twin.machine.tags.arms
    return [side for side in SIDES if not twin.plc.read(arms[side].fault) and twin.plant.arms[side].slide.x_m > feed_m]


def _look(twin: Twin, outcome: Outcome) -> None:
    for question in questions(twin):
        _note(twin, outcome, question)


def _note(twin: Twin, outcome: Outcome, question: str) -> None:
    """Take note of a question, and of the seedlings it is about."""
    if question not in outcome.asked:
        outcome.asked.append(question)
        outcome.in_doubt += twin.plant.counts().in_tray if question == "tray" else CELLS_ALONG


def _account(twin: Twin, outcome: Outcome, sound: Undisturbed, trays: int) -> None:
    """Count everything, once, and compare with the undisturbed trial."""
    counts = outcome.counts = twin.plant.counts()
    outcome.lost = (counts.total - counts.in_cups) - (sound.counts.total - sound.counts.in_cups)
    if outcome.reason or outcome.passed:
        return
    complaints = []
    if (done := twin.plc.read(twin.machine.tags.machine.trays_done)) != trays:
        complaints.append(f"{done} trays counted, not {trays}")
    if (rows := thrown(twin)) != sound.cycles:
        complaints.append(f"{rows} rows counted, not {sound.cycles}")
    outcome.reason = "; ".join(complaints)
