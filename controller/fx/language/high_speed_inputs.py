"""Input terminals of the high-speed counters, and conflicts between the users of a fast input.

The terminals follow the FX programming manual as remembered (from memory; the grouping of the counters by number of
phases is verified, docs/sources/fx2n.md 1.5).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder, Pointer
from controller.fx.language.operand_rules import FIRST_HIGH_SPEED

Phases = Literal["direction", "up and down", "A and B"]
"""Counting by one input and a direction relay, by two inputs for up and down, and by two phases."""


@dataclass(frozen=True, slots=True)
class CounterInputs:
    """Terminals of one high-speed counter, as numbers of X.

    Attributes:
        phases: Kind of the counter.
        count: Counting terminals: one, or up and down, or A and B.
        reset: Terminal that holds the counter at 0 while it is on.
        start: Terminal without which the counter does not count.
    """

    phases: Phases
    count: tuple[int, ...]
    reset: int | None = None
    start: int | None = None

    @property
    def terminals(self) -> tuple[int, ...]:
        """All terminals of the counter."""
        return self.count + tuple(number for number in (self.reset, self.start) if number is not None)


COUNTER_INPUTS: Final = {
    **{FIRST_HIGH_SPEED + n: CounterInputs("direction", (n,)) for n in range(6)},
    241: CounterInputs("direction", (0,), 1),
    242: CounterInputs("direction", (2,), 3),
    243: CounterInputs("direction", (4,), 5),
    244: CounterInputs("direction", (0,), 1, 6),
    245: CounterInputs("direction", (2,), 3, 7),
    246: CounterInputs("up and down", (0, 1)),
    247: CounterInputs("up and down", (0, 1), 2),
    248: CounterInputs("up and down", (3, 4), 5),
    249: CounterInputs("up and down", (0, 1), 2, 6),
    250: CounterInputs("up and down", (3, 4), 5, 7),
    251: CounterInputs("A and B", (0, 1)),
    252: CounterInputs("A and B", (0, 1), 2),
    253: CounterInputs("A and B", (3, 4), 5),
    254: CounterInputs("A and B", (0, 1), 2, 6),
    255: CounterInputs("A and B", (3, 4), 5, 7),
}
"""Terminals of C235 to C255."""


def high_speed_coils(ladder: Ladder) -> dict[int, Instruction]:
    """Return the first OUT of each high-speed counter."""
    found: dict[int, Instruction] = {}
    for instruction in ladder.instructions:
        match instruction:
            case Instruction("OUT", (DeviceOperand("C", number), *_)) if number >= FIRST_HIGH_SPEED:
                found.setdefault(number, instruction)
    return found


def input_conflicts(ladder: Ladder) -> Iterator[tuple[int, str]]:
    """Yield the line and the text for each fast input that two counters, interrupts or SPD use."""
    users: dict[int, str] = {}
    for name, line, terminals in _users(ladder):
        taken = next((number for number in terminals if users.get(number, name) != name), None)
        if taken is not None:
            yield line, f"{name} and {users[taken]} both use X{taken}; an input has only one fast function"
        users.update(dict.fromkeys(terminals, name))


def _users(ladder: Ladder) -> Iterator[tuple[str, int, tuple[int, ...]]]:
    """Yield the name, line and terminals of each user of fast inputs."""
    for number, coil in high_speed_coils(ladder).items():
        yield f"C{number}", coil.line, COUNTER_INPUTS[number].terminals
    for instruction in ladder.instructions:
        match instruction:
            case Instruction("I", (Pointer("I", number),)) if (terminal := interrupt_terminal(number)) is not None:
                yield str(instruction), instruction.line, (terminal,)
            case Instruction("SPD", (DeviceOperand("X", number, ""), *_)):
                yield "SPD", instruction.line, (number,)


def interrupt_terminal(number: int) -> int | None:
    """Return the X terminal of an input interrupt; None for a timer or counter interrupt.

    Examples:
        >>> interrupt_terminal(301), interrupt_terminal(610), interrupt_terminal(10)
        (3, None, None)
    """
    return number // 100 if number % 100 < 2 and number < 600 else None
