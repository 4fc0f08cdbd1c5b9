"""Harm in a random story: found by the monitors of the plant, and told or not told by an alarm."""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import dataclass, field
from typing import Final

from controller.core.expr import any_of, evaluate
from controller.core.specification import Requirement
from controller.events.kinds import AlarmEvent, Event, StateEvent
from controller.program.machine import Transplanter
from controller.program.states import State
from plant_sim.crop.seedling import COLUMNS, Location
from plant_sim.stories.drawn.action import StoryAction
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.monitors import STOP_ALARMS, collect_violations

LOST: Final = "lost"
"""Harm: seedlings lost without an incident, or a row that was conveyed out and is not counted as left."""
NOT_RECOVERED: Final = "not_recovered"
"""Harm: an operator who mends everything does not get the machine to work again."""
REQUIREMENT: Final = "requirement "
"""Beginning of the kind of harm that is the violation of a requirement of the program."""
OF_PROGRAM: Final = ("opposite_coils", "dead_in_emergency_stop", "every_seedling_somewhere")
"""Monitors that no fault and no operator may make trip: the outputs alone decide, or the plant is wrong."""
EPISODE_MS: Final = 1_000
"""Time within which further harm belongs to the same episode, ms."""
TOLD_MS: Final = 30_000
"""Longest time from a harm to an alarm that tells it, ms: two cycles of an arm. Assumed."""
ROW_PLANTS: Final = 6
"""Least number of seedlings that make a conveyed row a lost one: half of a row."""


@dataclass
class Harm:
    """Episode of harm.

    Attributes:
        at_ms: Time of its beginning, ms.
        since_ms: Time of the last action before it, ms; an alarm since then tells it.
        kinds: Kinds of incident, names of monitors, `LOST` or `NOT_RECOVERED`, each with its description.
        acted: Actions before it that had an effect, without those of the operator who tends the machine.
        ordered: Actions with which the operator may have ordered it.
        blind: Actions whose consequences no input shows.
        alarms: Alarms, or reasons for the Suspended state, that tell it.
    """

    at_ms: int
    since_ms: int
    kinds: dict[str, str] = field(default_factory=dict)
    acted: tuple[StoryAction, ...] = ()
    ordered: tuple[StoryAction, ...] = ()
    blind: tuple[StoryAction, ...] = ()
    alarms: tuple[str, ...] = ()

    @property
    def is_violation(self) -> bool:
        """True if a requirement of the program was violated."""
        return self.is_of_requirement or any(kind in OF_PROGRAM for kind in self.kinds)

    @property
    def is_of_requirement(self) -> bool:
        """True if only proved requirements were violated, which assume that the memory is the one last stored."""
        kinds = [kind for kind in self.kinds if kind in OF_PROGRAM or kind.startswith(REQUIREMENT)]
        return bool(kinds) and all(kind.startswith(REQUIREMENT) for kind in kinds)

    @property
    def text(self) -> str:
        """Kinds and time in one line."""
        return f"{', '.join(sorted(self.kinds))} at {self.at_ms / 1000:.1f} s"


class HarmWatch:
    """Observer of the harm on a twin.

    Attributes:
        harms: Episodes so far.
        acted_ms: Time of the latest action, ms; set by the player of the story.
    """

    def __init__(self, twin: Twin, taken_off: Set[int], requirements: Iterable[Requirement] = ()) -> None:
        """Attach the monitors.

        Args:
            twin: The twin.
            taken_off: Trays that a person has taken off the belt, whose rows are not lost; may grow.
            requirements: Requirements of the program, if it contains their monitors.
        """
        self.harms: list[Harm] = []
        self.acted_ms = 0
        self._taken_off = taken_off
        self._twin = twin
        self._requirements = tuple(requirements)
        self._trips = collect_violations(twin)
        self._lost = 0
        self._trays = self._on_belt()
        self._rows_left = self._unaccounted = 0
        if self._requirements:
            twin.when(any_of(*(each.never for each in self._requirements)), self._violated)
        twin.watch(self._update, devices=[twin.machine.tags.machine.rows_left])

    def note(self, kind: str, text: str) -> None:
        """Record a harm at this time."""
        now_ms = self._twin.now_ms
        if not self.harms or now_ms - self.harms[-1].at_ms > EPISODE_MS:
            active = (_telling(number, self._twin.machine) for number in self._twin.plc.annunciators())
            self.harms.append(Harm(now_ms, self.acted_ms, alarms=tuple(filter(None, active))))
        self.harms[-1].kinds.setdefault(kind, text)

    def finish(self) -> None:
        """Record the rows that were conveyed out without being counted, once the tray has left for certain."""
        self._update(self._twin)
        if self._unaccounted >= 1:
            self.note(LOST, f"{self._unaccounted} rows conveyed out that are not counted as left")
            self._unaccounted = 0

    def _violated(self) -> None:
        for each in self._requirements:
            if evaluate(each.never, self._twin.plc.memory):
                self.note(f"{REQUIREMENT}{each.name}", each.reason)

    def _update(self, twin: Twin) -> None:
        for kind, text in self._trips.items():
            self.note(kind, text)
        self._trips.clear()
        counts = twin.plant.counts()
        lost = counts.P + counts.D + counts.T
        if lost > self._lost:
            self.note(LOST, f"{lost - self._lost} seedlings lost")
        self._lost = lost
        self._account_trays()

    def _account_trays(self) -> None:
        """Compare the full rows of trays that have left the belt with those that the program counts as left."""
        twin, there = self._twin, self._on_belt()
        for number in self._trays - there - self._taken_off:
            self._unaccounted += sum(self._is_full(number, column) for column in range(COLUMNS))
        self._trays = there
        rows_left = twin.plc.read(twin.machine.tags.machine.rows_left)
        self._unaccounted -= max(0, rows_left - self._rows_left)
        self._rows_left = rows_left

    def _is_full(self, number: int, column: int) -> bool:
        plants = self._twin.plant.seedlings.column(number, column)
        return sum(each.location is Location.STANDING for each in plants) >= ROW_PLANTS

    def _on_belt(self) -> set[int]:
        return {*self._twin.plant.conveyor.front_m}


def tell(harms: Iterable[Harm], events: Iterable[Event], machine: Transplanter) -> None:
    """Add to each harm the alarms and suspensions that tell it."""
    signals = [signal for event in events if (signal := _signal(event, machine)) is not None]
    for harm in harms:
        until_ms = harm.at_ms + TOLD_MS
        told = [name for at_ms, name in signals if harm.since_ms <= at_ms <= until_ms]
        harm.alarms = (*dict.fromkeys((*harm.alarms, *told)),)


def _signal(event: Event, machine: Transplanter) -> tuple[int, str] | None:
    if isinstance(event, AlarmEvent) and event.active:
        name = _telling(event.number, machine)
        return (event.at_ms, name) if name else None
    if isinstance(event, StateEvent) and event.state == State.SUSPENDED and event.reason.en:
        return event.at_ms, f"suspended: {event.reason.en}"
    return None


def _telling(number: int, machine: Transplanter) -> str:
    """Return the name of an alarm that tells of a harm; empty for a warning and for the alarm of a stop itself."""
    alarm = machine.alarms.of(number)
    if not alarm.stops_work or alarm.key in STOP_ALARMS:
        return ""
    return f"{alarm.side}: {alarm.key}" if alarm.side else alarm.key
