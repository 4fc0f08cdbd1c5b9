"""Play of a random story on the twin: its actions, then an operator who mends everything and goes on."""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Final

from controller.core.expr import any_of
from controller.core.specification import Specification
from controller.program.machine import Transplanter
from controller.program.requirements.proof import specification
from controller.program.states import Mode, Reason, State
from plant_sim.faults import FAULTS, Fault, FaultError
from plant_sim.machine.parameters import Machine
from plant_sim.stories.drawn.action import Deed, RandomStory, StoryAction
from plant_sim.stories.drawn.coverage import CoverageWatch, StepInState, Triple
from plant_sim.stories.drawn.hands import RESTS, Hands
from plant_sim.stories.drawn.harm import NOT_RECOVERED, Harm, HarmWatch, tell
from plant_sim.twin.lock_step import CLEAR_MS, SCAN_MS, NotReachedError, Twin
from plant_sim.twin.recovery import affected_cylinders, clear, press_emergency_stop, repair

SPEED_PER_MIN: Final = 60.0
"""Speed of the tractor at the beginning and after the last action, cups per minute: faster than usual, so that a story
is short."""
LAST_MS: Final = 3_000
"""Time from the last action to the first look of the operator, ms."""
ROUNDS: Final = 12
"""Number of things that the operator does after the last action before the machine counts as not recovered."""
HOMING_MS: Final = 40_000
FINISH_MS: Final = 60_000
"""Time of work after the recovery, ms: a tray takes 40 s."""
SETTLE_MS: Final = 500


@dataclass
class PlayedStory:
    """Observation of a random story.

    Attributes:
        story: The story.
        harms: Episodes of harm.
        triples: Coverage.
        places: States and steps reached.
        times: First time of each after the work before the first action, ms.
        acted: Number of actions that had an effect, by kind of fault or action.
        crash: Exception of program or plant, in one line; empty if there was none.
        ends_ms: Simulated time at the end, ms.
    """

    story: RandomStory
    harms: list[Harm] = field(default_factory=list)
    triples: set[Triple] = field(default_factory=set)
    places: set[StepInState] = field(default_factory=set)
    times: dict[StepInState, int] = field(default_factory=dict)
    acted: Counter[str] = field(default_factory=Counter)
    crash: str = ""
    ends_ms: int = 0


class StoryPlayer:
    """Player of random stories with one program and one machine.

    Attributes:
        machine: The program with the monitors of its requirements, and its tags.
    """

    def __init__(self, machine: Transplanter, parameters: Machine) -> None:
        """Prepare the program.

        Args:
            machine: Program and its tags.
            parameters: Parameters of the plant.
        """
        self._specification = specification(machine)
        self.machine = replace(machine, program=self._specification.watched)
        self._parameters = parameters.with_values({"cups.planting_frequency_per_min": SPEED_PER_MIN})

    def play(self, story: RandomStory) -> PlayedStory:
        """Play a story; an exception of program or plant ends it and is reported in the result.

        Raises:
            FaultError: A fault of the story is not possible in this plant.
        """
        permanent = [
            action.fault(0) for action in story.actions if action.deed is Deed.FAULT and FAULTS[action.kind].permanent
        ]
        twin = Twin(
            seed=story.seed,
            trays=story.trays,
            io_map=self.machine.io_map,
            parameters=self._parameters,
            set_points={"trays_target": story.trays},
            machine=self.machine,
            misfit=True,
            faults=_first_of_each_target(permanent),
        )
        twin.plant.seedlings.make_typical()
        played = PlayedStory(story)
        run = _Run(twin, played, self._specification)
        try:
            run.work()
        except NotReachedError as error:  # the machine does not start, or has no air
            run.note_stuck(str(error))
        except Exception as error:  # noqa: BLE001 - whatever the program or the plant raises is a finding
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{last.filename.rpartition('/')[2]}:{last.lineno}"
            played.crash = f"{type(error).__name__} in {where}: {error}".splitlines()[0]
        run.close()
        return played


class _Run:
    def __init__(self, twin: Twin, played: PlayedStory, spec: Specification) -> None:
        self._twin, self._played = twin, played
        self._hands = Hands(twin, spec.remembered)
        self._harm = HarmWatch(twin, self._hands.taken_off, spec.requirements)
        self._coverage = CoverageWatch(twin)
        self._begins_ms = self._attributed = 0

    def work(self) -> None:
        story, twin = self._played.story, self._twin
        twin.scan()
        if story.work_ms:
            twin.home()
            twin.start()
            twin.run_for(story.work_ms)
        self._begins_ms = twin.now_ms
        self._coverage.begin()
        for action in story.actions:
            self._run_to(self._begins_ms + action.at_ms)
            self._attribute()
            self._act(action)
        self._run_to(twin.now_ms + LAST_MS)
        self._attribute()
        self._recover()
        self._harm.finish()
        self._attribute()

    def _act(self, action: StoryAction) -> None:
        """Carry out an action, and complete the scan after it."""
        twin, harm = self._twin, self._harm
        if action.deed is not Deed.TEND:
            harm.acted_ms = twin.now_ms
        harms = len(harm.harms)
        try:
            acted = self._hands.do(action)
        except (NotReachedError, FaultError):
            acted = False
        twin.scan()
        self._coverage.look(twin)
        self._played.acted[action.kind] += acted
        self._attribute()
        if action.deed is Deed.PUSH:  # the person sees at once what the tray does
            for each in harm.harms[harms:]:
                each.ordered = (*each.ordered, action)

    def note_stuck(self, situation: str) -> None:
        """Record that the machine does not work again."""
        self._harm.note(NOT_RECOVERED, situation)
        self._attribute()

    def close(self) -> None:
        """Complete the observation."""
        played, twin = self._played, self._twin
        tell(self._harm.harms, twin.events, twin.machine)
        played.harms = self._harm.harms
        played.triples = self._coverage.triples
        played.places = self._coverage.seen
        played.times = {place: at_ms - self._begins_ms for place, at_ms in self._coverage.times.items()}
        played.ends_ms = twin.now_ms

    def _run_to(self, until_ms: int) -> None:
        """Run to a time; a reported condition ends at its time."""
        twin, hands = self._twin, self._hands
        while twin.now_ms < until_ms:
            end_ms = hands.next_end_ms()
            stop_ms = until_ms if end_ms is None else min(until_ms, max(end_ms, twin.now_ms + SCAN_MS))
            twin.run_for(max(SCAN_MS, stop_ms - twin.now_ms))
            hands.end_statuses(by_ms=twin.now_ms)

    def _attribute(self) -> None:
        """Note, for the harms since the last call, the actions before them."""
        hands = self._hands
        for harm in self._harm.harms[self._attributed :]:
            harm.acted, harm.ordered, harm.blind = (*hands.acted,), (*hands.ordered,), (*hands.blind,)
        self._attributed = len(self._harm.harms)

    def _recover(self) -> None:
        """Mend everything and go on as an operator does; record if the machine does not work again."""
        twin, word = self._twin, self._twin.machine.tags.machine.state
        self._mend_everything()
        rest = any_of(*(word.equals(state) for state in RESTS))
        works = word.equals(State.EXECUTE)
        left_ms = FINISH_MS
        for _ in range(ROUNDS):
            if self._works():
                since_ms = twin.now_ms
                twin.runs_until(rest, for_ms=left_ms)
                left_ms -= twin.now_ms - since_ms
            if left_ms <= 0 or self._is_done():
                return
            try:
                self._hands.tend()
            except NotReachedError:
                continue
            twin.run_for(CLEAR_MS + SETTLE_MS if twin.plant.box.stop else SETTLE_MS)
            twin.runs_until(rest | works, for_ms=HOMING_MS)
        if not (self._works() or self._is_done()):
            self.note_stuck(twin.situation())

    def _mend_everything(self) -> None:
        """End every fault and reported condition, release the buttons, and return both arms to service."""
        twin, box = self._twin, self._twin.plant.box
        self._hands.end_statuses()
        box.start = box.stop = False
        twin.plant.planting_frequency_per_min = SPEED_PER_MIN
        twin.run_for(SETTLE_MS)
        struck = [fault for fault in twin.plant.faults.activated if not FAULTS[fault.kind].permanent]
        last = [fault for fault in twin.plant.faults.active if not FAULTS[fault.kind].permanent][-1:]
        for fault in [*twin.plant.faults.active]:
            if not FAULTS[fault.kind].permanent and fault not in last:
                twin.plant.faults.clear(fault.name)
        for fault in last:  # waits for the pressure, which any of the others may have taken away
            repair(twin, fault)
        for device in (device for fault in struck for device in affected_cylinders(twin, fault)):
            device.place(device.position_m)
        self._return_to_service()

    def _return_to_service(self) -> None:
        """Return the arms to service; an arm that is out of service is returned in Stopped, after an emergency stop."""
        twin, arms = self._twin, self._twin.machine.tags.arms
        if any(twin.plc.read(arm.out_of_service) for arm in arms.values()) and twin.state is not State.STOPPED:
            press_emergency_stop(twin)
            with suppress(NotReachedError):  # a button or its contact is stuck
                clear(twin)
        for side in arms:
            twin.command(f"{side}_in_service")
            twin.scan()

    def _works(self) -> bool:
        machine = self._twin.machine.tags.machine
        return self._twin.state is State.EXECUTE and self._twin.plc.read(machine.mode) == Mode.CONTINUOUS

    def _is_done(self) -> bool:
        """Return True if the machine has completed its trays, or waits for a tray that is not there."""
        twin = self._twin
        if twin.state is State.SUSPENDED:
            conveyor = twin.plant.conveyor
            no_tray = twin.plc.read(twin.machine.tags.machine.reason) == Reason.NO_TRAY
            return no_tray and not conveyor.front_m and not conveyor.in_magazine
        return twin.state is State.COMPLETE


def _first_of_each_target(faults: Iterable[Fault]) -> list[Fault]:
    """Return the faults without those that change the same values as an earlier one."""
    return [*{fault.target: fault for fault in reversed([*faults])}.values()]
