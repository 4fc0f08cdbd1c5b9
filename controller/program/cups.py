"""Cups: count, plausibility of the cup pulses, and time of the release, from the flags at the cup counters.

A cup counter is on while a flag passes it. The flag reaches the counter two flag lengths before its cup is under the
claws and leaves it one flag length before. All times are in units of 10 ms.
"""

from __future__ import annotations

import math
from typing import Final

from controller.core.devices import MS_10
from controller.core.expr import all_of, any_of
from controller.core.rungs import Add, Count, Inc, Mov, OnDelay, Out, Pulse, PulseFalling, Rst, Rung, Set, Subtract
from controller.core.sequence import Sequence
from controller.program.set_points import CUP_SHORTEST_X10_MS, CUPS, LONGEST_CUP_X10_MS, ROWS_DIFFER_X10_MS
from controller.program.tags import FIRST_SCAN, ArmTags, Tags

FLAG_CHANGE_X10_MS: Final = 3
"""Largest difference between the times of two successive flags at which a row is released, x10 ms. It is also the time
by which a flag may be shorter than the release lead, with two scans and the filter of the input, to time the release.
With this value, no simulated row leaves the catch window by more than 0.2 mm in ramps of 30 cups per minute per
second."""
CHANGE_X10_MS: Final = 5
"""Largest difference between the times of two successive cups at which a row is released, x10 ms: 7 % at 90 cups per
minute. Flags displaced by 0.6 mm and two scans change the time by up to 7 %."""
SLOW_CHANGE_X10_MS: Final = 12
"""As `CHANGE_X10_MS` while the flag itself times the release: 4 % at 20 cups per minute, as much as flags displaced by
0.6 mm."""
EARLY_X10_MS: Final = 5
"""Twice the delay of the pulse by the filter and the scan, x10 ms: half of 10 ms plus one to two scans."""
RAMP_PER_MIN_S: Final = 30
"""Permitted change of the planting frequency, cups per minute per second."""
RAMP_TOLERANCE: Final = 0.93
"""Part of the shortest time of a cup by the permitted ramp, below which a pulse is implausible: 4 % for displaced flags
and two scans at 90 cups per minute."""
RAMP_FROM_X10_MS: Final = (60, 80, 100, 130)
"""Times of a cup at which the shortest permitted time of the next one changes, x10 ms."""
RAMP_UP_TO_X10_MS: Final = 200
"""Longest time of a cup after which the ramp is examined, x10 ms; a longer time may contain a standstill."""
MOST_GROUND_PULSES: Final = 10_000
"""Number of ground pulses from cup to cup at which the count stops."""
GAP_LEAST_X10_MS: Final = 33
"""Least time by which the gap behind a flag exceeds the flag, x10 ms. A gap is four flags long; from 20 to 90 cups per
minute with the permitted ramp it lasts at least 0.36 s longer than the flag. If a flag is counted twice, the gap is one
and a half flags long and lasts at most 0.3 s longer."""
GAP_FLAG_X10_MS: Final = 61
"""Longest flag before a gap that is examined, x10 ms: that of 20 cups per minute; a longer one may contain a
standstill."""


def shortest_next_s(time_s: float, ramp_per_min_s: float = RAMP_PER_MIN_S) -> float:
    """Return the shortest time of the cup after a cup of the given time, with a bounded change of the frequency.

    The mean frequencies 1/t of two successive cups differ by at most the ramp times the distance of their mid-times,
    (t1 + t2)/2.

    Args:
        time_s: Time of a cup, s.
        ramp_per_min_s: Largest change of the frequency, cups per minute per second.
    """
    ramp_hz_s = ramp_per_min_s / 60
    most_hz = 1 / time_s + ramp_hz_s * time_s / 2
    return (math.sqrt(most_hz**2 + 2 * ramp_hz_s) - most_hz) / ramp_hz_s


def cup_count(tags: Tags, a: ArmTags, steps: Sequence) -> list[Rung]:
    """Return the rungs of the cup counter, which runs in every state.

    The edge that releases a row has the count 0; the twelfth edge after it may release the next row. Every edge,
    counted or not, restarts the pulse interval, so a flag that bounces is counted only once. While an alarm of the cups
    is set, the count is invalid. What raises such an alarm while rows are released makes it invalid at rest, too.
    """
    machine, sp = tags.machine, tags.sp
    waiting = steps["wait for cups"] | steps["wait to lower"]
    implausible = machine.cups_implausible | a.counts_differ
    if tags.planting.ground_sensor is not None:
        implausible |= tags.planting.cups_differ
    invalid = any_of(FIRST_SCAN, machine.cup_fault, implausible)
    lost = tags.system.link_lost
    empty = a.cup_counter.done | (a.cups_confirmed & a.count_valid)
    return [
        Pulse(a.cup_edge, when=a.cup_sensor | lost),
        Rst(a.cup_edge, when=lost),
        Out(a.cup, when=a.cup_edge & a.t_pulse.done),
        OnDelay(a.t_pulse, sp.pulse_interval, when=~a.cup_edge),
        *_times(tags, a),
        Rst(a.cup_counter, when=invalid),
        Rst(a.missed_cups, when=tags.commands.count_reset),
        Inc(a.missed_cups, when=all_of(a.cup, empty, a.row_running)),
        Count(a.cup_counter, CUPS, when=a.cup),
        Rst(a.count_valid, when=invalid),
        Set(a.count_valid, when=a.cup_counter.done),
        Set(a.cups_confirmed, when=tags.commands.cups_empty & ~a.count_valid),
        Rst(a.cups_confirmed, when=machine.cup_fault),
        Out(a.count_good, when=a.cup_counter.done | a.cups_confirmed),
        Out(
            a.release_edge,
            when=all_of(a.cup, a.count_good, a.cups_steady, ~machine.cup_fault, machine.running | machine.stopping)
            & ~tags.stands,
        ),
        *_release(tags, a),
        Set(a.cups_confirmed, when=all_of(steps["release delay"], a.release_missed, ~machine.cup_fault)),
        OnDelay(a.t_no_cups, sp.no_cups, when=waiting & ~a.cup),
        Out(a.no_cups, when=a.t_no_cups.done),
        # while an alarm of the cups is set, no row is released
        Out(a.park, when=machine.holding | (machine.stopping & (a.no_cups | machine.cup_fault))),
        *_planted(tags, a, steps),
    ]


def _planted(tags: Tags, a: ArmTags, steps: Sequence) -> list[Rung]:
    """Return the rungs that count the empty cups of a released row; none without the sensor for filled cups.

    A cup is in front of the sensor at the edge of its flag. The first edge after the release shows the cup under the
    last claw, the twelfth the one under claw 0. A cup counts as filled only if its plug has come in front of the sensor
    since the last cup, so that a sensor that stays on counts empty cups like one that stays off.
    """
    planted, most = a.yields.planted, tags.sp.missing_most
    if planted is None or most is None:
        return []
    machine = tags.machine
    ends = any_of(FIRST_SCAN, machine.cup_fault, machine.resetting, tags.system.link_lost)
    empty = all_of(a.cup, planted.looks, ~(planted.seen & planted.plug))
    return [
        Pulse(planted.edge, when=planted.plug),
        Set(planted.seen, when=planted.edge),
        Inc(planted.empty, when=empty),
        Inc(planted.empty_cups, when=empty),
        Rst(planted.empty_cups, when=tags.commands.count_reset),
        Out(planted.short, when=planted.looks & (planted.empty > most)),
        Rst(planted.looks, when=any_of(planted.short, a.cup & a.cup_counter.done, ends)),
        Rst(planted.looks, when=steps["release delay"] & a.release_missed),
        Rst(planted.seen, when=a.cup),
    ]


def _times(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that time the cups and their flags, and compare each cup with the one before.

    A cup lasts from the edge of its flag to the edge of the next one, a flag from its edge until it leaves the counter.
    The cups are steady if the times of two successive cups, and of the last cups of both rows, hardly differ.
    """
    sp, change = tags.sp, a.cup_change
    slow_even = all_of(a.flags_slow, change <= SLOW_CHANGE_X10_MS, change >= -SLOW_CHANGE_X10_MS)
    even = slow_even | ((change <= CHANGE_X10_MS) & (change >= -CHANGE_X10_MS))
    lost = tags.system.link_lost
    return [
        PulseFalling(a.flag_left, when=a.cup_sensor & ~lost),
        Rst(a.flag_left, when=lost),
        Out(a.flag_short, when=a.flag_left & (a.t_cup.value < a.flag_shortest)),
        Mov(a.t_cup.value, a.flag_time, when=a.flag_left),
        Add(a.flag_time, FLAG_CHANGE_X10_MS, a.flag_longest, when=a.flag_left),
        Subtract(a.flag_time, FLAG_CHANGE_X10_MS, a.flag_shortest, when=a.flag_left),
        Add(a.flag_time, a.flag_time, a.flags_twice, when=a.flag_left),
        Subtract(a.cup_time, a.t_cup.value, a.cup_change, when=a.cup),
        Mov(a.t_cup.value, a.cup_time, when=a.cup),
        Subtract(a.cup_time, a.flag_time, a.gap_time, when=a.cup),
        Mov(LONGEST_CUP_X10_MS, a.cup_time, when=FIRST_SCAN | lost),
        Subtract(a.cup_time, tags.other(a.side).cup_time, a.row_difference, when=a.cup),
        Rst(a.t_cup, when=a.cup),
        OnDelay(a.t_cup, LONGEST_CUP_X10_MS * MS_10),
        Out(a.flags_slow, when=a.flag_longest >= sp.release_lead),
        Out(a.cups_even, when=even),
        Out(
            a.cups_steady,
            when=all_of(
                a.cups_even,
                a.row_difference <= ROWS_DIFFER_X10_MS,
                a.row_difference >= -ROWS_DIFFER_X10_MS,
                a.cup_time <= sp.cup_time_longest,
                a.cup_time >= sp.cup_time_shortest,
            ),
        ),
    ]


def _release(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that decide when the claws open after the releasing edge, or that this cup is left empty.

    The claws open the release lead before the cup is under them. If a flag takes as long as the lead or longer, the
    cup is one flag length away when its flag leaves, and the time of this flag predicts the rest. At a higher speed,
    the cup is half a gap away when its flag arrives, and the time of the last gap predicts the rest. The cup is left
    empty if the flag shows that the chain changes its speed, if the other row has not counted a cup since the last one,
    or if an alarm of the cups is set.
    """
    machine, sp = tags.machine, tags.sp
    fixed = sp.release_delay.differs(0)
    slow, fast, left = ~fixed & a.flags_slow, ~fixed & ~a.flags_slow, ~a.cup_sensor
    half_gap_over = a.time_and_lead_twice >= a.gap_time
    due = any_of(
        all_of(slow, left, a.time_and_lead >= a.flags_twice),
        fast & half_gap_over,
        fixed & a.t_release_delay.done,
    )
    uneven = any_of(
        ~fixed & a.flag_short,
        all_of(slow, ~left, a.t_cup.value > a.flag_longest),
        all_of(fast, left, ~half_gap_over),
    )
    return [
        Add(a.t_cup.value, sp.release_lead, a.time_and_lead),
        Add(a.time_and_lead, a.time_and_lead, a.time_and_lead_twice),
        Add(a.time_and_lead_twice, EARLY_X10_MS, a.time_and_lead_twice),
        Out(a.release_missed, when=any_of(uneven, a.lone_cups.done & left, machine.cup_fault)),
        Out(a.release_due, when=all_of(due, ~a.lone_cups.done, ~a.release_missed)),
    ]


def plausibility(tags: Tags) -> list[Rung]:
    """Return the rungs that compare the cup pulses of the left row with the permitted range and ramp.

    One wheel drives both rows, so the left row represents both; a row that differs from the other one has an alarm of
    its own. A pulse is implausible if it follows the previous one sooner than the permitted ramp allows, or if the gap
    behind a flag is too short for the flag, which indicates a flag that is counted twice.
    """
    machine, a = tags.machine, tags.arms["left"]
    doubled = all_of(
        a.gap_time < machine.gap_shortest, a.flag_time <= GAP_FLAG_X10_MS, a.cup_time >= CUP_SHORTEST_X10_MS
    )
    bands = [
        Mov(round(100 * RAMP_TOLERANCE * shortest_next_s(least / 100)), machine.cup_time_least, a.cup_time >= least)
        for least in RAMP_FROM_X10_MS
    ]
    return [
        Out(machine.cups_fast, when=a.cup & (a.cup_time < tags.sp.cup_time_shortest)),
        Add(a.flag_time, GAP_LEAST_X10_MS, machine.gap_shortest, when=a.cup),
        Out(machine.cups_implausible, when=a.cup & ((a.cup_time < machine.cup_time_least) | doubled)),
        Mov(0, machine.cup_time_least),
        *bands,
        Mov(0, machine.cup_time_least, when=a.cup_time > RAMP_UP_TO_X10_MS),
        *_ground(tags),
    ]


def _ground(tags: Tags) -> list[Rung]:
    """Return the rungs that compare the ground travel from cup to cup with its permitted range; none without sensor."""
    p, cup, lost = tags.planting, tags.arms["left"].cup, tags.system.link_lost
    if p.ground_sensor is None:
        return []
    pulses = p.cup_pulses.value
    return [
        Pulse(p.ground_edge, when=p.ground_sensor | lost),
        Rst(p.ground_edge, when=lost),
        Count(p.cup_pulses, MOST_GROUND_PULSES, when=p.ground_edge),
        Out(
            p.cups_differ,
            when=cup & ((pulses < tags.sp.ground_pulses_least) | (pulses > tags.sp.ground_pulses_most)),
        ),
        Rst(p.cup_pulses, when=cup),
    ]
