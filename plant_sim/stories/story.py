"""Story on the twin, what is observed in it, and the comparison of two observations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from controller.core.expr import Bit, Word
from controller.program.machine import Transplanter
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.faults import FaultError
from plant_sim.machine.parameters import Machine
from plant_sim.twin.lock_step import NotReachedError, Twin
from plant_sim.twin.monitors import collect_violations

TIME_SHARE: Final = 0.1
TIME_MS: Final = 200
"""A part of a story has another duration if it differs by more than this time and this share; assumed: twice the
longest delay of an input, and less than the effect of a time preset that is doubled or halved on the longest part."""
MEASURED_SHARE: Final = 0.05
MEASURED: Final = 2
"""A measured register differs if it differs by more than this number and this share; assumed."""
_TIMES: Final = frozenset({"at_ms", "cycle_ms", "waiting_ms"})


@dataclass(frozen=True, slots=True)
class Part:
    """End of a part of a story.

    Attributes:
        name: Name of the part.
        ends_ms: Time, ms.
        shown: Values that a panel shows: registers, questions and outputs, by name.
        measured: Registers that contain measured times and speeds, by name.
    """

    name: str
    ends_ms: int
    shown: Mapping[str, int]
    measured: Mapping[str, int]


@dataclass
class Observation:
    """Observation of a story.

    Attributes:
        parts: Completed parts.
        events: Events of the controller without their times.
        violations: Violations of the safety monitors and incidents, by kind.
        counts: Final location of the seedlings.
        stalled: Situation in which a time limit expired; empty if the story ended.
    """

    parts: list[Part] = field(default_factory=list)
    events: list[dict[str, object]] = field(default_factory=list)
    violations: Mapping[str, str] = field(default_factory=dict)
    counts: SeedlingCounts | None = None
    stalled: str = ""


class Stage:
    """Twin of a story with its observer.

    Attributes:
        twin: The twin.
        observation: Observation so far.
    """

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self.observation = Observation(violations=collect_violations(twin))
        self._shown, self._measured = _registers(twin.machine)

    def end(self, name: str) -> None:
        """Record the end of a part."""
        twin = self.twin
        shown = {device.name or str(device): int(twin.plc.read(device)) for device in self._shown}
        shown |= {f"output {tag}": 1 for tag in twin.outputs()}
        measured = {word.name: int(twin.plc.read(word)) for word in self._measured}
        self.observation.parts.append(Part(name, twin.now_ms, shown, measured))


@dataclass(frozen=True, slots=True, eq=False)
class Story:
    """Sequence of operator actions and faults.

    Attributes:
        name: Name of the story.
        play: The actions; every wait has a time limit.
        trays: Trays in the magazine.
        set_points: Initial values of set-points, by name of `SetPoints`.
        values: Parameters of the plant that differ from the default, by name.
    """

    name: str
    play: Callable[[Stage], None]
    trays: int = 1
    set_points: Mapping[str, int] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)


def observe(story: Story, machine: Transplanter, parameters: Machine) -> Observation:
    """Play a story with a program.

    Args:
        story: The story.
        machine: Program and its tags.
        parameters: Parameters of the plant.
    """
    twin = Twin(
        trays=story.trays,
        io_map=machine.io_map,
        parameters=parameters.with_values(story.values) if story.values else parameters,
        set_points={"trays_target": story.trays, **story.set_points},
        machine=machine,
        misfit=True,  # a changed program may contain any time
    )
    twin.plant.seedlings.make_typical()
    stage = Stage(twin)
    observation = stage.observation
    try:
        story.play(stage)
    except (NotReachedError, FaultError) as error:
        observation.stalled = str(error)
    except (LookupError, ValueError) as error:
        # a register of a changed program can contain a number that stands for nothing, for example of a state
        observation.stalled = f"invalid value in the program: {error!r}"
    observation.events = [
        {name: value for name, value in asdict(event).items() if name not in _TIMES} for event in twin.events
    ]
    observation.counts = twin.plant.counts()
    return observation


def difference(healthy: Observation, other: Observation) -> str:
    """Return the most severe difference between two observations of a story; empty if there is none."""
    for kind, text in other.violations.items():
        if kind not in healthy.violations:
            return f"monitor: {kind}: {text}"
    if other.stalled and not healthy.stalled:
        ended = other.parts[-1].name if other.parts else "the beginning"
        return f"time limit: after {ended}: {other.stalled}"
    if healthy.counts != other.counts:
        return f"counts: {other.counts} instead of {healthy.counts}"
    return _other_event(healthy, other) or _other_display(healthy, other) or _other_duration(healthy, other)


def _other_event(healthy: Observation, other: Observation) -> str:
    for number in range(max(len(healthy.events), len(other.events))):
        one, two = (list[Any](each.events)[number : number + 1] for each in (healthy, other))
        if one != two:
            return f"events: {_event(two)} instead of {_event(one)}"
    return ""


def _event(events: list[dict[str, Any]]) -> str:
    return ", ".join(f"{name} {value}" for name, value in events[0].items() if name != "text") if events else "none"


def _other_display(healthy: Observation, other: Observation) -> str:
    for one, two in zip(healthy.parts, other.parts, strict=False):
        for name in sorted(one.shown.keys() | two.shown.keys()):
            if one.shown.get(name, 0) != two.shown.get(name, 0):
                return (
                    f"display: after {one.name}: {name} = {two.shown.get(name, 0)} instead of {one.shown.get(name, 0)}"
                )
        for name, value in one.measured.items():
            if abs(two.measured[name] - value) > max(MEASURED, MEASURED_SHARE * abs(value)):
                return f"display: after {one.name}: {name} = {two.measured[name]} instead of {value}"
    return ""


def _other_duration(healthy: Observation, other: Observation) -> str:
    began_ms = other_began_ms = 0
    for one, two in zip(healthy.parts, other.parts, strict=False):
        lasts_ms, other_lasts_ms = one.ends_ms - began_ms, two.ends_ms - other_began_ms
        if abs(other_lasts_ms - lasts_ms) > max(TIME_MS, TIME_SHARE * lasts_ms):
            return f"duration: {one.name} takes {other_lasts_ms} ms instead of {lasts_ms} ms"
        began_ms, other_began_ms = one.ends_ms, two.ends_ms
    return ""


def _registers(machine: Transplanter) -> tuple[list[Bit | Word], list[Word]]:
    """Return the devices whose values are compared exactly, and the registers that contain measured values."""
    set_points = {word for word, _ in machine.program.set_points}
    words = {device for device in machine.program.devices() if isinstance(device, Word) and device.kind == "D"}
    measured = {word for word in words if " x" in word.name or " mm/s" in word.name}
    questions = [machine.tags.tray.ask, *(arm.ask for arm in machine.tags.arms.values())]
    exact = sorted(words - set_points - measured - {machine.tags.machine.state_before}, key=lambda word: word.number)
    return [*questions, *exact], sorted(measured - set_points, key=lambda word: word.number)
