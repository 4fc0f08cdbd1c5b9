"""Tags: all devices of the program, by name.

Addresses are allocated consecutively in the area of their owner, so the relays of one arm are adjacent. Retentive
devices are in the fixed latched ranges (M1024+, D512+). Panels use these addresses: append new devices at the end of
their area.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeVar

from controller.common.declarations import Declared
from controller.common.modbus.io_map import IoMap
from controller.core.devices import INITIAL_PULSE
from controller.core.expr import FALSE, Bit, Counter, Expr, Timer, Word
from controller.program.areas import Area
from controller.program.inputs import Inputs, System, driven
from controller.program.operator import commands
from controller.program.operator.commands import ARM_OUTPUTS, JOGGED, TRAY_ROWS, Commands
from controller.program.planting_tags import PlantingTags, YieldTags
from controller.program.set_points import SetPoints
from controller.program.tray_tags import TrayTags

Side = Literal["left", "right"]
SIDES: Final[tuple[Side, Side]] = ("left", "right")
ROWS: Final = TRAY_ROWS

DEVICES: Final = ("lift", "slide", "belt")
"""Devices of an arm that move between switches."""

PLACES: Final = ("down", "up", "feed", *(f"pick {row}" for row in ROWS), "spread", "converged")
"""Places of an arm at which a device has a switch."""

TAKEN, FULL, IN_PROGRESS, IN_DOUBT = 0, 1, 2, 3
"""States of a row of seedlings."""

STEPPED: Final = ("left arm", "right arm", "tray feeder")
"""Sequences that can be stepped; value 1 of the set-point selects the first."""

NO_TRAY, IN_PLACE, MOVING_OUT, COMING, FORGOTTEN = 0, 1, 2, 3, 4
"""Phases of the tray: none, at the pick position, leaving it, approaching it, unknown after a loss of memory."""

FIRST_SCAN: Final = Bit("M", INITIAL_PULSE, "first scan", "on in the first scan after power-up")


_T = TypeVar("_T")


def _per_device(rows: dict[str, _T]) -> Declared[str, _T]:
    return Declared("DEVICES", __name__, rows)


def _per_output(rows: dict[str, _T]) -> Declared[str, _T]:
    return Declared("ARM_OUTPUTS", commands.__name__, rows)


class MachineTags:
    """Relays and registers of the machine."""

    def __init__(self) -> None:  # noqa: PLR0915 - a list of tags
        m = Area("M", 10, 99)
        d = Area("D", 100, 109)
        self.state = d.word("state", "PackML state number")
        self.state_before = d.word("previous state", "PackML state number in the previous scan")
        self.trays_done = Word("D", 560, "trays done", "trays emptied since the last reset of the counts")
        self.mode = Word("D", 562, "mode", "mode number: 1 continuous, 3 manual, 4 one cycle, 5 step, 6 zero return")
        self.reason = d.word("reason", "number of the reason for Suspended or Held")
        self.refused = d.word("refused", "number of the last refused command")
        self.refusal = d.word("refusal", "number of the reason for the last refusal")
        self.refusals = d.word("refusals", "number of refused commands since power-up")
        self.jog = d.word("jog", "number of the jogged output; 0 = none")
        self.first_out = d.word("first out", "number of the first annunciator that stopped work; 0 = none")
        self.batch_complete = Bit("M", 1056, "batch complete", "target of trays reached; homing clears the count")
        self.start_pressed = m.bit("start pressed", "X0 pressed, this scan")
        self.reset_pressed = m.bit("reset pressed", "reset button pressed, this scan")
        self.stop_pressed = m.bit("stop pressed", "X24 pressed or stop command, this scan")
        self.home_requested = m.bit("home requested", "reset and home: X0 or command, this scan")
        self.start_requested = m.bit("start requested", "start: X0 or command, this scan")
        self.clear_requested = m.bit("clear requested", "clear after an emergency stop, this scan")
        self.unhold_requested = m.bit("unhold requested", "resume after a hold, this scan")
        self.hold_requested = m.bit("hold requested", "hold by the operator or after a panel timeout")
        self.panel_lost = m.bit("panel lost", "panel timeout expired, this scan")
        self.held_by_operator = m.bit("held by operator", "held by the hold command")
        self.held_by_panel = m.bit("held by panel", "held by a panel timeout")
        self.suspended_by_operator = m.bit("suspended by operator", "suspended by command until the unsuspend command")
        self.complete_ordered = m.bit("complete requested", "no new row is started; then Complete")
        self.ordered = m.bit("command given", "command given or button pressed, this scan")
        self.manual = m.bit("manual", "mode is manual")
        self.stepping = m.bit("stepping", "step mode active: each transfer requires a press")
        self.stops_at_once = m.bit("stops at once", "in this mode, stop and hold do not wait for the end of the cycle")
        self.jogging = m.bit("jogging", "manual mode active: outputs follow the jog register")
        self.jog_renewed = m.bit("jog renewed", "jog command accepted, this scan")
        self.step_armed = Declared(
            "STEPPED",
            __name__,
            {name: m.bit(f"step armed, {name}", f"the next transfer of the {name} is permitted") for name in STEPPED},
        )
        self.abort = m.bit("abort", "emergency stop, or a fault of link, scan or store")
        self.clear_armed = m.bit("clear armed", "X24 pressed in Aborted, after the emergency stop was released")
        self.motion = m.bit("motion allowed", "the state allows motion")
        self.resetting = m.bit("resetting", "state is Resetting")
        self.entered_resetting = m.bit("entered Resetting", "first scan of Resetting")
        self.places_anew = m.bit(
            "places reset", "power-up or start of homing: a device with no switch on is between two places"
        )
        self.entered_starting = m.bit("entered Starting", "first scan of Starting or Unholding")
        self.running = m.bit("running", "state is Starting, Execute, Suspending, Suspended, Unsuspending or Unholding")
        self.executing = m.bit("executing", "state is Execute")
        self.suspend = m.bit("suspend", "no tray, no cups, or suspend command")
        self.stopping = m.bit("stopping", "state is Stopping")
        self.holding = m.bit("holding", "state is Holding")
        self.target_reached = m.bit("target reached", "the target number of trays has been emptied")
        self.fault = m.bit("fault", "an alarm that stops work is set")
        self.horn = m.bit("horn", "alarm not yet acknowledged")
        self.alarm_reset = m.bit("alarm reset", "alarms whose cause has cleared are reset, this scan")
        self.new_alarm = m.bit("new alarm", "first alarm that stops work was set, this scan")
        self.t_reset = Timer(107, "reset closed", "time for which the reset button is closed")
        self.jogs = Declared(
            "JOGGED", commands.__name__, {output: self.jog.equals(1 + n) for n, output in enumerate(JOGGED)}
        )
        self.t_jog_lease = Timer(224, "jog lease", "time since the last jog command")
        self.t_step_press = Timer(225, "step press", "time since the press in step mode")
        self.t_stop = Timer(100, "stop closed", "time for which X24 is closed")
        self.cup_fault = m.bit("cup fault", "an alarm of the cup pulses is set; the cup counts are invalid")
        cups_m, cups_d = Area("M", 374, 375, "cups"), Area("D", 170, 171, "cups")
        self.cups_fast = cups_m.bit("too fast", "a cup has passed faster than permitted, this scan")
        self.cups_implausible = cups_m.bit("implausible", "a cup pulse is too early or its gap too short, this scan")
        self.t_cups_slow = Timer(130, "cups slow", "the left cups pass more slowly than permitted")
        self.cup_time_least = cups_d.word("time least x10 ms", "shortest plausible time until the next cup, left row")
        self._add_ways_out(m, d)
        safeguards = Area("M", 384, 399, "safeguards")
        self.guard_open = safeguards.bit("guard open", "the guard is open")
        self.guard_stops = safeguards.bit(
            "guard stops", "the guard has been opened while motion was allowed, this scan"
        )
        self.gap_shortest = cups_d.word("gap shortest x10 ms", "shortest plausible gap behind the last flag, left row")
        self.home_waits = safeguards.bit("homing waits", "homing is ordered and waits for the start warning")
        self.go_waits = safeguards.bit("start waits", "start or resume is ordered and waits for the start warning")
        self.warning = safeguards.bit("start warning", "the horn announces motion")
        self.warned = safeguards.bit("warned", "the start warning is complete, or not required")
        self.stands = safeguards.bit("stands", "state is Suspended: no arm and no tray begins a motion")
        self.unmoved = safeguards.bit("unmoved", "nothing has moved since the start warning")
        self.lapsed = safeguards.bit("order lapsed", "nothing moved in time after the start warning")
        self.t_warning = Timer(136, "start warning", "duration of the start warning")
        self.t_lapse = Timer(137, "order lapses", "time without motion after the start warning")

    def _add_ways_out(self, m: Area, d: Area) -> None:
        """Allocate the devices of questions, next presses, and emptying of the line."""
        self.next_press = d.word("next press", "number of the next useful press")
        self.question = d.word("question", "number of the question that the buttons answer; 0 = none")
        self.question_before = Word("D", 113, "previous question", "question in the previous scan")
        self.rows_left = Word("D", 563, "rows left", "full rows conveyed out since the last reset of the counts")
        self.yes_armed = m.bit("yes armed", "X0 pressed to answer a question")
        self.no_armed = m.bit("no armed", "X24 pressed to answer a question")
        self.released_early = m.bit("released early", "a press that must last longer has ended, this scan")
        self.refused_now = m.bit("press refused", "a button or command was refused, this scan")
        self.refused_shown = m.bit("refusal shown", "the amber lamp shows a refused press")
        self.emptying = m.bit("emptying", "the tray is conveyed out after the last row, and no other one is fed")
        self.line_clear = m.bit("line clear", "emptying, and no arm is over the tray or loaded")
        self.stop_button = m.bit("stop button", "X24 pressed, this scan")
        self.yes_due = m.bit("yes due", "X0 has been pressed long enough to answer; its release answers")
        self.no_due = m.bit("no due", "X24 has been pressed long enough to answer; its release answers")
        self.clear_due = m.bit("clear due", "X24 has been pressed long enough to clear; its release clears")
        self.reset_armed = m.bit("reset armed", "reset button pressed; its release resets or clears")
        self.reset_released = m.bit("reset released", "reset button released after a press, this scan")
        self.constants_differ = m.bit("constants differ", "a machine constant differs from its default")
        self.constants_open = m.bit(
            "constants open", "a constant differs, and X25 has not been pressed and released since the start"
        )
        self.confirm_ready = m.bit("confirmation possible", "X25 seen released since the start")
        self.confirming = m.bit("confirming", "X25 pressed to confirm the constants")
        self.places_checked = m.bit(
            "places checked", "a place whose switch is not on, or not alone, is lost: at rest, and when homing begins"
        )
        self.t_no_motion = Timer(135, "no motion", "time without permitted motion, with the link")
        self.t_start = Timer(131, "start closed", "time for which X0 is closed")
        self.t_question_lamp = Timer(132, "question lamp", "cycle of the flashes that number a question")
        self.t_refused_lamp = Timer(133, "refusal lamp", "time for which the lamp shows a refused press")


class ArmTags:
    """Conditions, relays, registers and timers of one arm."""

    def __init__(self, side: Side, io_map: IoMap) -> None:  # noqa: PLR0915 - a list of tags
        x = Inputs(io_map)
        index = SIDES.index(side)
        m = Area("M", 100 + 100 * index, 199 + 100 * index, side)
        retentive_m = Area("M", 1024 + 16 * index, 1039 + 16 * index, side)
        retentive_d = Area("D", 540 + 10 * index, 549 + 10 * index, side)
        t10 = Area("T", 200 + 10 * index, 209 + 10 * index, side)
        self.side = side
        self.first_step = 20 + 80 * index
        self.first_limit = 50 * index
        self.coils = _per_output({name: driven(io_map[f"{side}.{name}"]) for name in ARM_OUTPUTS})

        self.sensed_down = x[f"{side}.lift_down"]
        self.sensed_up = x[f"{side}.lift_up"]
        self.sensed_at_feed = x[f"{side}.slide_at_feed"]
        self.sensed_at_pick = {row: x[f"{side}.slide_at_pick_{row}"] for row in ROWS}
        self.sensed_spread = x[f"{side}.claws_spread"]
        self.sensed_converged = x[f"{side}.claws_converged"]
        self.cup_sensor = x[f"{side}.cup_pulse"]
        self.yields = YieldTags(side, index, x)

        self.down = m.bit("down", "lift at its lower limit, confirmed by a plausible switch")
        self.up = m.bit("up", "lift at its upper limit, confirmed by a plausible switch")
        self.at_feed = m.bit("at feed", "slide at feed, confirmed by a plausible switch")
        self.at_pick = {
            row: m.bit(f"at pick {row}", f"slide at pick {row}, confirmed by a plausible switch") for row in ROWS
        }
        self.is_spread = m.bit("is spread", "claws spread, confirmed by a plausible switch")
        self.is_converged = m.bit("is converged", "claws converged, confirmed by a plausible switch")
        self.was_down = m.bit("was down", "last confirmed place of the lift: lower limit")
        self.was_up = m.bit("was up", "last confirmed place of the lift: upper limit")
        self.was_at_feed = m.bit("was at feed", "last confirmed place of the slide: feed")
        self.was_at_pick = {
            row: m.bit(f"was at pick {row}", f"last confirmed place of the slide: pick {row}") for row in ROWS
        }
        self.was_spread = m.bit("was spread", "last confirmed place of the claws: spread")
        self.was_converged = m.bit("was converged", "last confirmed place of the claws: converged")
        self.lift_travelled = m.bit("lift travelled", "shortest travel time to the other end has elapsed")
        self.slide_travelled = m.bit("slide travelled", "shortest travel time between feed and a row has elapsed")
        self.slide_hopped = m.bit("slide travelled between rows", "shortest travel time between two rows has elapsed")
        self.belt_travelled = m.bit("belt travelled", "shortest travel time to the other end has elapsed")
        self.placed = _per_device(
            {name: m.bit(f"{name} place confirmed", f"a place of the {name} is confirmed") for name in DEVICES}
        )
        self.doubt = _per_device(
            {name: m.bit(f"{name} in doubt", f"an implausible switch of the {name} is on") for name in DEVICES}
        )
        self.passed = m.bit("passed row", "the slide has reached or passed the next row since it left feed")
        self.begins_rest = m.bit("comes to rest", "lift, slide and belt have been off for the rest time, this scan")
        self.rests_down = m.bit("rests down", "the lift was down when it came to rest")
        self.rests_up = m.bit("rests up", "the lift was up when it came to rest")
        self.rests_at_feed = m.bit("rests at feed", "the slide was at feed when it came to rest")
        self.rests_spread = m.bit("rests spread", "the claws were spread when they came to rest")
        self.rests_converged = m.bit("rests converged", "the claws were converged when they came to rest")
        self.want = _per_output(
            {name: m.bit(f"want {name}", f"request: {name.replace('_', ' ')}") for name in ARM_OUTPUTS},
        )
        self.cup_edge = m.bit("cup edge", "rising edge of the cup sensor")
        self.cup = m.bit("cup", "cup counted, this scan")
        self.count_good = m.bit("count good", "twelve empty cups are under the claws")
        self.release_edge = m.bit("release edge", "cup edge at which a waiting arm releases its row, this scan")
        self.count_valid = m.bit("count valid", "twelve cups counted or a row released since power-up")
        self.cups_confirmed = m.bit("cups confirmed", "the operator has confirmed that the cups are empty")
        self.no_cups = m.bit("no cups", "waiting for cups, and no cup pulse within the time limit")
        self.row_running = m.bit("row running", "a row has been released; cups after the twelfth count as missed")
        self.row_is = {row: m.bit(f"row is {row}", f"row {row} is the next row to pick") for row in ROWS}
        self.row_full = m.bit("row full", "the next row is full")
        self.row_in_progress = m.bit("row in progress", "a row is clamped but not yet lifted")
        self.row_in_doubt = m.bit("row in doubt", "power was lost between clamping and lifting")
        self.at_wanted_row = m.bit("at next row", "slide at the next row")
        self.permit = m.bit("cycle permit", "a new cycle may start")
        self.park = m.bit("park", "a loaded arm moves up and stays there")
        self.in_centre = m.bit("in centre", "the arm occupies the space inward of pick 2, or may on its way to row 2")
        self.thrown = m.bit("row released", "row released over the cups, this scan")
        self.retried = m.bit("retried", "the slide has returned to its row once")
        self.cycle_done = m.bit("cycle done", "one-cycle mode: the cycle is complete")
        self.ask = m.bit("ask loaded", "question to the operator: does the arm hold seedlings?")
        self.hears_answers = m.bit("accepts answers", "the arm is at rest, so answers about its load are accepted")
        self.ask_cups = m.bit(
            "ask cups", "question to the operator: are the cups empty? If unanswered, twelve cups must pass"
        )
        self.ungranted = m.bit("request blocked", "a requested output is blocked by an interlock, this scan")
        self.unbidden = m.bit("switch changed at rest", "a switch has changed while the arm was at rest")
        self.blocked_by = Word(
            "D", 110 + index, f"{side}.blocked by", "number of the interlock that blocks an output; 0 = none"
        )
        self.discard = m.bit("discard", "the load is discarded over the cups during homing")
        self.active = m.bit("active", "a step of the cycle is on")
        self.cycling = m.bit("cycling", "a cycle is in progress")
        self.at_rest = m.bit("at rest", "no motion of a cycle is in progress")
        self.homed = m.bit("homed", "homing of the arm is complete")
        self.fault = m.bit("fault", "an alarm of this arm is set")
        self.off_home = m.bit("off home", "the arm should be at home but is not")
        self.over_row = m.bit("overran", "the slide left its row after arriving")
        self.under_way = _per_device(
            {
                name: m.bit(f"{name} under way", f"the {name} has been between two places while driven")
                for name in DEVICES
            },
        )

        self.loaded = retentive_m.bit("loaded", "the claws hold seedlings")
        self.claws_closed = retentive_m.bit("claws closed", "the last claw command was to close")
        self.claws_known = retentive_m.bit("claws known", "the last claw command is known")
        self.clamped = retentive_m.bit("clamped", "claws closed for their dwell time")
        self.on_row = retentive_m.bit(
            "on row", "the claws have closed at a row, and the slide has not been driven since"
        )
        self.reached = Declared(
            "PLACES",
            __name__,
            {
                place: retentive_m.bit(f"reached {place}", f"{place} was reached, and the device not driven away since")
                for place in PLACES
            },
        )
        self.out_of_service = retentive_m.bit("out of service", "the arm stays at feed and is not driven")
        self.rows = {row: retentive_d.word(f"row {row}", "0 taken, 1 full, 2 in progress, 3 in doubt") for row in ROWS}
        self.missed_cups = retentive_d.word("missed cups", "cups missed since the last reset of the counts")
        self.cycles = retentive_d.word("cycles", "rows released over the cups; without those only assumed")

        self.cup_counter = Counter(index, f"{side}.cups", "cups since the last release")
        self.t_pulse = t10.timer("pulse interval", "shortest time between two cup pulses")
        self.t_settle = t10.timer("settle", "slide at rest at its row")
        self.t_closing = t10.timer("claws closing", "closing dwell of the claws")
        self.t_opening = t10.timer("claws opening", "opening dwell of the claws")
        self.closed: Expr = self.t_closing.done
        """The closing dwell has elapsed and, if its sensor is wired, air presses the fingers together."""
        self.opened: Expr = self.t_opening.done
        """The opening dwell has elapsed and, if its sensor is wired, no air presses the fingers together."""
        if (pressure := self.yields.pressure) is not None:
            self.closed, self.opened = self.closed & pressure, self.opened & ~pressure
        self.t_pause = t10.timer("pause at feed", "delay before spreading")
        self.t_release_delay = t10.timer("release delay", "delay from the cup pulse to opening")
        self.t_lift_way = t10.timer("lift travel", "lift between its ends")
        self.t_slide_way = t10.timer("slide travel", "slide between feed and a row")
        self.t_slide_hop = t10.timer("slide travel between rows", "slide between two rows")
        self.t_belt_way = t10.timer("belt travel", "claws between their ends")
        self.t_no_cups = Timer(101 + index, f"{side}.no cups", "no cup pulse while waiting")
        self.t_press = Timer(226 + index, f"{side}.pressurise at feed", "outer chamber of the slide fills")
        pressed = Area("T", 228 + 3 * index, 230 + 3 * index, side)
        self.t_pressed = _per_device(
            {name: pressed.timer(f"{name} pressed", f"{name} driven against its end") for name in DEVICES}
        )
        t100 = Area("T", 110 + 10 * index, 119 + 10 * index, side)
        self.t_rest = t100.timer("rest", "all coils of lift, slide and belt are off")
        self.t_doubt = _per_device(
            {name: t100.timer(f"{name} in doubt", f"an implausible switch of the {name} is on") for name in DEVICES}
        )
        self.t_unbidden = t100.timer("switch changed at rest", "a switch has changed while the arm was at rest")
        self.t_raising = t100.timer("raising", "lift driven upwards")
        self.t_press_down = t100.timer("press down at feed", "upper chamber of the lift fills")
        self.lone_cups = Counter(2 + index, f"{side}.unmatched cups", "cups since the last cup of the other row")
        self.counts_differ = Bit("M", 376 + index, f"{side}.counts differ", "counts cups that the other row does not")
        self._add_cup_times(index)

    def _add_cup_times(self, index: int) -> None:
        """Allocate the relays, registers and timer that time the cups and the release."""
        m = Area("M", 360 + 7 * index, 366 + 7 * index, self.side)
        d = Area("D", 150 + 10 * index, 159 + 10 * index, self.side)
        self.t_cup = Timer(235 + index, f"{self.side}.cup", "time since the last cup")
        self.flag_left = m.bit("flag left", "a flag has left the cup sensor, this scan")
        self.flag_short = m.bit("flag short", "a flag has left the cup sensor sooner than the last one, this scan")
        self.flags_slow = m.bit("flags slow", "the last flag took as long as the release lead or longer")
        self.cups_even = m.bit("cups even", "the last two cups passed in equal times")
        self.cups_steady = m.bit("cups steady", "the cups of both rows pass evenly within the permitted range")
        self.release_due = m.bit("release due", "the claws open now, so that the plugs land in the cups")
        self.release_missed = m.bit("release missed", "the cup is left empty: its pulse or time is in doubt")
        self.cup_time = d.word("cup time x10 ms", "time of the last cup")
        self.flag_time = d.word("flag time x10 ms", "time of the last flag at the cup sensor")
        self.gap_time = d.word("gap time x10 ms", "time between the last two flags")
        self.flag_longest = d.word("flag longest x10 ms", "longest time of the next flag for a release")
        self.flag_shortest = d.word("flag shortest x10 ms", "shortest time of the next flag for a release")
        self.flags_twice = d.word("two flags x10 ms", "twice the time of the last flag")
        self.cup_change = d.word("cup change x10 ms", "difference of the last two cup times")
        self.row_difference = d.word("row difference x10 ms", "difference to the time of the last cup of the other row")
        self.time_and_lead = d.word("time and lead x10 ms", "time since the last cup plus the release lead")
        self.time_and_lead_twice = d.word("time and lead twice", "twice that time, with the delay of the input")


@dataclass(frozen=True)
class Tags:
    """All tags of the program."""

    x: Inputs
    system: System
    commands: Commands
    sp: SetPoints
    machine: MachineTags
    arms: dict[Side, ArmTags]
    tray: TrayTags
    planting: PlantingTags
    moving: dict[str, Expr]
    """Conditions that the outputs of the map that move something were on in the last scan, by tag."""
    warns: bool
    """True if the horn is wired: it then announces motion."""

    @classmethod
    def of(cls, io_map: IoMap) -> Tags:
        """Return the tags of the program for an I/O map."""
        arms = {side: ArmTags(side, io_map) for side in SIDES}
        machine, tray, planting = MachineTags(), TrayTags(io_map), PlantingTags(io_map, SIDES)
        moving = {point.tag: driven(point) for point in io_map.outputs if point.moves}
        set_points = SetPoints(counts_seedlings=any(arm.yields.counts for arm in arms.values()))
        warns = io_map.get("horn") is not None
        return cls(Inputs(io_map), System(), Commands(), set_points, machine, arms, tray, planting, moving, warns)

    @property
    def stands(self) -> Expr:
        """Condition that nothing may begin to move before the start warning; never true without the horn."""
        return self.machine.stands if self.warns else FALSE

    def other(self, side: Side) -> ArmTags:
        """Return the tags of the opposite arm."""
        return self.arms["right" if side == "left" else "left"]
