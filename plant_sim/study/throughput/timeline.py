"""Timeline of a run: intervals of the steps of every sequence, with the motion of each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from controller.program.tags import ROWS, SIDES, Side
from plant_sim.study.errors import StudyError
from plant_sim.twin.lock_step import Twin

ARM: Final[Mapping[Side, str]] = {"left": "left arm", "right": "right arm"}
"""Name of an arm's sequence."""
CUPS: Final[Mapping[Side, str]] = {"left": "left cups", "right": "right cups"}
"""Name of the carousel on each side, which is not moved by a sequence."""
FEEDER: Final = "tray feeder"
CUP_WAIT: Final = "wait for cups"
RELEASING: Final = ("release delay", "open claws")
"""Steps after the cup edge of a throw; the first of them starts at the edge.

A step that is entered and left in one scan is not recorded. This applies to the release delay if it is zero, and to the
wait for cups if the edge occurs as the arm arrives.
"""

Kind = Literal["moves", "dwells", "waits"]


@dataclass(frozen=True, slots=True)
class StepMotion:
    """Motion of a step.

    Attributes:
        name: Name of the motion, dwell or wait.
        device: Device in motion.
        kind: A motion, a dwell of fixed duration, or a wait.
    """

    name: str
    device: str
    kind: Kind


ARM_MOTIONS: Final[Mapping[str, StepMotion]] = {
    "wait at feed": StepMotion("wait at feed", "program", "waits"),
    "approach row": StepMotion("slide in", "slide", "moves"),
    "settle at row": StepMotion("settle at row", "slide", "dwells"),
    "return to row": StepMotion("slide back", "slide", "moves"),
    "close claws": StepMotion("clamp", "claws", "dwells"),
    "lift from row": StepMotion("lift up", "lift", "moves"),
    "slide to feed": StepMotion("slide out", "slide", "moves"),
    "pause at feed": StepMotion("pause at feed", "pause", "dwells"),
    "spread": StepMotion("spread", "belt", "moves"),
    "wait to lower": StepMotion("wait to lower", "program", "waits"),
    "lower over cups": StepMotion("lift down", "lift", "moves"),
    "wait for cups": StepMotion("wait for cups", "program", "waits"),
    "release delay": StepMotion("release delay", "claws", "dwells"),
    "open claws": StepMotion("release", "claws", "dwells"),
    "raise empty": StepMotion("lift up empty", "lift", "moves"),
    "converge": StepMotion("converge", "belt", "moves"),
    "lower empty": StepMotion("lift down empty", "lift", "moves"),
    "park": StepMotion("park", "lift", "moves"),
    "parked": StepMotion("parked", "program", "waits"),
}
"""Motion of every step of an arm's cycle."""

FEEDER_MOTIONS: Final[Mapping[str, StepMotion]] = {
    "wait for an empty tray": StepMotion("wait for an empty tray", "program", "waits"),
    "move tray out": StepMotion("tray out", "conveyor", "moves"),
    "index": StepMotion("tray index", "conveyor", "moves"),
    "tray in the gap": StepMotion("tray in the gap", "conveyor", "dwells"),
    "creep": StepMotion("tray creep", "conveyor", "moves"),
    "no tray": StepMotion("no tray", "program", "waits"),
    "settle": StepMotion("tray settle", "conveyor", "dwells"),
}
"""Motion of every step of the tray feeder."""

MOTIONS: Final[Mapping[str, Mapping[str, StepMotion]]] = {
    **dict.fromkeys(ARM.values(), ARM_MOTIONS),
    FEEDER: FEEDER_MOTIONS,
}
"""Motion of every step, by sequence."""


def motion_of(sequence: str, step: str) -> StepMotion:
    """Return the motion of a step.

    Raises:
        StudyError: The step is unknown.
    """
    motion = MOTIONS.get(sequence, {}).get(step)
    if motion is None:
        raise StudyError(f"{sequence}: unknown step {step!r}; add it to plant_sim/study/throughput/timeline.py")
    return motion


@dataclass(frozen=True, slots=True)
class StepInterval:
    """Time interval that a sequence spends in one step.

    Attributes:
        sequence: The sequence.
        step: Title of the step.
        from_ms: Time of the scan that activated the step, ms.
        to_ms: Time of the scan that activated the next step, ms.
    """

    sequence: str
    step: str
    from_ms: int
    to_ms: int


@dataclass(frozen=True, slots=True)
class Throw:
    """Release of a row of seedlings over the cups.

    Attributes:
        side: Arm.
        row: Row of the tray, 1 to 3.
        at_ms: Time of the cup edge that triggers the release, ms.
    """

    side: Side
    row: int
    at_ms: int


@dataclass(frozen=True)
class Timeline:
    """Timeline of a run.

    Attributes:
        intervals: Step intervals by sequence, in order, without gaps while the sequence is active.
        centre: Start and end, ms, of the intervals in which an arm is inward of pick 2 or may pass it.
        cups_ms: Times of the counted cups by arm, ms.
        approaches: Approached rows by arm and start time, ms.
        releases_ms: Times of the cup edges that trigger the releases, by arm, ms; each release restarts the cup count.
        throws: Releases of picked rows, by arm; a release before the first pick is not included.
    """

    intervals: Mapping[str, tuple[StepInterval, ...]]
    centre: Mapping[Side, tuple[tuple[int, int], ...]]
    cups_ms: Mapping[Side, tuple[int, ...]]
    approaches: Mapping[Side, Mapping[int, int]]
    releases_ms: Mapping[Side, tuple[int, ...]]
    throws: Mapping[Side, tuple[Throw, ...]]

    def before(self, sequence: str, at_ms: int) -> StepInterval | None:
        """Return the interval of a sequence that contains a time or ends at it; None if no step was active."""
        return next((each for each in reversed(self.intervals[sequence]) if each.from_ms < at_ms <= each.to_ms), None)

    def release_before(self, side: Side, at_ms: int) -> int:
        """Return the time of the last release of an arm before the given time, ms; 0 if there is none."""
        return next((release_ms for release_ms in reversed(self.releases_ms[side]) if release_ms < at_ms), 0)


class TimelineRecorder:
    """Monitor of the twin that records a timeline."""

    def __init__(self) -> None:
        self._bits: dict[str, list[tuple[int, str]]] = {}
        self._on: dict[str, tuple[int, str, int]] = {}
        self._intervals: dict[str, list[StepInterval]] = {}
        self._in_centre: dict[Side, int] = {}
        self._centre: dict[Side, list[tuple[int, int]]] = {side: [] for side in SIDES}
        self._cups_ms: dict[Side, list[int]] = {side: [] for side in SIDES}
        self._approaches: dict[Side, dict[int, int]] = {side: {} for side in SIDES}
        self._releases_ms: dict[Side, list[int]] = {side: [] for side in SIDES}
        self._throws: dict[Side, list[Throw]] = {side: [] for side in SIDES}
        self._twin: Twin | None = None

    def attach(self, twin: Twin) -> None:
        """Record a twin from now on."""
        steps = (bit for each in twin.machine.program.sequences() if each.name in MOTIONS for bit, _ in each)
        arms = (device for arm in twin.machine.tags.arms.values() for device in (arm.cup, arm.in_centre))
        twin.watch(self, (*steps, *arms))

    def __call__(self, twin: Twin) -> None:
        """Record the steps, cups and rows after a scan, as read from the controller's memory."""
        if not self._bits:
            self._look_up(twin)
        now_ms, states = twin.now_ms, twin.plc.memory.S
        self._twin = twin
        for sequence, bits in self._bits.items():
            on = self._on.get(sequence)
            if on is not None and states[on[0]]:
                continue
            self._end(sequence, now_ms)
            # after a scan only one step is active, because the end of the scan resets the source of a transfer
            started = next(((number, step) for number, step in bits if states[number]), None)
            if started is not None:
                self._on[sequence] = (*started, now_ms)
        for side in SIDES:
            self._update_arm(twin, side, now_ms)

    def timeline(self) -> Timeline:
        """Return the timeline up to now."""
        end_ms = 0 if self._twin is None else self._twin.now_ms
        open_ = {
            sequence: StepInterval(sequence, step, from_ms, end_ms) for sequence, (_, step, from_ms) in self._on.items()
        }
        intervals = {
            sequence: (*ended, *((open_[sequence],) if sequence in open_ else ()))
            for sequence, ended in self._intervals.items()
        }
        centre = {
            side: (*ended, *(((self._in_centre[side], end_ms),) if side in self._in_centre else ()))
            for side, ended in self._centre.items()
        }
        return Timeline(
            intervals=intervals,
            centre=centre,
            cups_ms={side: tuple(times) for side, times in self._cups_ms.items()},
            approaches={side: dict(rows) for side, rows in self._approaches.items()},
            releases_ms={side: tuple(times) for side, times in self._releases_ms.items()},
            throws={side: tuple(throws) for side, throws in self._throws.items()},
        )

    def _look_up(self, twin: Twin) -> None:
        for sequence in twin.machine.program.sequences():
            if sequence.name in MOTIONS:
                self._bits[sequence.name] = [(bit.number, step.title) for bit, step in sequence]
                self._intervals[sequence.name] = []

    def _end(self, sequence: str, now_ms: int) -> None:
        if sequence in self._on:
            _, step, from_ms = self._on.pop(sequence)
            self._intervals[sequence].append(StepInterval(sequence, step, from_ms, now_ms))

    def _update_arm(self, twin: Twin, side: Side, now_ms: int) -> None:
        """Record the cups and rows of an arm, and its time in the centre."""
        tags, read = twin.machine.tags.arms[side], twin.plc.read
        if read(tags.cup):
            self._cups_ms[side].append(now_ms)
        self._update_centre(side, now_ms, is_in=bool(read(tags.in_centre)))
        _, step, from_ms = self._on.get(ARM[side], (0, "", -1))
        if from_ms != now_ms:
            return
        if step == "approach row":
            self._approaches[side][now_ms] = next(row for row in ROWS if read(tags.row_is[row]))
        elif step in RELEASING and self._step_before(side) not in (*RELEASING, ""):
            self._releases_ms[side].append(now_ms)
            if self._approaches[side]:
                self._throws[side].append(Throw(side, list(self._approaches[side].values())[-1], now_ms))

    def _step_before(self, side: Side) -> str:
        """Return the title of the step before the active one; empty at the start."""
        ended = self._intervals[ARM[side]]
        return ended[-1].step if ended else ""

    def _update_centre(self, side: Side, now_ms: int, *, is_in: bool) -> None:
        if is_in:
            self._in_centre.setdefault(side, now_ms)
        elif side in self._in_centre:
            self._centre[side].append((self._in_centre.pop(side), now_ms))
