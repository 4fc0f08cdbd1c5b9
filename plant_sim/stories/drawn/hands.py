"""Effects of the actions of a random story on the twin: buttons, commands, faults, hands, power and memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from controller.core.expr import Bit, any_of
from controller.program.operator.buttons import ANSWER_PRESS_MS
from controller.program.states import MOVING, Mode, Reason, State
from controller.program.tags import SIDES
from plant_sim.crop.seedling import COLUMNS, Location
from plant_sim.faults import FAULTS
from plant_sim.machine.stored_air import set_air
from plant_sim.stories.drawn.action import Deed, StoryAction
from plant_sim.twin.lock_step import CLEAR_MS, Twin
from plant_sim.twin.recovery import answer_truly, operate_manually, questions, true_tray

JOG_RENEWAL_MS: Final = 100
PUSH_M: Final = 0.001
"""Way of the trays in one scan while they are pushed, m."""
SETTLE_MS: Final = 200
RESTS: Final = (State.STOPPED, State.HELD, State.ABORTED, State.IDLE, State.COMPLETE, State.SUSPENDED)
"""States in which the operator acts."""


class Hands:
    """Player of the actions on one twin.

    Attributes:
        acted: Actions so far that had an effect, without those of the operator who tends the machine.
        ordered: Actions so far with which the operator ordered or moved something that may do harm: a false answer, a
            jog, a drive or tray moved by hand while the machine works, a load discarded.
        blind: Actions so far whose consequences no input shows: memory that was old or damaged and was accepted.
        taken_off: Trays that a person has taken off the belt.
    """

    def __init__(self, twin: Twin, remembered: Iterable[Bit] = ()) -> None:
        """Prepare the actions on a twin; `remembered` are bits of monitors that survive a loss of power."""
        self.acted: list[StoryAction] = []
        self.ordered: list[StoryAction] = []
        self.blind: list[StoryAction] = []
        self._twin = twin
        self.taken_off: set[int] = set()
        self._remembered = tuple(remembered)
        self._images: list[dict[str, int]] = []
        self._refused_in_idle = -1
        self._ends: list[tuple[int, str]] = []

    def do(self, action: StoryAction) -> bool:
        """Carry out an action; return True if it had an effect.

        Raises:
            FaultError: A fault changes the same value as an active one.
            NotReachedError: The machine does not react to the operator.
        """
        if self._twin.store.values is not None:
            self._images.append(dict(self._twin.store.values))
        acted = _DEEDS[action.deed](self, action)
        if acted and action.deed is not Deed.TEND:
            self.acted.append(action)
        return acted

    def end_statuses(self, *, by_ms: int | None = None) -> None:
        """End the reported conditions whose time is over, or all of them if no time is given, ms."""
        for end_ms, name in [*self._ends]:
            if by_ms is None or end_ms <= by_ms:
                self._ends.remove((end_ms, name))
                self._twin.plc.write(getattr(self._twin.machine.tags.system, name), 0)

    def next_end_ms(self) -> int | None:
        """Return the time at which the next reported condition ends, ms; None if there is none."""
        return min((end_ms for end_ms, _ in self._ends), default=None)

    def tend(self, _action: StoryAction | None = None) -> bool:
        """Do the next thing that is right at rest; nothing while the machine works or a button is pressed."""
        twin, state, box = self._twin, self._twin.state, self._twin.plant.box
        if box.start or box.stop:
            return False
        words = twin.machine.tags.machine
        mode, reason = twin.plc.read(words.mode), twin.plc.read(words.reason)
        if box.emergency_stop:
            box.emergency_stop = False
        elif state is State.ABORTED:
            twin.press("stop", for_ms=CLEAR_MS + SETTLE_MS)
        elif questions(twin) and state not in MOVING:
            self._answer()
        elif mode != Mode.CONTINUOUS and state in {State.STOPPED, State.EXECUTE}:
            twin.command("mode_continuous" if state is State.STOPPED else "stop")
        elif state is State.IDLE:
            self._start()
        elif state is State.SUSPENDED and reason == Reason.SUSPENDED_BY_OPERATOR:
            twin.command("unsuspend")
        elif state in RESTS:
            twin.confirm_constants()
            twin.press("start")
        else:
            return False
        return True

    def _answer(self) -> None:
        """Answer truthfully; take a tray off the belt if its true answer is refused, or if it is away from its mark.

        The rear corner of a skewed tray may be in the beam when the next one has been pushed back.
        """
        twin, refusals = self._twin, self._twin.machine.tags.machine.refusals
        before = twin.plc.read(refusals)
        asked = answer_truly(twin)
        refused = "tray" in questions(twin) and twin.plc.read(refusals) != before
        if refused or ("tray" in asked and twin.plant.conveyor.placed_tray is None):
            self._take_off()

    def _start(self) -> None:
        """Press X0 in Idle; after a refusal only homing helps, so that X24 is pressed."""
        twin = self._twin
        refused = twin.plc.read(twin.machine.tags.machine.refusals)
        twin.press("start" if self._refused_in_idle in {-1, refused} else "stop")
        self._refused_in_idle = refused if self._refused_in_idle in {-1, refused} else -1

    def answer_falsely(self, action: StoryAction) -> bool:
        """Wait for a question, for some time, and give the wrong answer to every open one."""
        twin, tags = self._twin, self._twin.machine.tags
        twin.runs_until(any_of(tags.tray.ask, *(arm.ask for arm in tags.arms.values())), for_ms=action.for_ms)
        asked = questions(twin)
        for side in SIDES:
            if f"{side} loaded" in asked:
                twin.command(f"{side}_loaded_{'no' if twin.plant.arms[side].grip.held else 'yes'}")
        if "tray" in asked:
            twin.command("tray_same" if true_tray(twin) == "full" else "tray_full")
        if asked:
            self.ordered.append(action)
        return bool(asked)

    def press(self, action: StoryAction) -> bool:
        """Press one or several buttons; a press that answers a question counts as an order."""
        for button in action.target.split("+"):
            self._twin.press(button, for_ms=action.for_ms or SETTLE_MS)
        if action.for_ms >= ANSWER_PRESS_MS and action.target in {"start", "stop"} and questions(self._twin):
            self.ordered.append(action)
        return True

    def command(self, action: StoryAction) -> bool:
        """Give a command; one that states something false about the crop counts as an order."""
        if not _is_true(self._twin, action.target):
            self.ordered.append(action)
        self._twin.command(action.target)
        return True

    def jog(self, action: StoryAction) -> bool:
        """Give and renew a jog command; it counts as an order if it moves something."""
        twin, before = self._twin, self._twin.outputs()
        moves = False
        for _ in range(max(1, action.for_ms // JOG_RENEWAL_MS)):
            twin.command(action.target)
            twin.run_for(JOG_RENEWAL_MS)
            moves = moves or twin.outputs() != before
        if twin.plc.read(twin.machine.tags.machine.mode) == Mode.MANUAL:
            self.ordered.append(action)
        return moves

    def fault(self, action: StoryAction) -> bool:
        """Let a fault strike; a permanent one has been set before the run."""
        if FAULTS[action.kind].permanent:
            return True
        self._twin.plant.faults.add(action.fault(self._twin.plant.time_ms))
        return True

    def mend(self, _action: StoryAction) -> bool:
        """End the fault that has lasted longest."""
        active = [fault for fault in self._twin.plant.faults.active if not FAULTS[fault.kind].permanent]
        if active:
            self._twin.plant.faults.clear(active[0].name)
        return bool(active)

    def air(self, action: StoryAction) -> bool:
        """Set the air in slides and lifts."""
        set_air(self._twin.plant, min(max(action.size or 0.0, 0.0), 1.0))
        return True

    def speed(self, action: StoryAction) -> bool:
        """Change the speed of the tractor."""
        self._twin.plant.planting_frequency_per_min = max(action.size or 0.0, 0.0)
        return True

    def power(self, action: StoryAction) -> bool:
        """Switch the controller off and on, with its memory kept, lost, old or damaged."""
        twin, kept = self._twin, self._twin.store.values
        if action.target == "old":
            self._old(action)
        elif action.target == "damaged" and kept:
            name = sorted(kept)[int((action.size or 0.0) * (len(kept) - 1))]
            twin.store.values = {**kept, name: (kept[name] + 1) % 4 if name.startswith("D") else 1 - kept[name]}
            self.blind.append(action)
        elif action.target == "lost":
            twin.store.values = None
        try:
            self._restart(action.for_ms, lost=twin.store.values is None)
        except ValueError:  # the value is none that the program can have stored: the memory is set aside
            twin.store.values = None
            self._restart(0, lost=True)
        return True

    def _old(self, action: StoryAction) -> None:
        """Restore an earlier copy of the complete memory."""
        images = self._images or [dict(self._twin.store.values or {})]
        image = images[int((action.size or 0.0) * (len(images) - 1))]
        if image and image != self._twin.store.values:
            self._twin.store.values = dict(image)
            self.blind.append(action)

    def _restart(self, off_ms: int, *, lost: bool) -> None:
        """Restart the controller; what the monitors of the program remember of the machine is kept."""
        twin = self._twin
        remembered = {bit: twin.plc.read(bit) for bit in self._remembered}
        self.end_statuses()
        twin.power_cycle(off_ms)
        for bit, value in remembered.items():
            twin.plc.write(bit, value)
        if lost:
            twin.plc.write(twin.machine.tags.system.memory_lost, 1)
        twin.scan()

    def push(self, action: StoryAction) -> bool:
        """Push the trays with the belt; while the machine works this counts as an order."""
        if self._twin.state in MOVING:
            self.ordered.append(action)
        way_m = (action.size or 0.0) / 1000
        sign = 1.0 if way_m > 0.0 else -1.0
        while abs(way_m) > 0.0:
            part_m = sign * min(PUSH_M, abs(way_m))
            self._twin.plant.conveyor.push(part_m)
            self._twin.scan()
            way_m = 0.0 if abs(way_m) <= PUSH_M else way_m - part_m
        return bool(self._twin.plant.conveyor.front_m)

    def override(self, action: StoryAction) -> bool:
        """Operate a valve by its manual override while the machine is at rest."""
        if self._twin.state in MOVING or self._twin.plant.box.emergency_stop:
            return False
        self.ordered.append(action)
        operate_manually(self._twin, action.target, for_ms=action.for_ms)
        return True

    def take_off(self, _action: StoryAction) -> bool:
        """Take the tray in the beam off the belt while the machine is at rest."""
        if self._twin.state in MOVING or any(arm.grip.held for arm in self._twin.plant.arms.values()):
            return False
        return self._take_off()

    def _take_off(self) -> bool:
        conveyor = self._twin.plant.conveyor
        there = conveyor.in_beam
        for number in there:
            conveyor.take_off(number)
        self.taken_off.update(there)
        return bool(there)

    def status(self, action: StoryAction) -> bool:
        """Report a condition of the runtime to the program for some time."""
        twin = self._twin
        twin.plc.write(getattr(twin.machine.tags.system, action.target), 1)
        self._ends.append((twin.now_ms + action.for_ms, action.target))
        return True


_DEEDS: Final[Mapping[Deed, Callable[[Hands, StoryAction], bool]]] = {deed: getattr(Hands, deed.value) for deed in Deed}


def _is_true(twin: Twin, command: str) -> bool:
    """Return False if a command states something about claws, tray or cups that is not so, or throws a load away."""
    for side in SIDES:
        held = bool(twin.plant.arms[side].grip.held)
        if command in {f"{side}_loaded_yes", f"{side}_loaded_no"}:
            return held == command.endswith("yes")
        if command == f"{side}_discard":
            return not held
    if command.startswith("tray_"):
        return command == f"tray_{true_tray(twin)}"
    if "_row_" in command or command == "rows_full":
        return _is_row_stated_truly(twin, command)
    return command != "cups_empty"


def _is_row_stated_truly(twin: Twin, command: str) -> bool:
    """Compare a statement about the rows of the tray in place with the tray."""
    number = twin.plant.conveyor.placed_tray
    if number is None:
        return False
    if command == "rows_full":
        return all(_is_standing(twin, number, column) for column in range(COLUMNS))
    side, _, row, _ = command.split("_")
    column = int(row) - 1 if side == "left" else COLUMNS - int(row)
    return not _is_standing(twin, number, column)


def _is_standing(twin: Twin, number: int, column: int) -> bool:
    plants = twin.plant.seedlings.column(number, column)
    return any(each.location is Location.STANDING for each in plants)
