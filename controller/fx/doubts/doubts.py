"""Doubts about the results of a program: a page of a manual differs from this engine, or no page was found.

Each doubt concerns only programs with such an instruction. Sources: docs/sources/fx2n.md 1.1, 1.2, 1.4 and 1.10, with
their marks.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Final

from controller.fx.language.check import Finding
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Instruction, Ladder, Operand, Pointer
from controller.fx.language.instruction_set import FORMS, JOINS, step_numbers
from controller.fx.language.structure import END_LABEL

SINGLE_OPERATION_FLAGS: Final = range(2800, 3072)
"""Relays of whose pulse contacts possibly only one sees an edge (from memory)."""
_ROUTINE_TIMERS: Final = (range(192, 200), range(246, 250))
"""Timers for subroutines and interrupt routines (fx2n.md 1.4, verified)."""
_MS_1_TIMERS: Final = range(246, 250)
_PULSE_CONTACTS: Final = frozenset(join + edge for join in JOINS for edge in "PF")
_MOST_STEPS_NAMED: Final = 5

_BEYOND: Final = (
    "the result can leave {low} to {high}: by page 5-25 d of the FX manual, the number stored then has the sign of the "
    "limit exceeded; this engine and exported Structured Text wrap around"
)
_RESET_APART: Final = (
    "{where}: by page 212 of the FX3 manual, the reset can then last and disable {device}; here RST acts only when it "
    "is executed"
)
_ROUTINE_TIMER: Final = (
    "in a subroutine or interrupt routine: by page 4-18 of the FX manual, its time is updated at END, and its contact "
    "closes at its coil or at END; here both only at its coil"
)
_PULSED_TIMER: Final = (
    "the time between two executions with power is added, so a pulse of one scan adds nothing; page 4-18 of the FX "
    "manual does not state what such a pulse adds"
)
_JUMPED_TIMER: Final = (
    "can be jumped over by CJ: in an FX2N, a timer that is jumped over stops (general knowledge, no page found); here "
    "the time of the jump counts"
)
_SEVERAL_PULSES: Final = (
    "{device} has {count} pulse contacts: in an FX2N, possibly only the first one executed after its change sees the "
    "edge (general knowledge, no page found); here each of them does"
)
_PID: Final = (
    "by page M-28 of the FX3 analogue manual, a gain of 0 and a derivative gain of up to 200 % are valid, and errors "
    "6740 and 6742 to 6749 are reported; here the first two stop PID with 6733 and 6735 as by page M-7, and the others "
    "are not reported"
)

_Doubt = tuple[int, str]
"""Index of an instruction, and the doubt about it."""


def doubts(ladder: Ladder) -> list[Finding]:
    """Return the doubts about a program in line order: one finding for each doubt, at the first of its instructions."""
    steps = step_numbers(ladder.instructions)
    places: dict[str, list[int]] = defaultdict(list)
    for rule in (_sums, _routines_and_jumps, _pulse_contacts, _single_instructions):
        for at, text in rule(ladder):
            places[text].append(at)
    found = []
    for text, (first, *others) in places.items():
        instruction = ladder.instructions[first]
        also = _also([steps[at] for at in others])
        found.append(Finding("doubt", instruction.line, f"{instruction} (step {steps[first]}{also}): {text}"))
    return sorted(found, key=lambda finding: (finding.line, finding.text))


def _also(steps: list[int]) -> str:
    """Return the text that names further steps."""
    if not steps:
        return ""
    named = ", ".join(map(str, steps[:_MOST_STEPS_NAMED]))
    more = len(steps) - _MOST_STEPS_NAMED
    return f", also {named}" + (f" and {more} more" if more > 0 else "")


def _sums(ladder: Ladder) -> Iterator[_Doubt]:
    """Yield a doubt for each ADD and SUB whose operands do not exclude a result beyond the range of numbers."""
    for at, instruction in enumerate(ladder.instructions):
        form = FORMS.get(instruction.name)
        if form is None or form.kind.name not in ("ADD", "SUB"):
            continue
        bits = 32 if form.wide else 16
        (low, high), (least, most) = (_value_range(operand, bits) for operand in instruction.operands[:2])
        if form.kind.name == "SUB":
            least, most = -most, -least
        lowest, highest = -(2 ** (bits - 1)), 2 ** (bits - 1) - 1
        if low + least < lowest or high + most > highest:
            yield at, _BEYOND.format(low=lowest, high=highest)


def _value_range(operand: Operand, bits: int) -> tuple[int, int]:
    """Return the lowest and the highest value that an operand can have as a number of 16 or 32 bits."""
    match operand:
        case Constant(value, index=""):
            signed = value - 2**bits if value >= 2 ** (bits - 1) else value
            return signed, signed
        case Digits(digits) if 4 * digits < bits:
            return 0, 16**digits - 1
        case DeviceOperand("T" | "C", index="") if bits == 16:
            return 0, 32_767
    return -(2 ** (bits - 1)), 2 ** (bits - 1) - 1


def _routines_and_jumps(ladder: Ladder) -> Iterator[_Doubt]:
    """Yield the doubts about timers and counters that are not executed in every scan."""
    jumped, in_routine = _jumped_over(ladder), _in_routines(ladder)
    for at, instruction in enumerate(ladder.instructions):
        match instruction:
            case Instruction("RST", (DeviceOperand("T" | "C") as device,)) if at in jumped or at in in_routine:
                where = "in a subroutine or interrupt routine" if at in in_routine else "can be jumped over by CJ"
                yield at, _RESET_APART.format(where=where, device=device)
            case Instruction("OUT", (DeviceOperand("T", number), *_)):
                if at in in_routine and any(number in span for span in _ROUTINE_TIMERS):
                    yield at, _ROUTINE_TIMER
                if at in jumped:
                    yield at, _JUMPED_TIMER


def _jumped_over(ladder: Ladder) -> set[int]:
    """Return the instructions between a CJ and its label further down."""
    labels = {i.operands[0]: at for at, i in enumerate(ladder.instructions) if i.name == "P"}
    ends = [at for at, i in enumerate(ladder.instructions) if i.name in ("FEND", "END")]
    found: set[int] = set()
    for at, instruction in enumerate(ladder.instructions):
        if instruction.name in ("CJ", "CJP"):
            label = instruction.operands[0]
            end = next(place for place in ends if place > at) if label == END_LABEL else labels[label]
            found.update(range(at + 1, end))
    return found


def _in_routines(ladder: Ladder) -> set[int]:
    """Return the instructions of subroutines and interrupt routines."""
    called = {i.operands[0] for i in ladder.instructions if i.name in ("CALL", "CALLP")}
    found: set[int] = set()
    inside = False
    for at, instruction in enumerate(ladder.instructions):
        if instruction.name in ("P", "I"):
            (label,) = instruction.operands
            inside = inside or label in called or (isinstance(label, Pointer) and label.kind == "I")
        elif instruction.name in ("SRET", "IRET"):
            inside = False
        if inside:
            found.add(at)
    return found


def _pulse_contacts(ladder: Ladder) -> Iterator[_Doubt]:
    """Yield a doubt for each further pulse contact of a relay that is possibly a single operation flag."""
    pulses = [
        (at, instruction.operands[0])
        for at, instruction in enumerate(ladder.instructions)
        if instruction.name in _PULSE_CONTACTS and _is_single_operation_flag(instruction.operands[0])
    ]
    counts = Counter(relay for _, relay in pulses)
    for at, relay in pulses:
        if counts[relay] > 1:
            yield at, _SEVERAL_PULSES.format(device=relay, count=counts[relay])


def _is_single_operation_flag(operand: Operand) -> bool:
    return isinstance(operand, DeviceOperand) and operand.kind == "M" and operand.number in SINGLE_OPERATION_FLAGS


def _single_instructions(ladder: Ladder) -> Iterator[_Doubt]:
    """Yield the doubts that concern an instruction wherever it is."""
    for at, instruction in enumerate(ladder.instructions):
        match instruction:
            case Instruction("OUT", (DeviceOperand("T", number), *_)) if number in _MS_1_TIMERS:
                yield at, _PULSED_TIMER
            case Instruction("PID"):
                yield at, _PID
