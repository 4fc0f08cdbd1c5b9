"""Safety requirements of the machine in terms of terminals, coils and the effects of coils.

The interlocks rely on the stored states of the program. The monitors derive the same facts from the coils and store
them separately. The proof (`python -m controller prove`) shows that the monitors and the stored states never disagree;
tests check this as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from controller.core.expr import FALSE, Bit, Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Out, Rst, Rung, Set
from controller.core.sequence import Sequence
from controller.core.specification import Requirement
from controller.program.areas import Area
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.machine import Transplanter
from controller.program.operator.commands import JOGGED
from controller.program.requirements.counts import CountMonitor
from controller.program.requirements.declaration import DeclarationMonitor
from controller.program.requirements.positions import PositionMonitor
from controller.program.requirements.safeguards import GuardedPressMonitor, guarded, warned
from controller.program.states import Mode, State
from controller.program.tags import FIRST_SCAN, FULL, IN_PLACE, MOVING_OUT, ROWS, SIDES, TAKEN, ArmTags, Side, Tags

_JOGGED_TAGS = frozenset({*JOGGED, "tray_forward"})


class ArmMonitor:
    """Monitor of the effects of one arm's coils."""

    def __init__(self, tags: Tags, side: Side, cycle: Sequence) -> None:
        m = Area("M", 470 + 9 * SIDES.index(side), 478 + 9 * SIDES.index(side), f"{side} monitor")
        self._tags, self._side, self._cycle = tags, side, cycle
        self.positions = PositionMonitor(tags, side)
        self.counts = CountMonitor(tags, side)
        self.open = m.bit("open", "the claws have opened since they last closed")
        self.gripped = m.bit("gripped", "the claws have closed for their dwell time since they last opened, or unknown")
        self.holds = m.bit("holds", "the claws have closed at a row since they last opened, or unknown")
        self.unmoved = m.bit("unmoved", "the slide has not been driven since the claws closed at a row")
        self.released = m.bit("released", "a cup has been counted, its release has begun at once and goes on")
        self.discarded = m.bit("discarded", "the operator has discarded the load")
        self.arrived = m.bit("arrived", "a switch at or beyond the next row has been on since the slide left feed")
        self.in_centre = m.bit("in centre", "the arm may be inward of pick 2; it is not certainly at feed or at row 2")

    @property
    def remembered(self) -> tuple[Bit, ...]:
        """Bits that are retained through a loss of power."""
        own = (self.open, self.gripped, self.holds, self.unmoved, self.arrived, self.in_centre)
        return (*own, *self.positions.remembered)

    def rungs(self) -> list[Rung]:
        """Return the rungs of the monitor; they follow the outputs in the scan."""
        tags, a = self._tags, self._tags.arms[self._side]
        y, commands = a.coils, tags.commands
        yes, discard = commands.loaded_yes[self._side], commands.discard[self._side]
        no = all_of(commands.loaded_no[self._side], ~yes, ~discard)
        certainly = self.positions.certainly
        over_row = ~certainly("feed")
        # claws that are not opening by now would release the load later than its cups
        releasing = self._cycle["release delay"] | (self._cycle["open claws"] & y["claws_open"])
        stated = any_of(self.discarded, discard, commands.loaded_no[self._side], tags.machine.manual)
        released = all_of(a.opened, self.released, self.holds, ~stated)
        return [
            *self.positions.places(),
            *self.counts.rungs(released),
            Set(self.open, when=a.opened),
            Rst(self.open, when=y["claws_close"]),
            Set(self.gripped, when=any_of(a.t_closing.done, yes, discard, FIRST_SCAN & ~a.claws_known)),
            Rst(self.gripped, when=y["claws_open"] | a.opened),
            Rst(self.holds, when=a.opened | (no & a.ask)),
            Set(self.holds, when=y["claws_close"] & over_row),
            Rst(self.unmoved, when=y["slide_inward"] | y["slide_outward"]),
            Set(self.unmoved, when=y["claws_close"] & over_row),
            Set(self.released, when=a.cup & a.count_good),
            Rst(self.released, when=any_of(~releasing, a.opened, ~tags.machine.motion)),
            Set(self.discarded, when=discard),
            Rst(self.discarded, when=a.opened),
            Rst(self.arrived, when=certainly("feed")),
            Set(self.arrived, when=_at_or_beyond_next_row(a)),
            Rst(self.in_centre, when=certainly("feed") | (certainly("pick 2") & ~y["slide_inward"])),
            Set(self.in_centre, when=(y["slide_inward"] & ~a.row_is[1]) | a.sensed_at_pick[3]),
            *self.positions.motion(),
        ]


class MachineMonitor:
    """Monitor of the machine: motion in the last scan and commands since then."""

    def __init__(self, tags: Tags, busy: Expr) -> None:
        m = Area("M", 488, 499, "monitor")
        self._tags, self._busy = tags, busy
        self.moved = m.bit("moved", "the last scan allowed motion")
        self.pressed = m.bit("pressed", "a button was pressed or a command given that can start motion, this scan")
        self.restarted = m.bit("restarted", "a coil came on from rest without a button or command")
        self.jogged = m.bit("jogged", "the last scan jogged an output")
        self.jog_unbidden = m.bit("jog without command", "an output is jogged without a command")
        self.cleared_unbidden = m.bit(
            "clearing without command", "the state is Clearing without the end of a press or a command"
        )
        self.stop_on = m.bit("stop on", "X24 was on in the last scan, and the link not lost")
        self.reset_on = m.bit("reset on", "the reset button was on in the last scan, and the link not lost")
        self.emergency_on = m.bit("emergency stop on", "X25 was on when it was last read")
        self.tray_fed = m.bit(
            "tray fed",
            "the feeder has driven the belt, or a tray confirmed, since Aborted, manual mode, power-up, guard open",
        )
        self.unconfirmed = m.bit("unconfirmed", "constants differed at power-up; X25 has not been on and off since")
        self.ordered = Area("M", 478, 478, "monitor").bit("ordered", "an order waits for the start warning, or begins")
        self.unwarned = Area("M", 487, 487, "monitor").bit(
            "unwarned", "the machine has been at rest, and no start warning has been completed since"
        )
        self.after_guard = m.bit("after guard", "the guard has been open since the last fresh order")

    def rungs(self) -> list[Rung]:
        """Return the rungs of the monitor; they follow the outputs in the scan."""
        tags, x, lost = self._tags, self._tags.x, self._tags.system.link_lost
        machine, commands = tags.machine, tags.commands
        reset = x.optional("reset")
        reset_on = FALSE if reset is None else reset & ~lost
        pressed = machine.start_pressed & x.start
        stop_released, reset_released = self.stop_on & ~x.stop, self.reset_on & ~reset_on
        asked = any_of(*commands.jog.values())
        defaults = dict(tags.sp.defaults)
        differ = any_of(*(word.differs(defaults[word]) for word in tags.sp.constants))
        return [
            Out(
                self.pressed,
                when=any_of((pressed | reset_released) & ~FIRST_SCAN, commands.start, commands.reset, commands.unhold),
            ),
            *self._warning_rungs(),
            Out(
                self.restarted,
                when=all_of(any_coil(tags), ~self.moved, ~(self.ordered if tags.warns else self.pressed)),
            ),
            Out(self.moved, when=machine.motion),
            Out(self.jog_unbidden, when=all_of(machine.manual, any_coil(tags), ~self.jogged, ~asked)),
            Out(self.jogged, when=machine.jog.differs(0)),
            Out(
                self.cleared_unbidden,
                when=machine.state.equals(State.CLEARING) & ~any_of(stop_released, reset_released, commands.clear),
            ),
            Out(self.stop_on, when=x.stop & ~lost),
            Out(self.reset_on, when=reset_on),
            Set(self.tray_fed, when=any_of(commands.tray_same, commands.tray_full, tags.tray.driven["tray_forward"])),
            Rst(
                self.tray_fed,
                when=any_of(machine.state.equals(State.ABORTED), machine.mode.equals(Mode.MANUAL), x.guard_open),
            ),
            Set(self.unconfirmed, when=FIRST_SCAN & differ),
            Rst(self.unconfirmed, when=all_of(self.emergency_on, ~x.emergency_stop, ~lost)),
            Set(self.emergency_on, when=x.emergency_stop & ~lost),
            Rst(self.emergency_on, when=~x.emergency_stop & ~lost),
            *self._guard_rungs(),
        ]

    def _warning_rungs(self) -> list[Rung]:
        """Return the rungs that record orders which wait for the start warning, and a rest without one since.

        In Suspended, the machine rests if all coils are off and each step waits for an event.
        """
        tags, machine = self._tags, self._tags.machine
        if not tags.warns:
            return []
        waits = any_of(machine.home_waits, machine.go_waits, machine.t_warning.done)
        rests = all_of(machine.state.equals(State.SUSPENDED), ~self._busy, ~any_coil(tags))
        return [
            Out(self.ordered, when=self.pressed | (self.ordered & waits)),
            Rst(self.unwarned, when=machine.t_warning.done),
            Set(self.unwarned, when=~machine.motion | rests),
        ]

    def _guard_rungs(self) -> list[Rung]:
        """Return the rungs that record a guard that has been open since the last order; none without its input."""
        opened = self._tags.x.guard_open
        if opened is FALSE:
            return []
        return [Rst(self.after_guard, when=self.pressed), Set(self.after_guard, when=opened)]


def _jogged(tags: Tags, tag: str) -> Expr:
    """Return the condition that the last jog command was for an output; the belt has two outputs."""
    return tags.machine.jogs["tray_run" if tag == "tray_forward" else tag] if tag in _JOGGED_TAGS else FALSE


def any_coil(tags: Tags) -> Expr:
    """Return the condition that any output of the I/O map that moves something is on."""
    return any_of(*tags.moving.values())


class Safety:
    """All monitors and requirements of the machine."""

    def __init__(self, program: Transplanter, busy: Expr = FALSE) -> None:
        """Create the monitors.

        Args:
            program: Program of the machine.
            busy: Condition that a step of a sequence moves something or lasts a fixed time.
        """
        tags, alarms = program.tags, program.alarms
        self.arms = {side: ArmMonitor(tags, side, program.cycles[side]) for side in SIDES}
        self.machine = MachineMonitor(tags, busy)
        self.declaration = DeclarationMonitor(tags)
        self.guarded_presses = GuardedPressMonitor(tags)
        rungs = [*(rung for arm in self.arms.values() for rung in arm.rungs()), *self.machine.rungs()]
        self.monitors = Block("monitors", (*rungs, *self.declaration.rungs(), *self.guarded_presses.rungs()))
        self.requirements = (
            *(each for side in SIDES for each in _of_arm(tags, side, self.arms, any_of(*alarms.of_side(side)))),
            *(each for arm in self.arms.values() for each in arm.counts.requirements()),
            *_of_machine(tags, self.arms, self.machine, alarms.tray_jam | alarms.tray_lost),
            *self.declaration.requirements(),
            *self.guarded_presses.requirements(),
        )

    @property
    def remembered(self) -> tuple[Bit, ...]:
        """Bits of the monitors that are retained through a loss of power."""
        return tuple(bit for arm in self.arms.values() for bit in arm.remembered)


def _of_arm(tags: Tags, side: Side, monitors: dict[Side, ArmMonitor], fault: Expr) -> Iterator[Requirement]:
    a, monitor = tags.arms[side], monitors[side]
    other = monitors["right" if side == "left" else "left"]
    y, tray, certainly = a.coils, tags.tray, monitor.positions.certainly
    up, down, feed, spread, converged = (certainly(place) for place in ("up", "down", "feed", "spread", "converged"))
    inward, outward, raises, lowers = (y[name] for name in (*SLIDE, *reversed(LIFT)))
    spreads, converges, opens, closes = (y[name] for name in (*BELT, *CLAWS))
    belt, slide_or_lift = spreads | converges, any_of(*(y[name] for name in (*SLIDE, *LIFT)))
    over_cups = all_of(feed, down, spread, monitor.released | monitor.discarded)
    both_at_row_2 = a.row_is[2] & tags.other(side).row_is[2]
    never = {
        **{
            f"{one} with {two}": ("two opposing coils of a valve or motor must not be on together", y[one] & y[two])
            for one, two in (SLIDE, LIFT, BELT, CLAWS)
        },
        "inward, not down": ("the arm would collide with the tray or pass over it", inward & ~down),
        "inward, claws not open": ("closed claws tear the seedlings", inward & ~monitor.open),
        "inward, not converged": ("spread claws do not fit between the seedlings", inward & ~converged),
        "inward, no tray at rest": (
            "the arm moves in only over a tray at rest",
            inward & ~all_of(tray.edge, tray.phase.equals(IN_PLACE)),
        ),
        "inward, past the row": ("there are seedlings beyond the next row", inward & monitor.arrived),
        "inward, tray unknown": (
            "while a question about the tray is unanswered, the tray may be misplaced",
            inward & tray.ask,
        ),
        "inward, other arm in the centre": (
            "the fingers of both arms do not fit in the centre together",
            all_of(inward, ~a.row_is[1], tags.sp.arms_may_meet.equals(0), other.in_centre, ~both_at_row_2),
        ),
        "close away from row and feed": (
            "claws may close only at the next row or at feed",
            closes & ~feed & ~(down & _at_next_row(a, certainly)),
        ),
        "up, claws neither open nor clamped": (
            "over the tray the lift moves up only with the claws clamped or open",
            all_of(raises, ~feed, ~monitor.open, ~monitor.gripped),
        ),
        "outward with a load, not up": (
            "the load would be dragged through the tray",
            all_of(outward, monitor.holds, ~up),
        ),
        "outward, not up, claws not open": (
            "closed claws would tear the seedlings",
            all_of(outward, ~up, ~(down & monitor.open)),
        ),
        "down away from feed": (
            "the arm would move down into the tray, except at the row it has just gripped",
            lowers & ~feed & ~monitor.unmoved,
        ),
        "down over the cups with a load, not spread": (
            "converged or half spread claws would press the load onto the rims of the cups",
            all_of(lowers, monitor.holds, a.sensed_at_feed, ~spread),
        ),
        "spread, not up at feed": ("there is room for spread claws only over the cups", spreads & ~(up & feed)),
        "belt with slide or lift": ("slide and lift must be at rest while the belt runs", belt & slide_or_lift),
        "converge with a load": ("converging would tear the seedlings", converges & monitor.holds),
        "belt against its end stop": (
            "the motor may run against its end stop only to verify a switch",
            (spreads & a.sensed_spread & a.reached["spread"])
            | (converges & a.sensed_converged & a.reached["converged"]),
        ),
        "converge away from feed": ("claws may change their pitch only at feed", converges & ~feed),
        "load released away from its cups and row": (
            "a load may be released only over its cups, at its own row, or after a discard command",
            all_of(opens, monitor.holds, ~over_cups, ~(monitor.unmoved & down)),
        ),
        "coil on while out of service": ("an arm out of service stays at feed", a.out_of_service & any_of(*y.values())),
        "coil on during a fault": (
            "a jammed actuator may be driven only in manual mode",
            all_of(fault, ~tags.machine.manual, any_of(*y.values())),
        ),
    }
    return (Requirement(f"{side}: {name}", reason, when) for name, (reason, when) in never.items())


def _at_next_row(a: ArmTags, certainly: Callable[[str], Expr]) -> Expr:
    """Return the condition that the slide is certainly at the first row that is not taken."""
    return any_of(
        *(
            all_of(
                certainly(f"pick {row}"),
                a.rows[row].differs(TAKEN),
                *(a.rows[k].equals(TAKEN) for k in ROWS if k < row),
            )
            for row in ROWS
        )
    )


def _at_or_beyond_next_row(a: ArmTags) -> Expr:
    return any_of(*(a.row_is[row] & a.sensed_at_pick[pick] for row in ROWS for pick in ROWS if pick >= row))


def _of_machine(
    tags: Tags, monitors: dict[Side, ArmMonitor], monitor: MachineMonitor, tray_fault: Expr
) -> Iterator[Requirement]:
    machine, x = tags.machine, tags.x
    moves = any_coil(tags)
    arms = tuple(tags.arms.values())
    run, forward = tags.tray.driven["tray_run"], tags.tray.driven["tray_forward"]
    away = any_of(*(~arm.positions.certainly("feed") for arm in monitors.values()))
    entering = any_of(*(a.coils["slide_inward"] for a in arms))
    never = {
        "motion during an emergency stop": ("no motion during an emergency stop", moves & x.emergency_stop),
        **guarded(tags, moves & monitor.after_guard, moves),
        **warned(tags, moves & monitor.unwarned),
        "motion without inputs": ("no motion while the field link is lost", moves & tags.system.link_lost),
        "motion after a scan or store fault": (
            "outputs must be off after such a fault",
            moves & (tags.system.scan_fault | tags.system.store_fault),
        ),
        "motion without outputs": (
            "no motion while another master has the outputs",
            moves & tags.system.outputs_taken,
        ),
        "motion in a state that does not allow it": (
            "no motion in a state that does not allow it",
            moves & ~machine.motion,
        ),
        "both arms out of service": (
            "the machine cannot work without an arm",
            all_of(*(arm.out_of_service for arm in arms)),
        ),
        "motion in the first scan": ("no motion at power-up", moves & FIRST_SCAN),
        "clearing without the end of a press or a command": (
            "only a person who releases X24 or the reset button, or gives the command, ends an emergency stop; "
            "a stuck button and a broken wire do not",
            monitor.cleared_unbidden,
        ),
        "homing before the constants are confirmed": (
            "constants that differ from their defaults are confirmed with X25 before the first homing of a start",
            machine.entered_resetting & monitor.unconfirmed,
        ),
        "restart without a command": ("after a stop, motion requires a new command", monitor.restarted),
        "jog without renewal": (
            "motion must stop when a jog is released or not renewed",
            machine.manual & moves & (machine.t_jog_lease.done | machine.jog.equals(0)),
        ),
        "jog without command": ("an output is jogged only by command", monitor.jog_unbidden),
        "another output than the jogged one": (
            "in manual mode, at most the output of the last jog command is on",
            machine.manual & any_of(*(coil & ~_jogged(tags, tag) for tag, coil in tags.moving.items())),
        ),
        "full rows leave without an order": (
            "a tray leaves with full rows only to empty the line, or for an arm out of service",
            all_of(
                tags.tray.leaves & tags.tray.phase.equals(MOVING_OUT),
                any_of(*(row.equals(FULL) & ~arm.out_of_service for arm in arms for row in arm.rows.values())),
                ~machine.emptying,
            ),
        ),
        "tray moves with an arm away from feed": ("a moving tray would damage an arm in it", (run | forward) & away),
        "tray moves while an arm moves in": ("the arm moves in only over a tray at rest", (run | forward) & entering),
        "inward, tray perhaps moved": (
            "a tray may have been moved by hand in Aborted, in manual mode, or without power",
            all_of(entering, ~machine.manual, ~monitor.tray_fed),
        ),
        "tray moves in the wrong direction": ("the belt moves only forward", run & ~forward),
        "tray moves during a fault": (
            "a jammed tray may be driven only in manual mode",
            all_of(tray_fault, ~machine.manual, run | forward),
        ),
    }
    return (Requirement(name, reason, when) for name, (reason, when) in never.items())
