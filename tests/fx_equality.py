"""The running program and its export side by side: the same raw X, the same writes, the same clock."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import ClassVar

from interlock_scene import MACHINE
from stand_in import StandIn

from controller.core.expr import Bit, Word
from controller.core.program import Program
from controller.core.scan import Plc
from controller.fx.export import acting, export
from controller.fx.instruction import Ladder
from controller.fx.plc import FxPlc
from controller.program.states import Mode, State
from controller.program.tags import SIDES

EXPORTED = export(acting(MACHINE.program))
TAGS = MACHINE.tags
BUTTONS = ("start", "stop", "emergency_stop")
COMMANDS = [command.bit for command in TAGS.commands]
HARMLESS = [bit for bit in COMMANDS if bit != TAGS.commands["abort"]]
ANSWERS = [
    command.bit
    for command in TAGS.commands
    if command.name.startswith("tray_") or command.name.endswith(("_yes", "_no", "discard", "cups_empty"))
]


OTHER_WAYS = [
    (TAGS.sp.converge_at, 1),
    (TAGS.sp.descend_at_count, 12),
    (TAGS.sp.trays_target, 1),
    (TAGS.sp.no_tray, 10),
    (TAGS.sp.no_cups, 10),
]
"""Set-points that lead the sequences other ways."""


STEPS = [(bit.number, bit.name) for sequence in MACHINE.program.sequences() for bit, _ in sequence]
CLAMPING = [MACHINE.cycles[side]["close claws"] for side in SIDES]
DOWN = [MACHINE.io_map[f"{side}.lift_down"].number for side in SIDES]


class Differs(AssertionError):  # noqa: N818 - what was found, not what went wrong
    """The two gave different Y images; the message tells where."""


Scan = tuple[dict[Bit | Word, int], int, list[bool], list[bool]]
"""What a PLC was given in a scan, and what it gave: writes, time, levels, Y image."""


@dataclass
class Pair:
    """The program on the soft PLC, its export on the FX2N.

    Attributes:
        ladder: What the FX2N runs.
        filter_ms: Input filter of both.
        scans: Scans that were compared.
        moving: Those in which an output was on.
        tape: All that went in and came out.
        visited: Steps that have been on.
    """

    ladder: Ladder = EXPORTED
    filter_ms: int = 0
    scans: int = 0
    moving: int = 0
    tape: list[Scan] = field(default_factory=list)
    visited: set[str] = field(default_factory=set)
    soft: Plc = field(init=False)
    fx: FxPlc = field(init=False)

    def __post_init__(self) -> None:
        self.soft = Plc(MACHINE.program, input_filter_ms=self.filter_ms)
        self.fx = FxPlc(self.ladder, input_filter_ms=self.filter_ms)
        self._writes: dict[Bit | Word, int] = {}

    def write(self, device: Bit | Word, value: int) -> None:
        """Write a device of both before the next scan."""
        self._writes[device] = value
        self.soft.write(device, value)
        if isinstance(device, Bit):
            self.fx.memory.bits(device.kind)[device.number] = bool(value)
        else:
            self.fx.memory.set_word(device.kind, device.number, value)

    def power_cycle(self) -> None:
        """Lose and regain the power of both."""
        kept = self.soft.retained()
        self.soft = Plc(MACHINE.program, input_filter_ms=self.filter_ms)
        self.soft.restore(kept)
        self.fx.power_cycle()

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        """Scan both; return the Y image.

        Raises:
            Differs: They gave two.
        """
        soft, fx = self.soft.scan(now_ms, list(levels)), self.fx.scan(now_ms, list(levels))
        self.scans += 1
        self.moving += True in soft
        self.tape.append((self._writes, now_ms, list(levels), soft))
        self._writes = {}
        self.visited |= {name for number, name in STEPS if self.soft.memory.S[number]}
        if soft != fx:
            outputs = [f"Y{number:o}" for number in range(len(soft)) if soft[number] != fx[number]]
            raise Differs(f"scan {self.scans} at {now_ms} ms: {', '.join(outputs)}; first unlike: {self.unlike()[:8]}")
        return soft

    def unlike(self) -> list[str]:
        """Return the devices that are not alike in the two memories."""
        mine, its = self.soft.memory, self.fx.memory
        found = [
            f"{kind}{number}"
            for kind in "MSTC"
            for number, (one, other) in enumerate(zip(mine.bits(kind), its.bits(kind), strict=True))
            if one != other and number < 8000
        ]
        return found + [f"D{number}" for number in range(8000) if mine.D[number] != its.D[number]]


def stories(seed: int, scans: int, *, power_fails: bool = True) -> Iterator[tuple[Pair, int]]:
    """Run a machine through what chance brings, and yield the pair after each scan with its number.

    A stand-in for the machine follows the coils. Somebody presses what leads on, and now and then anything else;
    switches stick, terminals flicker, set-points change, the power fails, scans come late.
    """
    chance = Random(seed)
    pair, world = Pair(), StandIn(MACHINE.io_map)
    image = MACHINE.io_map.safe_outputs()
    limits = list(TAGS.sp.limits.items())
    now_ms, period_ms, hold = 0, 20, 0
    for number in range(scans):
        if number == 1:  # the FX2N writes the first values of set-points in its first scan
            for word, value in OTHER_WAYS:
                if chance.random() < 0.4:
                    pair.write(word, value)
        levels = world.advance(period_ms, image)
        hold -= 1
        if hold <= 0:
            world.pressed = set()
        if chance.random() < 0.04:
            hold = _press(pair, world, chance)
        if chance.random() < 0.005:
            pair.write(chance.choice(HARMLESS), 1)
        if chance.random() < 0.002:
            word, (lowest, highest) = chance.choice(limits)
            pair.write(word, chance.choice((lowest, highest, chance.randint(lowest, highest))))
        if chance.random() < 0.003 or (world.stuck and chance.random() < 0.02):
            world.stuck = {chance.randrange(len(levels)): chance.random() < 0.5} if not world.stuck else {}
        if chance.random() < 0.0005:
            bit = chance.choice(TAGS.system.bits())
            pair.write(bit, 1)
        elif chance.random() < 0.2:
            for bit in TAGS.system.bits():
                pair.write(bit, 0)
        clamping = any(pair.soft.read(step) for step in CLAMPING)
        if power_fails and chance.random() < (0.05 if clamping else 0.0005):
            pair.power_cycle()
        if clamping and chance.random() < 0.05:
            pair.write(TAGS.commands["abort"], 1)
            world.stuck = {chance.choice(DOWN): False}
        world.trays_come = number % 900 > 150
        world.cups_come = number % 700 > 100
        if chance.random() < 0.01:
            flickers = chance.randrange(len(levels))
            levels[flickers] = not levels[flickers]
        period_ms = chance.choice((10, 20, 20, 50)) if chance.random() < 0.1 else period_ms
        now_ms += period_ms
        image = pair.scan(now_ms, levels)
        yield pair, number


def _press(pair: Pair, world: StandIn, chance: Random) -> int:
    """Press what leads on from the state the machine is in, or something else; return for how many scans."""
    state = pair.soft.read(TAGS.machine.state)
    if chance.random() < 0.3:
        pair.write(chance.choice(ANSWERS), 1)
    if state == State.STOPPED and chance.random() < 0.2:
        mode = chance.choice([*Mode, Mode.CONTINUOUS, Mode.CONTINUOUS])
        pair.write(TAGS.commands[f"mode_{mode.name.lower()}"], 1)
        return 1
    if state == State.ABORTED:
        world.pressed = {"stop"}
        return 160
    if pair.soft.read(TAGS.machine.manual) and state == State.EXECUTE:
        pair.write(chance.choice(list(TAGS.commands.jog.values())), 1)
        return 1
    if state == State.EXECUTE:
        world.pressed = {chance.choice(BUTTONS)} if chance.random() < 0.02 else set()
        pair.write(TAGS.commands["step"], 1)
    else:
        world.pressed = {"start"}
    return chance.randint(1, 6)


class Mirror(Plc):
    """A PLC of the running program with the exported one beside it; what it is given, both are given.

    Attributes:
        found: What differed, over all of them; a runtime would take an exception for a fault of the scan.
        compared: Scans that were compared, over all of them.
    """

    found: ClassVar[list[str]] = []
    compared: ClassVar[int] = 0

    def __init__(self, program: Program, *, input_filter_ms: int = 10) -> None:
        super().__init__(program, input_filter_ms=input_filter_ms)
        self._fx = FxPlc(EXPORTED, input_filter_ms=input_filter_ms)
        self._fx.memory.M[FIRST_VALUES_WRITTEN] = True  # from equal memory: the soft PLC has its first values already
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
        soft, fx = super().scan(now_ms, levels), self._fx.scan(now_ms, levels)
        Mirror.compared += 1
        if soft != fx:
            self.found.append(f"{now_ms} ms: {[f'Y{n:o}' for n in range(len(soft)) if soft[n] != fx[n]]}")
        return soft


FIRST_VALUES_WRITTEN = next(
    int(name[1:]) for name, text in EXPORTED.comments.items() if text.startswith("first values")
)


@dataclass(frozen=True)
class Recorded:
    """What a PLC was given in a story and what it gave: for each scan writes, time, levels, Y image."""

    scans: list[Scan]

    @classmethod
    def of(cls, seed: int, scans: int) -> Recorded:
        """Record a story without a loss of power."""
        *_, (pair, _) = stories(seed, scans, power_fails=False)
        return cls(pair.tape)

    def told_by(self, ladder: Ladder) -> int | None:
        """Return the number of the first scan in which a program gives another Y image; None = it never does."""
        plc = FxPlc(ladder, input_filter_ms=0)
        return next((n for n, scan in enumerate(self.scans) if _replayed(plc, scan) != scan[3]), None)

    def changed_by(self, ladder: Ladder) -> int | None:
        """Return the number of the first scan after which outputs, relays or states are not those of the export."""
        sound, plc = FxPlc(EXPORTED, input_filter_ms=0), FxPlc(ladder, input_filter_ms=0)
        for number, scan in enumerate(self.scans):
            if _replayed(plc, scan) != _replayed(sound, scan):
                return number
            if plc.memory.M != sound.memory.M or plc.memory.S != sound.memory.S:
                return number
        return None


def _replayed(plc: FxPlc, scan: Scan) -> list[bool]:
    writes, now_ms, levels, _ = scan
    for device, value in writes.items():
        if isinstance(device, Bit):
            plc.memory.bits(device.kind)[device.number] = bool(value)
        else:
            plc.memory.set_word(device.kind, device.number, value)
    return plc.scan(now_ms, levels)
