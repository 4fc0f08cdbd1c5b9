"""Planting speeds: measurement from cup and ground pulses, advice, warnings, and the set speed of a planter motor.

The values are for information, except for the set speed of a planter with its own motor, which is an output register. A
speed is measured over several pulses, because one pulse is only a few scans long. A measured time may be one scan too
short, which is an error of 0.5 % at 0.5 m/s.
"""

from __future__ import annotations

from typing import Final

from controller.core.expr import Expr, Word, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Annunciate, Count, Mov, OnDelay, Out, Rst, Rung, Scale, Set
from controller.core.sequence import Sequence
from controller.program.alarms.table import Annunciators
from controller.program.planting_tags import PlantingTags, PulseTags, ReadinessTags
from controller.program.set_points import CUPS
from controller.program.tags import FIRST_SCAN, SIDES, ArmTags, Side, Tags

GROUND_PULSES: Final = 20
"""Ground pulses per measurement: 1 m at the default pulse distance."""
CUP_GAP_MS: Final = 10_000
"""Time without a cup after which the planting frequency is 0, ms; the slowest measurable frequency is 6 per minute."""
GROUND_GAP_MS: Final = 3_000
"""Time without a ground pulse after which the ground speed is 0, ms; the slowest measurable speed is 17 mm/s."""
LONGEST_MS: Final = 327_670
"""Longest time of a 10 ms timer, ms."""
WAIT_MS: Final = 50
"""Shortest time at feed that counts as waiting, ms; an arm that does not wait is at feed for one or two scans."""
WARNING_MS: Final = 5_000
"""Delay of the warnings, ms; longer than a measurement of the ground speed at 0.2 m/s."""

_PER_MINUTE: Final = (7_200, 100)
"""Conversion from the time of twelve cups, x10 ms, to 0.1 per minute: 12 * 6,000 * 10 as the product of two words."""


def planting_block(tags: Tags, alarms: Annunciators, cycles: dict[Side, Sequence]) -> Block:
    """Return the block that measures the planting speeds and gives advice; it follows the sequences."""
    p = tags.planting
    rungs = [
        *_timed(tags, p.cups, tags.arms["left"].cup, CUPS, CUP_GAP_MS),
        Scale(*_PER_MINUTE, p.cups.time, p.frequency, when=p.cups.complete),
        Rst(p.frequency, when=p.cups.stale),
        Scale(tags.sp.planter_pitch, p.frequency, 600, p.chain_speed),
        *_ground(tags, p),
        *(rung for side in SIDES for rung in _readiness(tags, tags.arms[side], cycles[side])),
        *_advice(p),
        *_planter(tags, p),
        *_warnings(tags, p, alarms),
    ]
    return Block("planting speeds", tuple(rungs))


def _timed(tags: Tags, train: PulseTags, pulse: Expr, pulses: int, gap_ms: int) -> list[Rung]:
    """Return the rungs that time a number of pulses; the first pulse after a gap starts the measurement."""
    lost = train.t_gap.done | FIRST_SCAN | tags.system.link_lost
    return [
        OnDelay(train.t_gap, gap_ms, when=train.measuring & ~pulse),
        OnDelay(train.timer, LONGEST_MS),
        Out(train.stale, when=lost),
        Count(train.counter, pulses, when=train.measuring & pulse),
        Out(train.complete, when=train.counter.done & ~train.stale),
        Mov(train.timer.value, train.time, when=train.complete),
        Rst(train.counter, when=train.complete | train.stale),
        Rst(train.timer, when=train.complete | (pulse & ~train.measuring)),
        Rst(train.measuring, when=train.stale),
        Set(train.measuring, when=pulse & ~train.stale),
    ]


def _ground(tags: Tags, p: PlantingTags) -> list[Rung]:
    """Return the rungs of the ground speed and of lambda; none if the sensor is not wired."""
    if p.ground_sensor is None:
        return []
    return [
        *_timed(tags, p.ground, p.ground_edge, GROUND_PULSES, GROUND_GAP_MS),
        Scale(tags.sp.ground_pulse, GROUND_PULSES * 100, p.ground.time, p.ground_speed, when=p.ground.complete),
        Rst(p.ground_speed, when=p.ground.stale),
        Rst(p.ratio),
        Scale(p.chain_speed, 100, p.ground_speed, p.ratio),
    ]


def _readiness(tags: Tags, a: ArmTags, cycle: Sequence) -> list[Rung]:
    """Return the rungs that time an arm from the release of a row until it waits for cups with the next one.

    The last three times are stored, because the three rows are at different distances. The last three times in which
    the arm waited at feed for a tray or for the other arm are stored separately. A time during which the state was not
    Execute is discarded. If the arm waits for a count of cups before it moves down, all times are discarded.
    """
    arm = tags.planting.arms[a.side]
    waits = cycle["wait for cups"]
    released = a.release_edge & cycle["release delay"]
    working = all_of(tags.machine.executing, ~tags.machine.stepping, tags.sp.descend_at_count.equals(0))
    return [
        OnDelay(arm.timer, LONGEST_MS, when=arm.preparing),
        OnDelay(arm.t_wait, WAIT_MS, when=cycle["wait at feed"]),
        Set(arm.waited, when=arm.t_wait.done),
        Out(arm.ready, when=all_of(arm.preparing, waits, working)),
        *_stored(arm, arm.times, arm.ready & ~arm.waited),
        *_stored(arm, arm.times_with_wait, arm.ready & arm.waited),
        Rst(arm.preparing, when=waits | ~working),
        Rst(arm.waited, when=released),
        Set(arm.preparing, when=released & working),
    ]


def _stored(arm: ReadinessTags, times: list[Word], when: Expr) -> list[Rung]:
    latest, before, first = times
    return [Mov(before, first, when=when), Mov(latest, before, when=when), Mov(arm.timer.value, latest, when=when)]


def _advice(p: PlantingTags) -> list[Rung]:
    """Return the rungs of the highest frequencies at which both arms have a row ready every twelve cups.

    Above `fastest`, cups remain empty even in cycles without a wait; above `gapless`, only after a wait.
    """
    arms = p.arms.values()
    unknown = any_of(*(arm.times[0].equals(0) for arm in arms))
    untimed = unknown | all_of(*(arm.times_with_wait[0].equals(0) for arm in arms))
    return [
        Rst(p.longest),
        *(Mov(time, p.longest, when=time > p.longest) for arm in arms for time in arm.times),
        Scale(*_PER_MINUTE, p.longest, p.fastest, when=~unknown),
        Rst(p.fastest, when=unknown),
        Mov(p.longest, p.longest_with_wait),
        *(
            Mov(time, p.longest_with_wait, when=time > p.longest_with_wait)
            for arm in arms
            for time in arm.times_with_wait
        ),
        Scale(*_PER_MINUTE, p.longest_with_wait, p.gapless, when=~untimed),
        Rst(p.gapless, when=untimed),
    ]


def _planter(tags: Tags, p: PlantingTags) -> list[Rung]:
    """Return the rungs of the output register; none if the planter does not have its own motor."""
    machine, sp = tags.machine, tags.sp
    if p.planter_speed is None:
        return []
    turns = all_of(machine.motion, ~machine.resetting, ~machine.manual)
    by_ground = Scale(p.ground_speed, sp.planter_lambda, 100, p.planter_speed, when=turns)
    wanted = Mov(sp.planter_speed, p.planter_speed, when=turns) if p.ground_sensor is None else by_ground
    return [wanted, Rst(p.planter_speed, when=~turns)]


def _warnings(tags: Tags, p: PlantingTags, alarms: Annunciators) -> list[Rung]:
    """Return the rungs of the warnings; lambda is known only with a ground-speed sensor."""
    executing = tags.machine.executing
    too_fast = all_of(p.fastest.differs(0), p.frequency > p.fastest)
    rungs: list[Rung] = [
        Annunciate(p.t_too_fast, WARNING_MS, alarms.planting_fast, when=executing & too_fast),
        Rst(alarms.planting_fast, when=~too_fast),
    ]
    if p.ground_sensor is not None:
        off = p.ratio.differs(0) & ((p.ratio < tags.sp.lambda_lowest) | (p.ratio > tags.sp.lambda_highest))
        rungs += [
            Annunciate(p.t_lambda, WARNING_MS, alarms.lambda_off, when=executing & off),
            Rst(alarms.lambda_off, when=~off),
        ]
    return rungs
