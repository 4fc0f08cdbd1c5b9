"""Comparison of the running program with its export; both receive the same raw X levels, writes and clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from random import Random
from typing import ClassVar

from controller.core.expr import Bit, Word
from controller.core.program import Program
from controller.core.scan import Execution, Plc
from controller.export.instruction_list import SCRATCH, acting, export
from controller.export.scan_supervision import COUNTER, LEAST_PER_S
from controller.export.sharing import RELAYS
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import Constant, DeviceOperand, Ladder
from controller.program.operator.buttons import ANSWER_PRESS_MS, CLEAR_PRESS_MS
from controller.program.set_points import ARMS_MAY_MEET
from controller.program.states import HOMED_FROM, Mode, State
from controller.program.tags import ROWS, SIDES
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.program.modes.stand_in import StandIn

ACTING = acting(MACHINE.program)
EXPORTED = export(ACTING)
TAGS = MACHINE.tags
BUTTONS = ("start", "stop", "emergency_stop")
COMMANDS = [command.bit for command in TAGS.commands]
HARMLESS = [bit for bit in COMMANDS if bit != TAGS.commands["abort"]]
ANSWERS = {
    TAGS.tray.ask: [TAGS.commands[name] for name in ("tray_same", "tray_full", "tray_none", "new_machine")],
    **{
        TAGS.arms[side].ask: [TAGS.commands[f"{side}_{name}"] for name in ("loaded_yes", "loaded_no", "discard")]
        for side in SIDES
    },
    **{TAGS.arms[side].ask_cups: [TAGS.commands["cups_empty"]] for side in SIDES},
}
"""Commands that answer each question."""
STATUS = [bit for bit in TAGS.system.bits() if bit != TAGS.system.memory_lost]
"""System bits that both PLCs are given; each detects a loss of its memory at power-up."""
EMPTY_ROWS = [bit for rows in TAGS.commands.row_empty.values() for bit in rows.values()]
"""Commands that state that a row is empty; without them, few trays become empty in a story."""
OTHER_WAYS = [
    (TAGS.sp.converge_at, 1),
    (TAGS.sp.descend_at_count, 12),
    (TAGS.sp.trays_target, 1),
    (TAGS.sp.no_tray, 10),
    (TAGS.sp.no_cups, 10),
    (TAGS.sp.tray_index, 100),
    (TAGS.sp.step_sequence, 3),
]
"""Set-point values that select alternative paths through the sequences."""
OTHER_CONSTANTS = [
    (TAGS.sp.arms_may_meet, 1 - ARMS_MAY_MEET),
    (TAGS.sp.clamp, 30),
    (TAGS.sp.release, 30),
    (TAGS.sp.slide_least, 60),
]
"""Value of each machine constant that differs from its default; a start with one of them is confirmed with X25."""


STEPS = [(bit.number, bit.name) for sequence in MACHINE.program.sequences() for bit, _ in sequence]
CLAMPING = [MACHINE.cycles[side]["close claws"] for side in SIDES]
SETTLING = [MACHINE.cycles[side]["settle at row"] for side in SIDES]
DOWN = [MACHINE.io_map[f"{side}.lift_down"].number for side in SIDES]
AT_ROW = [MACHINE.io_map[f"{side}.slide_at_pick_{row}"].number for side in SIDES for row in ROWS]
MOVING = [point.number for point in MACHINE.io_map.outputs if point.moves]
BEAM = MACHINE.io_map["tray_front_edge"].number
LEFT_CUP = MACHINE.io_map["left.cup_pulse"]
UNTIL_HOMING = (State.ABORTED, State.STOPPED)
"""States that homing follows."""
USUAL_REPAIR = 0.02
"""Probability that a switch that sticks is repaired in a scan."""
ANSWERED_MS, CLEARED_MS = ANSWER_PRESS_MS + 200, CLEAR_PRESS_MS + 200
"""Time for which a button is pressed to answer and to clear, ms."""


class Differs(AssertionError):  # noqa: N818 - a finding, not an error
    """Difference between two PLCs; the message states the scan and the outputs or devices that differ."""


Scan = tuple[dict[Bit | Word, int], int, list[bool], list[bool]]
"""Inputs and outputs of a PLC in one scan: writes, time, levels, Y image."""


@dataclass
class Pair:
    """Program on the soft PLC and its export on the simulated FX2N.

    Attributes:
        ladder: Program of the FX2N.
        constants: Machine constants of each start that differ from their defaults.
        filter_ms: Input filter time of both PLCs, ms.
        program: Program of the soft PLC.
        scans: Number of compared scans.
        moving: Number of scans in which an output that moves something was on.
        tape: Recorded inputs and outputs.
        visited: Steps that have been on.
        confirmed: Number of confirmations of the constants.
    """

    ladder: Ladder = EXPORTED
    constants: Mapping[Word, int] = field(default_factory=dict)
    filter_ms: int = 0
    program: Program = MACHINE.program
    scans: int = 0
    moving: int = 0
    tape: list[Scan] = field(default_factory=list)
    visited: set[str] = field(default_factory=set)
    confirmed: int = 0
    soft: Plc = field(init=False)
    fx: FxPlc = field(init=False)

    def __post_init__(self) -> None:
        self.soft = Plc(self.program, input_filter_ms=self.filter_ms)
        self.fx = FxPlc(with_constants(self.ladder, self.constants), input_filter_ms=self.filter_ms)
        self._writes: dict[Bit | Word, int] = {}
        self._states: list[bool] = []
        self.report_loss()
        self.give_constants()

    def report_loss(self) -> None:
        """Report the lost memory to the soft PLC; the FX2N detects it itself."""
        self.soft.write(TAGS.system.memory_lost, 1)

    def give_constants(self) -> None:
        """Write the constants before the first scan of a start."""
        for word, value in self.constants.items():
            self.write(word, value)

    def write(self, device: Bit | Word, value: int) -> None:
        """Write a device in both PLCs before the next scan."""
        self._writes[device] = value
        self.soft.write(device, value)
        if isinstance(device, Bit):
            self.fx.memory.bits(device.kind)[device.number] = bool(value)
        else:
            self.fx.memory.set_word(device.kind, device.number, value)

    def power_cycle(self, *, battery_low: bool = False) -> None:
        """Cycle the power of both PLCs; with a low battery, the memory is lost."""
        retained = self.soft.retained()
        self.soft = Plc(self.program, input_filter_ms=self.filter_ms)
        if battery_low:
            self.report_loss()
        else:
            self.soft.restore_retained(retained)
        self.fx.battery_low = battery_low
        self.fx.power_cycle()
        self.give_constants()

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        """Scan both PLCs and return the Y image.

        Raises:
            Differs: The Y images differ.
        """
        without_supervision(self.fx)
        unconfirmed = self.soft.read(TAGS.machine.constants_open)
        soft, fx = self.soft.scan(now_ms, list(levels)), self.fx.scan(now_ms, list(levels))
        self.soft.write(TAGS.system.memory_lost, 0)
        self.scans += 1
        self.moving += any(soft[number] for number in MOVING)
        self.confirmed += unconfirmed > self.soft.read(TAGS.machine.constants_open)
        self.tape.append((self._writes, now_ms, list(levels), soft))
        self._writes = {}
        if self._states != self.soft.memory.S:
            self._states = self.soft.memory.S.copy()
            self.visited |= {name for number, name in STEPS if self._states[number]}
        if soft != fx:
            outputs = [f"Y{number:o}" for number in range(len(soft)) if soft[number] != fx[number]]
            raise Differs(
                f"scan {self.scans} at {now_ms} ms: {', '.join(outputs)}; first differences: {self.differences()[:8]}"
            )
        return soft

    def differences(self) -> list[str]:
        """Return the devices whose values differ in the two memories, excluding the auxiliary devices of the export."""
        soft, fx = self.soft.memory, self.fx.memory
        found = [
            f"{kind}{number}"
            for kind in "MSTC"
            for number, (one, other) in enumerate(zip(soft.bits(kind), fx.bits(kind), strict=True))
            if one != other and number < 8000 and not (kind == "M" and number in RELAYS)
        ]
        return found + [
            f"D{number}" for number in range(8000) if soft.D[number] != fx.D[number] and number not in SCRATCH
        ]


def stories(
    seed: int, scans: int, *, power_fails: bool = True, kind: Callable[..., Pair] | None = None
) -> Iterator[tuple[Pair, int]]:
    """Run a machine with random events; after each scan, yield the pair and the scan number.

    A stand-in for the machine responds to the coils. Buttons that continue the cycle, and occasionally others, are
    pressed. Switches stick, terminals flicker, set-points change, power fails and scans are late. In half of the
    stories, machine constants differ from their defaults, and X25 is pressed to confirm them.

    Args:
        seed: Seed of the events.
        scans: Number of scans.
        power_fails: Whether the power fails at random moments.
        kind: Constructor of the pair; None = `Pair`.
    """
    chance = Random(seed)
    pair = (kind or Pair)(constants={word: value for word, value in OTHER_CONSTANTS if chance.random() < 0.15})
    panel = chance.random() < 0.5  # without the amber lamp, the buttons answer questions only while a panel shows them
    world = StandIn(MACHINE.io_map)
    image = MACHINE.io_map.safe_outputs()
    now_ms, period_ms, hold_ms, repair = 0, 20, 0, USUAL_REPAIR
    for number in range(scans):
        if number == 1:
            for word, value in OTHER_WAYS:
                if chance.random() < 0.4:
                    pair.write(word, value)
        levels = world.advance(period_ms, image)
        hold_ms -= period_ms
        if hold_ms <= 0:
            world.pressed = set()
        if hold_ms <= 0 and chance.random() < 0.04:  # a press that clears is completed
            hold_ms = _press(pair, world, chance)
        _command(pair, chance)
        repair = _stick(pair, world, chance, repair)
        if chance.random() < 0.0005:
            pair.write(chance.choice(STATUS), 1)
        elif chance.random() < 0.2:
            for bit in STATUS:
                pair.write(bit, bit == TAGS.system.panel_shown and panel)
        clamping = any(pair.soft.read(step) for step in CLAMPING)
        if power_fails and chance.random() < (0.02 if clamping else 0.0005):
            pair.power_cycle(battery_low=chance.random() < 0.1)
        if clamping and chance.random() < 0.02:
            pair.write(TAGS.commands["abort"], 1)
            world.stuck = {chance.choice(DOWN): False}
        world.trays_come = number % 900 > 150
        world.cups_come = number % 700 > 100
        if number % 700 > 600:
            levels[LEFT_CUP.number] = LEFT_CUP.inverted  # the right carousel alone counts
        settling = any(pair.soft.read(step) for step in SETTLING)
        if chance.random() < (0.05 if settling else 0.01):
            flickers = chance.choice(AT_ROW) if settling else chance.randrange(len(levels))
            levels[flickers] = not levels[flickers]
        period_ms = chance.choice((10, 20, 20, 50)) if chance.random() < 0.1 else period_ms
        now_ms += period_ms
        image = pair.scan(now_ms, levels)
        yield pair, number


def _command(pair: Pair, chance: Random) -> None:
    """Occasionally give a command or change a set-point; in step mode, frequently arm a step."""
    if chance.random() < 0.005:
        pair.write(chance.choice(HARMLESS), 1)
    if pair.soft.read(TAGS.machine.stepping) and chance.random() < 0.1:
        pair.write(TAGS.commands["step"], 1)
    if chance.random() < 0.002:
        word = chance.choice(ACTING.set_points)[0]
        lowest, highest = TAGS.sp.limits[word]
        value = chance.choice((lowest, highest, chance.randint(lowest, highest)))
        if pair.scans:  # the FX2N writes the initial set-points in its first scan
            pair.write(word, value)


def _stick(pair: Pair, world: StandIn, chance: Random, repair: float) -> float:
    """Let a switch stick, or repair it.

    A lower switch or a beam that is off remains so until homing begins, because clearing takes longer than most
    repairs and homing depends on these switches.

    Args:
        pair: The two PLCs.
        world: The machine.
        chance: Source of the events.
        repair: Probability that the present fault is repaired in this scan.

    Returns:
        Probability of a repair in the next scan.
    """
    stopped = pair.soft.read(TAGS.machine.state) in UNTIL_HOMING
    if stopped and not world.stuck and chance.random() < 0.003:
        world.stuck = {BEAM: False}
    kept = stopped and not world.stuck.keys().isdisjoint((BEAM, *DOWN))
    if chance.random() < 0.003 or (world.stuck and not kept and chance.random() < repair):
        world.stuck = {chance.randrange(MACHINE.io_map.input_count): chance.random() < 0.5} if not world.stuck else {}
        return chance.choice((USUAL_REPAIR, USUAL_REPAIR, 0.005))  # a third of the faults outlasts the time limits
    return repair


def _press(pair: Pair, world: StandIn, chance: Random) -> int:
    """Press the button that continues operation, or another one; return the time for which it is held, ms."""
    state = pair.soft.read(TAGS.machine.state)
    asked = [answers for question, answers in ANSWERS.items() if pair.soft.read(question)]
    if chance.random() < (0.6 if asked else 0.3):
        pair.write(chance.choice(chance.choice(asked or list(ANSWERS.values()))), 1)
    if chance.random() < 0.1:
        for bit in EMPTY_ROWS:
            pair.write(bit, chance.random() < 0.9)
    if asked and chance.random() < 0.3:
        world.pressed = {chance.choice(("start", "stop"))}
        return ANSWERED_MS
    if asked and state in HOMED_FROM and chance.random() < 0.5:
        pair.write(TAGS.commands["reset"], 1)  # X0 does not home while a question is shown
        return 20
    if pair.soft.read(TAGS.machine.constants_open) and chance.random() < 0.5:
        world.pressed = {"emergency_stop"}
        return 20 * chance.randint(1, 6)
    if state == State.STOPPED and chance.random() < 0.2:
        mode = chance.choice([*Mode, Mode.STEP, Mode.CONTINUOUS, Mode.CONTINUOUS])
        pair.write(TAGS.commands[f"mode_{mode.name.lower()}"], 1)
        return 20
    if state == State.HELD and chance.random() < 0.3:
        pair.write(TAGS.commands["unhold"], 1)
        return 20
    if state == State.ABORTED:
        world.pressed = {"stop"}
        return CLEARED_MS
    if pair.soft.read(TAGS.machine.manual) and state == State.EXECUTE:
        pair.write(chance.choice(list(TAGS.commands.jog.values())), 1)
        return 20
    if state == State.EXECUTE:
        world.pressed = {chance.choice(BUTTONS)} if chance.random() < 0.02 else set()
        pair.write(TAGS.commands["step"], 1)
    else:
        world.pressed = {"start"}
    return 20 * chance.randint(1, 6)


class Mirror(Plc):
    """PLC that runs the program and passes all its inputs to a second PLC, which runs the export.

    Attributes:
        found: Differences across all instances. They are collected because a runtime would treat an exception as a scan
            fault.
        compared: Number of compared scans across all instances.
    """

    found: ClassVar[list[str]] = []
    compared: ClassVar[int] = 0

    def __init__(self, program: Program, *, input_filter_ms: int = 10, execution: Execution | None = None) -> None:
        super().__init__(program, input_filter_ms=input_filter_ms, execution=execution)
        self._fx = FxPlc(EXPORTED, input_filter_ms=input_filter_ms)
        self._fx.memory.M[FIRST_VALUES_WRITTEN] = True  # equal memory: the soft PLC already has its initial values
        for word, value in program.set_points:
            self._fx.memory.D[word.number] = value

    def press(self, bit: Bit) -> None:
        super().press(bit)
        self._fx.memory.M[bit.number] = True

    def write(self, device: Bit | Word, value: int) -> None:
        super().write(device, value)
        if isinstance(device, Bit):
            self._fx.memory.bits(device.kind)[device.number] = bool(value)
        else:
            self._fx.memory.D[device.number] = value

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        without_supervision(self._fx)
        soft, fx = super().scan(now_ms, levels), self._fx.scan(now_ms, levels)
        Mirror.compared += 1
        if soft != fx:
            self.found.append(f"{now_ms} ms: {[f'Y{n:o}' for n in range(len(soft)) if soft[n] != fx[n]]}")
        return soft


FIRST_VALUES_WRITTEN = next(
    int(name[1:]) for name, text in EXPORTED.comments.items() if text.startswith("initial values")
)


@dataclass(frozen=True)
class Recorded:
    """Recorded inputs and outputs of a PLC: writes, time, levels and Y image of each scan; constants of the start."""

    scans: list[Scan]
    constants: Mapping[Word, int]

    @classmethod
    def of(cls, seed: int, scans: int) -> Recorded:
        """Record a run without power losses."""
        *_, (pair, _) = stories(seed, scans, power_fails=False)
        return cls(pair.tape, pair.constants)

    def first_output_difference(self, ladder: Ladder) -> int | None:
        """Return the number of the first scan in which a program's Y image differs from the recorded one, or None."""
        plc = self._started(ladder)
        return next((n for n, scan in enumerate(self.scans) if _replayed(plc, scan) != scan[3]), None)

    def without_difference(self, ladders: list[Ladder]) -> list[Ladder]:
        """Return the programs whose outputs, relays and states are equal to those of the export after every scan."""
        reference = self._started(EXPORTED)
        equal = [(ladder, self._started(ladder)) for ladder in ladders]
        for scan in self.scans:
            expected = _replayed(reference, scan), reference.memory.M, reference.memory.S
            equal = [
                (ladder, plc) for ladder, plc in equal if (_replayed(plc, scan), plc.memory.M, plc.memory.S) == expected
            ]
            if not equal:
                break
        return [ladder for ladder, _ in equal]

    def _started(self, ladder: Ladder) -> FxPlc:
        return FxPlc(with_constants(ladder, self.constants), input_filter_ms=0)


def _replayed(plc: FxPlc, scan: Scan) -> list[bool]:
    writes, now_ms, levels, _ = scan
    for device, value in writes.items():
        if isinstance(device, Bit):
            plc.memory.bits(device.kind)[device.number] = bool(value)
        else:
            plc.memory.set_word(device.kind, device.number, value)
    without_supervision(plc)
    return plc.scan(now_ms, levels)


def with_constants(ladder: Ladder, constants: Mapping[Word, int]) -> Ladder:
    """Return the export of the program with other machine constants: the first scan writes their values."""
    targets = {DeviceOperand(word.kind, word.number): Constant(value) for word, value in constants.items()}
    after_power_up = sorted(ladder.titles)[1]
    instructions = [
        replace(each, operands=(targets[each.operands[-1]], each.operands[-1]))
        if n < after_power_up and each.name == "MOV" and each.operands[-1] in targets
        else each
        for n, each in enumerate(ladder.instructions)
    ]
    return replace(ladder, instructions=tuple(instructions))


def without_supervision(plc: FxPlc) -> None:
    """Prevent the export from stopping the machine because of long scans, which the soft PLC measures differently."""
    plc.memory.D[COUNTER.number] = 2 * LEAST_PER_S
