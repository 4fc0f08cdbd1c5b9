"""End of homing: an upper bound of its duration, and its exploration from every place and memory.

The bound applies to every behaviour of the machine and its switches: each step of homing has a time limit or a fixed
time, the steps are not repeated, and invariants of the proof exclude any other wait except for an answer. The
exploration executes the program in the travel model and shows that a machine without faults does not only stop, but
arrives in Idle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Final

from controller.core.specification import PropertyResult
from controller.program.machine import Transplanter
from controller.program.requirements.homing_starts import arm_starts, situations, tray_situations
from controller.program.requirements.homing_trial import SCAN_MS, Ending, HomingStart, HomingTrial
from controller.program.requirements.time_limit import time_limit
from controller.program.requirements.travel_times import DELIVERED, TravelTimes
from controller.program.states import State
from controller.verify.bounds import UnboundedError

MOST_HOMINGS: Final = 3
"""Number of homings after which the machine must be in Idle: the first may end in a question about an arm, the second
in one about the place of the tray, the third in none."""
TRAY_SCAN_MS: Final = 10
"""Scan time while trays are fed, ms: that of the controller, because the feeder creeps in pulses of two scans."""
UNBOUNDED_MS: Final = 120_000
"""Time after which a homing without an upper bound is abandoned, ms (assumed)."""
_SHOWN: Final = 10


@dataclass
class Exploration:
    """Results of homings from many situations.

    Attributes:
        starts: Number of situations.
        homings: Number of homings.
        longest: Longest homing.
        from_situation: Start of the longest homing.
        dead_ends: Situations from which the machine does not arrive in Idle, with the ends of their homings.
    """

    starts: int = 0
    homings: int = 0
    longest: Ending | None = None
    from_situation: HomingStart | None = None
    dead_ends: list[tuple[HomingStart, tuple[Ending, ...]]] = field(default_factory=list)

    def add(self, trial: HomingTrial, situation: HomingStart) -> None:
        """Home from a situation, reply to the questions in every way, and home again."""
        self.starts += 1
        trial.begin(situation)
        self._home(trial, situation, ())

    def add_stuck(self, trial: HomingTrial, situation: HomingStart, longest_ms: int) -> None:
        """Home with a stuck switch, which must end explained and in time; repair it, and home again."""
        self.starts += 1
        self.homings += 1
        trial.begin(situation)
        ending = trial.home()
        if not ending.explained or ending.ms > longest_ms:
            self.dead_ends.append((situation, (ending,)))
        elif ending.state is not State.IDLE:
            trial.repair()
            self._reply(trial, situation, ())

    def _home(self, trial: HomingTrial, situation: HomingStart, before: tuple[Ending, ...]) -> None:
        ending = trial.home()
        self.homings += 1
        if self.longest is None or ending.ms > self.longest.ms:
            self.longest, self.from_situation = ending, situation
        if ending.state is State.IDLE:
            return
        ended = (*before, ending)
        if len(ended) == MOST_HOMINGS or ending.alarms or not ending.explained:
            self.dead_ends.append((situation, ended))
            return
        self._reply(trial, situation, ended)

    def _reply(self, trial: HomingTrial, situation: HomingStart, before: tuple[Ending, ...]) -> None:
        """Home after each reply to the questions, or at once if there is none."""
        saved = trial.save()
        for commands in list(trial.answers()) or [()]:
            trial.restore(saved)
            trial.answer(commands)
            self._home(trial, situation, before)


def explore(
    machine: Transplanter,
    times: TravelTimes = DELIVERED,
    *,
    thorough: bool = False,
    every: int = 1,
    scan_ms: int = SCAN_MS,
) -> Exploration:
    """Home from every situation with a machine without faults and a truthful operator.

    Args:
        machine: Program of the machine.
        times: Travel times of the machine.
        thorough: True for all states of the rows, and for each start on both arms, at rest and after a loss of power.
        every: Distance of the situations that are examined in the list of all.
        scan_ms: Scan time, ms.
    """
    found, limit_ms = Exploration(), _abandoned_ms(machine)
    trial = HomingTrial(machine, times, scan_ms=scan_ms, limit_ms=limit_ms)
    starts = arm_starts(trial.model, all_rows=thorough)
    for situation in islice(situations(machine, trial.model, starts, thorough=thorough), 0, None, every):
        found.add(trial, situation)
    trial = HomingTrial(machine, times, scan_ms=TRAY_SCAN_MS, limit_ms=limit_ms)
    for situation in islice(tray_situations(machine, trial.model), 0, None, every):
        found.add(trial, situation)
    return found


def explore_stuck_switches(machine: Transplanter, *, every: int = 1) -> Exploration:
    """Home from every situation with one stuck switch, a different one from situation to situation.

    Args:
        machine: Program of the machine.
        every: Distance of the situations that are examined in the list of all.
    """
    longest_ms = time_limit(machine).ms
    found, trial = Exploration(), HomingTrial(machine, limit_ms=2 * longest_ms)
    switches = [
        n for table in trial.model.devices.values() for device in table.values() for n in device.inputs.values()
    ]
    stuck = [{number: on} for number in (*switches, trial.model.tray_sensor) for on in (False, True)]
    starts = arm_starts(trial.model, all_rows=False)
    arms = enumerate(situations(machine, trial.model, starts, thorough=False))
    for n, situation in islice(arms, 0, None, every):
        found.add_stuck(trial, replace(situation, stuck=stuck[n // every % len(stuck)]), longest_ms)
    return found


def explored(machine: Transplanter, times: TravelTimes = DELIVERED) -> PropertyResult:
    """Return the result of `explore` for the report of the proof."""
    found = explore(machine, times)
    longest = found.longest
    summary = f"{found.starts} starts, {found.homings} homings, at most {MOST_HOMINGS} from each"
    lines = [summary if longest is None else f"{summary}, longest {longest.ms / 1000:.1f} s"]
    lines += [describe(situation, endings) for situation, endings in found.dead_ends[:_SHOWN]]
    return PropertyResult(not found.dead_ends, tuple(lines))


def describe(situation: HomingStart, endings: Iterable[Ending]) -> str:
    """Return a situation and the ends of its homings as one line."""
    values = ", ".join(f"{device.name or device}={value}" for device, value in situation.values.items())
    ends = "; ".join(
        f"{'running' if end.state is None else end.state.name} after {end.ms / 1000:.1f} s, alarms {list(end.alarms)}"
        for end in endings
    )
    stuck = "".join(f", X{number:o} stuck {'on' if on else 'off'}" for number, on in situation.stuck.items())
    return f"{'after power-up' if situation.powered_up else 'at rest'}: {values}{stuck}: {ends}"


def _abandoned_ms(machine: Transplanter) -> int:
    """Return the time after which a homing is abandoned, ms: longer than its upper bound if it has one."""
    try:
        return 2 * time_limit(machine).ms
    except UnboundedError:
        return UNBOUNDED_MS
