"""Coverage of random stories: states of the machine, steps of its sequences, and kinds of fault that acted in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from controller.core.expr import Bit, Word
from controller.program.machine import Transplanter
from controller.program.states import State
from plant_sim.stories.drawn.action import Deed
from plant_sim.twin.lock_step import Twin

NO_STEP: Final = -1


class StepInState(NamedTuple):
    """Active step in a PackML state.

    Attributes:
        state: PackML state number.
        step: Number of the S bit of the step; `NO_STEP` if no step is active, as at rest.
    """

    state: int
    step: int


class Triple(NamedTuple):
    """Kind of fault that was active after a scan in a state with a step.

    Attributes:
        place: State and step.
        kind: Kind of fault.
    """

    place: StepInState
    kind: str


class CoverageWatch:
    """Observer of the coverage of one story.

    Attributes:
        triples: States, steps and kinds of fault that have coincided.
        seen: States and steps that have coincided.
        times: First time of each since the last call of `begin`, ms.
    """

    def __init__(self, twin: Twin) -> None:
        self.triples: set[Triple] = set()
        self.seen: set[StepInState] = set()
        self.times: dict[StepInState, int] = {}
        self._twin = twin
        self._steps = [bit.number for bit in steps_of(twin.machine)]
        devices: list[Bit | Word] = [*steps_of(twin.machine), twin.machine.tags.machine.state]
        twin.watch(self.look, devices=devices)

    def begin(self) -> None:
        """Forget the times so far."""
        self.times.clear()
        self.look(self._twin)

    def look(self, twin: Twin) -> None:
        """Record the present state, steps and faults; called after scans and after the start of a fault."""
        memory = twin.plc.memory.S
        state = int(twin.plc.read(twin.machine.tags.machine.state))
        kinds = [fault.kind for fault in twin.plant.faults.active]
        for step in [step for step in self._steps if memory[step]] or [NO_STEP]:
            place = StepInState(state, step)
            self.seen.add(place)
            self.times.setdefault(place, twin.now_ms)
            self.triples.update(Triple(place, kind) for kind in kinds)


def steps_of(machine: Transplanter) -> list[Bit]:
    """Return the S bits of all steps of the program."""
    return [bit for sequence in machine.program.sequences() for bit, _ in sequence]


class Coverage:
    """Coverage of several stories.

    The denominator is every state times every step, or none, times every kind of fault, whether they can coincide or
    not.

    Attributes:
        triples: Triples reached, with the number of stories that reached each.
        places: States and steps reached.
        acted: Number of actions that had an effect, by kind of fault or action.
        kinds: Kinds of fault that the machine can have.
        possible: Number of triples.
    """

    def __init__(self, machine: Transplanter, kinds: Iterable[str]) -> None:
        self.triples: Counter[Triple] = Counter()
        self.places: set[StepInState] = set()
        self.acted: Counter[str] = Counter()
        self.kinds = tuple(kinds)
        self.possible = len(State) * (1 + len(steps_of(machine))) * len(self.kinds)

    def add(self, triples: Iterable[Triple], places: Iterable[StepInState], acted: Mapping[str, int]) -> int:
        """Add a story; return the number of triples that no story had reached before."""
        before = len(self.triples)
        self.triples.update(triples)
        self.places.update(places)
        self.acted.update(acted)
        return len(self.triples) - before

    @property
    def share(self) -> float:
        """Share of the possible triples that were reached."""
        return len(self.triples) / self.possible

    @property
    def share_of_reached(self) -> float:
        """Share of the triples that were reached, of those in the states and steps that any story has reached."""
        return len(self.triples) / (len(self.places) * len(self.kinds)) if self.places else 0.0

    @property
    def never(self) -> tuple[str, ...]:
        """Kinds of fault and of action that never had an effect."""
        kinds = (*self.kinds, *(deed.value for deed in Deed if deed is not Deed.FAULT))
        return tuple(kind for kind in kinds if not self.acted[kind])
