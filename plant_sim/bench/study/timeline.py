"""What every sequence did and when: the steps of a run as stretches of time, each resolved to the motion it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from controller.program.tags import ROWS, SIDES, Side
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.twin import SCAN_MS, Twin

ARM: Final[Mapping[Side, str]] = {"left": "left arm", "right": "right arm"}
"""Name of an arm's sequence."""
CUPS: Final[Mapping[Side, str]] = {"left": "left cups", "right": "right cups"}
"""Name of a row's carousel, which no sequence moves."""
FEEDER: Final = "tray feeder"
CUP_WAIT: Final = "wait for cups"
RELEASING: Final = ("release delay", "open claws")
"""The first of these begins on the cup edge over which a row is thrown.

A step that is entered and left in one scan is seen by nobody: the release delay where it is set to none, the wait for
cups where the edge comes as the arm arrives.
"""

Kind = Literal["moves", "dwells", "waits"]


@dataclass(frozen=True, slots=True)
class Motion:
    """What a step is for whoever looks at the machine.

    Attributes:
        name: The motion, dwell or wait.
        device: What makes it.
        kind: Whether it moves something, takes a fixed time, or waits for something else.
    """

    name: str
    device: str
    kind: Kind


ARM_MOTIONS: Final[Mapping[str, Motion]] = {
    "wait at feed": Motion("wait at feed", "program", "waits"),
    "approach row": Motion("slide in", "slide", "moves"),
    "settle at row": Motion("settle at row", "slide", "dwells"),
    "return to row": Motion("slide back", "slide", "moves"),
    "close claws": Motion("clamp", "claws", "dwells"),
    "lift from row": Motion("lift up", "lift", "moves"),
    "slide to feed": Motion("slide out", "slide", "moves"),
    "pause at feed": Motion("pause at feed", "pause", "dwells"),
    "spread": Motion("spread", "belt", "moves"),
    "wait to lower": Motion("wait to lower", "program", "waits"),
    "lower over cups": Motion("lift down", "lift", "moves"),
    "wait for cups": Motion("wait for cups", "program", "waits"),
    "release delay": Motion("release delay", "claws", "dwells"),
    "open claws": Motion("release", "claws", "dwells"),
    "raise empty": Motion("lift up empty", "lift", "moves"),
    "converge": Motion("converge", "belt", "moves"),
    "lower empty": Motion("lift down empty", "lift", "moves"),
    "park": Motion("park", "lift", "moves"),
    "parked": Motion("parked", "program", "waits"),
}
"""Motion of every step of an arm's cycle."""

FEEDER_MOTIONS: Final[Mapping[str, Motion]] = {
    "wait for an empty tray": Motion("wait for an empty tray", "program", "waits"),
    "move tray out": Motion("tray out", "conveyor", "moves"),
    "index": Motion("tray index", "conveyor", "moves"),
    "met in the index": Motion("tray met in the index", "conveyor", "dwells"),
    "creep": Motion("tray creep", "conveyor", "moves"),
    "no tray": Motion("no tray", "program", "waits"),
    "settle": Motion("tray settle", "conveyor", "dwells"),
}
"""Motion of every step of the tray feeder."""

MOTIONS: Final[Mapping[str, Mapping[str, Motion]]] = {
    **dict.fromkeys(ARM.values(), ARM_MOTIONS),
    FEEDER: FEEDER_MOTIONS,
}
"""Motion of every step, by sequence."""


def motion_of(who: str, step: str) -> Motion:
    """Return the motion that a step is.

    Raises:
        StudyError: the step has no name here.
    """
    motion = MOTIONS.get(who, {}).get(step)
    if motion is None:
        raise StudyError(f"{who}: step {step!r} is no known motion; name it in plant_sim/bench/study/timeline.py")
    return motion


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time during which a sequence was in one step.

    Attributes:
        who: The sequence.
        step: Title of the step.
        from_ms: Time of the scan that turned it on, ms.
        to_ms: Time of the scan that turned the next one on, ms.
    """

    who: str
    step: str
    from_ms: int
    to_ms: int


@dataclass(frozen=True, slots=True)
class Throw:
    """A row of seedlings released over the cups.

    Attributes:
        side: Arm.
        row: Row of the tray they came from, 1 to 3.
        at_ms: Time of the cup edge that released them, ms.
    """

    side: Side
    row: int
    at_ms: int


@dataclass(frozen=True)
class Timeline:
    """A run.

    Attributes:
        stretches: By sequence, in order; from one to the next there is no gap while the sequence is at work.
        centre: By arm, when it had the space inward of pick 2: since when, until when, ms.
        cups_ms: By arm, when each of its cups was counted, ms.
        approaches: By arm, the row that it set out for at a time, ms.
        releases_ms: By arm, the times of the cup edges on which it released: since the last its cups are counted, ms.
        throws: By arm, the releases of rows that it had taken; a first start assumes a load of no row.
    """

    stretches: Mapping[str, tuple[Stretch, ...]]
    centre: Mapping[Side, tuple[tuple[int, int], ...]]
    cups_ms: Mapping[Side, tuple[int, ...]]
    approaches: Mapping[Side, Mapping[int, int]]
    releases_ms: Mapping[Side, tuple[int, ...]]
    throws: Mapping[Side, tuple[Throw, ...]]

    def before(self, who: str, at_ms: int) -> Stretch | None:
        """Return the stretch in which a sequence was until a time; None where it was in no step."""
        return next((each for each in reversed(self.stretches[who]) if each.from_ms < at_ms <= each.to_ms), None)

    def release_before(self, side: Side, at_ms: int) -> int:
        """Return the time of an arm's last release before a time, ms; 0 if there is none."""
        return next((release_ms for release_ms in reversed(self.releases_ms[side]) if release_ms < at_ms), 0)


class TimelineRecorder:
    """Records a timeline; a monitor of the twin (`Twin.watch`, or `progress` of a trial)."""

    def __init__(self) -> None:
        self._bits: dict[str, list[tuple[int, str]]] = {}
        self._on: dict[str, tuple[int, str, int]] = {}
        self._stretches: dict[str, list[Stretch]] = {}
        self._in_centre: dict[Side, int] = {}
        self._centre: dict[Side, list[tuple[int, int]]] = {side: [] for side in SIDES}
        self._cups_ms: dict[Side, list[int]] = {side: [] for side in SIDES}
        self._approaches: dict[Side, dict[int, int]] = {side: {} for side in SIDES}
        self._releases_ms: dict[Side, list[int]] = {side: [] for side in SIDES}
        self._throws: dict[Side, list[Throw]] = {side: [] for side in SIDES}
        self._last_ms = 0

    def __call__(self, twin: Twin) -> None:
        """Look at the memory after a scan."""
        if not self._bits:
            self._look_up(twin)
        now_ms, states = twin.now_ms, twin.plc.memory.S
        self._last_ms = now_ms
        for who, bits in self._bits.items():
            on = self._on.get(who)
            if on is not None and states[on[0]]:
                continue
            self._end(who, now_ms)
            # after a scan one step is on: the scan's end turns off what a transfer has left
            begun = next(((number, step) for number, step in bits if states[number]), None)
            if begun is not None:
                self._on[who] = (*begun, now_ms)
        for side in SIDES:
            self._see_arm(twin, side, now_ms)

    def timeline(self) -> Timeline:
        """Return what has been recorded, up to the scan after the last one."""
        end_ms = self._last_ms + SCAN_MS
        open_ = {who: Stretch(who, step, from_ms, end_ms) for who, (_, step, from_ms) in self._on.items()}
        stretches = {who: (*ended, *((open_[who],) if who in open_ else ())) for who, ended in self._stretches.items()}
        centre = {
            side: (*ended, *(((self._in_centre[side], end_ms),) if side in self._in_centre else ()))
            for side, ended in self._centre.items()
        }
        return Timeline(
            stretches=stretches,
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
                self._stretches[sequence.name] = []

    def _end(self, who: str, now_ms: int) -> None:
        if who in self._on:
            _, step, from_ms = self._on.pop(who)
            self._stretches[who].append(Stretch(who, step, from_ms, now_ms))

    def _see_arm(self, twin: Twin, side: Side, now_ms: int) -> None:
        """Take note of an arm's cups and rows, and of the centre."""
        tags, read = twin.machine.tags.arms[side], twin.plc.read
        if read(tags.cup):
            self._cups_ms[side].append(now_ms)
        self._see_centre(side, now_ms, is_in=bool(read(tags.in_centre)))
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
        """Title of the step before the one that is on; empty at the beginning."""
        ended = self._stretches[ARM[side]]
        return ended[-1].step if ended else ""

    def _see_centre(self, side: Side, now_ms: int, *, is_in: bool) -> None:
        if is_in:
            self._in_centre.setdefault(side, now_ms)
        elif side in self._in_centre:
            self._centre[side].append((self._in_centre.pop(side), now_ms))
