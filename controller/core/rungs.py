"""Rungs: one coil or instruction each, with the condition that drives it.

A rung without ``when`` is always driven. Times are specified in ms and converted to counts of the timer's base.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from controller.common.declarations import DeclarationError
from controller.core.devices import ANNUNCIATORS, MS_100, MS_100_TIMERS, WORD_MAX, WORD_MIN, is_32_bit_counter
from controller.core.expr import TRUE, Bit, Counter, Expr, Timer, Word, leaves


class RungError(DeclarationError):
    """Raised for a rung that an FX2N cannot execute."""


@dataclass(frozen=True, slots=True)
class Out:
    """OUT: the bit follows the condition in every scan."""

    target: Bit
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if self.target.kind not in "YMS":
            raise RungError(f"OUT {self.target}: the coil must be Y, M or S")


@dataclass(frozen=True, slots=True)
class Set:
    """SET: the bit is set and stays on."""

    target: Bit
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if self.target.kind not in "YMS":
            raise RungError(f"SET {self.target}: the coil must be Y, M or S")


@dataclass(frozen=True, slots=True)
class Rst:
    """RST: the bit is reset; a word, timer or counter is cleared to zero."""

    target: Bit | Word | Timer | Counter
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if isinstance(self.target, Bit) and self.target.kind not in "YMS":
            raise RungError(f"RST {self.target}: the coil must be Y, M or S")


@dataclass(frozen=True, slots=True)
class ZoneReset:
    """ZRST: every bit from first to last is reset."""

    first: Bit
    last: Bit
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if self.first.kind != self.last.kind or self.first.kind not in "YMS" or self.first.number > self.last.number:
            raise RungError(f"ZRST {self.first} {self.last}: use one kind (Y, M or S), lower number first")


@dataclass(frozen=True, slots=True)
class Pulse:
    """PLS: the bit is on for one scan at the rising edge of the condition."""

    target: Bit
    when: Expr

    def __post_init__(self) -> None:
        if self.target.kind not in "YM":
            raise RungError(f"PLS {self.target}: the target must be Y or M")


@dataclass(frozen=True, slots=True)
class PulseFalling:
    """PLF: the bit is on for one scan at the falling edge of the condition."""

    target: Bit
    when: Expr

    def __post_init__(self) -> None:
        if self.target.kind not in "YM":
            raise RungError(f"PLF {self.target}: the target must be Y or M")


@dataclass(frozen=True, slots=True)
class OnDelay:
    """OUT T: on-delay timer; T246-T255 retain their value until RST.

    Attributes:
        timer: Timer; its number determines its base of 100, 10 or 1 ms.
        preset: Delay in ms (a multiple of the base), or a word that contains it in counts of the base.
        when: Condition that drives the timer.
    """

    timer: Timer
    preset: int | Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if isinstance(self.preset, int):
            counts, rest = divmod(self.preset, self.timer.base_ms)
            if rest or not 0 < counts <= WORD_MAX:
                raise RungError(
                    f"OUT {self.timer}: {self.preset} ms is out of range or not a multiple of {self.timer.base_ms} ms"
                )

    @property
    def counts(self) -> int | Word:
        """Preset in counts of the timer's base, as the K or D operand."""
        return self.preset // self.timer.base_ms if isinstance(self.preset, int) else self.preset


@dataclass(frozen=True, slots=True)
class Count:
    """OUT C: counter of rising edges of the condition; a 16-bit counter stops at its preset.

    Counters C200 and above have 32 bits, count down while special relay M8<number> is on and continue past the preset.
    """

    counter: Counter
    preset: int | Word
    when: Expr

    def __post_init__(self) -> None:
        limit = 2**31 - 1 if is_32_bit_counter(self.counter.number) else WORD_MAX
        if isinstance(self.preset, int) and not 0 < self.preset <= limit:
            raise RungError(f"OUT {self.counter}: preset {self.preset} is out of range 1..{limit}")


@dataclass(frozen=True, slots=True)
class Mov:
    """MOV: copy a constant or a word to a data register in every scan in which the instruction is driven."""

    source: Word | int
    target: Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        if self.target.kind != "D":
            raise RungError(f"MOV to {self.target}: the target must be a data register")
        if isinstance(self.source, int) and not WORD_MIN <= self.source <= WORD_MAX:
            raise RungError(f"MOV {self.source} to {self.target}: out of range {WORD_MIN}..{WORD_MAX} of a word")


@dataclass(frozen=True, slots=True)
class Inc:
    """INC: add one in every scan in which the instruction is driven; 32767 wraps to -32768. Drive it with a pulse."""

    target: Word
    when: Expr

    def __post_init__(self) -> None:
        if self.target.kind != "D":
            raise RungError(f"INC {self.target}: the target must be a data register")


@dataclass(frozen=True, slots=True)
class Add:
    """ADD: target = first + second in every scan in which the instruction is driven; the sum wraps at 16 bits."""

    first: Word | int
    second: Word | int
    target: Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        _check_words("ADD", (self.first, self.second), self.target)


@dataclass(frozen=True, slots=True)
class Subtract:
    """SUB: target = minuend - subtrahend in every scan in which it is driven; the difference wraps at 16 bits."""

    minuend: Word | int
    subtrahend: Word | int
    target: Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        _check_words("SUB", (self.minuend, self.subtrahend), self.target)


@dataclass(frozen=True, slots=True)
class Scale:
    """MUL and DDIV: target = source * factor / divisor, limited to 0..32767, with a product of 32 bits.

    The fraction is discarded. The instruction is not executed while the divisor is 0 or less.
    """

    source: Word | int
    factor: Word | int
    divisor: Word | int
    target: Word
    when: Expr = TRUE

    def __post_init__(self) -> None:
        _check_words("MUL", (self.source, self.factor, self.divisor), self.target)
        if isinstance(self.divisor, int) and self.divisor <= 0:
            raise RungError(f"MUL to {self.target}: the divisor {self.divisor} must be at least 1")

    @property
    def driven(self) -> Expr:
        """Condition under which the instruction is executed."""
        return self.when if isinstance(self.divisor, int) else self.when & (self.divisor > 0)


def _check_words(name: str, operands: tuple[Word | int, ...], target: Word) -> None:
    """Raise `RungError` unless the target is a data register and all operands have 16 bits."""
    if target.kind != "D":
        raise RungError(f"{name} to {target}: the target must be a data register")
    for operand in operands:
        if isinstance(operand, Word) and operand.kind == "C" and is_32_bit_counter(operand.number):
            raise RungError(f"{name} to {target}: {operand} has 32 bits; use an operand of 16 bits")
        if isinstance(operand, int) and not WORD_MIN <= operand <= WORD_MAX:
            raise RungError(f"{name} to {target}: {operand} is out of range {WORD_MIN}..{WORD_MAX} of a word")


@dataclass(frozen=True, slots=True)
class Annunciate:
    """ANS: set annunciator S900-S999 after the condition has been true for the preset time; it stays set.

    The FX2N requires a 100 ms timer (T0-T199).
    """

    timer: Timer
    preset: int
    target: Bit
    when: Expr

    def __post_init__(self) -> None:
        if self.target.kind != "S" or self.target.number not in ANNUNCIATORS:
            raise RungError(f"ANS {self.target}: the target must be an annunciator, S900-S999")
        counts, rest = divmod(self.preset, MS_100)
        if self.timer.number not in MS_100_TIMERS or rest or not 0 < counts <= WORD_MAX:
            raise RungError(
                f"ANS {self.target}: {self.timer} {self.preset} ms; use T0-T199 and a multiple of 100 ms in range"
            )


Arithmetic = Inc | Add | Subtract
Rung = Out | Set | Rst | ZoneReset | Pulse | PulseFalling | OnDelay | Count | Mov | Arithmetic | Scale | Annunciate


def read_devices(rung: Rung) -> Iterator[Bit | Word]:
    """Yield every device that the rung reads."""
    yield from leaves(rung.when)
    operands = {OnDelay: "preset", Count: "preset", Mov: "source"}
    word = getattr(rung, operands[type(rung)]) if type(rung) in operands else None
    match rung:
        case Scale(source, factor, divisor):
            words: tuple[Word | int | None, ...] = (source, factor, divisor)
        case Add(one, two) | Subtract(one, two):
            words = (one, two)
        case _:
            words = (word,)
    yield from (word for word in words if isinstance(word, Word))


def written_devices(rung: Rung) -> Iterator[Bit | Word]:
    """Yield every device that the rung writes; a zone reset yields every device of its zone."""
    match rung:
        case ZoneReset(first, last):
            for number in range(first.number, last.number + 1):
                yield Bit(first.kind, number)
        case OnDelay(timer):
            yield timer.done
        case Count(counter):
            yield counter.done
        case Annunciate(timer, _, target):
            yield timer.done
            yield target
        case Rst(Timer() | Counter() as target):
            yield target.done
        case (
            Out(target)
            | Set(target)
            | Rst(target)
            | Pulse(target)
            | PulseFalling(target)
            | Mov(_, target)
            | Inc(target)
            | Add(target=target)
            | Subtract(target=target)
            | Scale(target=target)
        ):
            assert isinstance(target, Bit | Word)  # noqa: S101 - narrows the union for the type checker
            yield target
