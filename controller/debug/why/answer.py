"""Answer to the question why a device is on or off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from controller.debug.why import texts
from controller.program.texts.operator import Language, Text

_SPACE: Final = Text(" ", " ")
_COLON: Final = Text(": ", "：")


class CauseKind(IntEnum):
    """Kind of a cause; of several causes the one with the lowest number is named first."""

    FAULT = 1
    """Fault of the plant."""
    SAFEGUARD = 2
    """Stop, emergency stop, guard: to be found out, never to be bridged."""
    SUSPECT = 3
    """Fault of the plant that is active, but not on the way from the device: a replay decides."""
    MACHINE = 4
    """Position, pressure or tray of the plant, without a fault that explains it."""
    COMMAND = 5
    """Command, system bit or other device that the program does not write."""
    TIMER = 6
    """Timer that runs, or counter that has not reached its preset."""
    INPUT = 7
    """Input terminal of which nothing further is known."""
    INTERLOCK = 8
    """Rule of the interlocks."""
    SET_POINT = 9
    """Word that the program does not write."""
    UNCHANGED = 10
    """Nothing has changed since the first recorded scan."""


@dataclass(frozen=True, slots=True)
class WhyContact:
    """Contact of a set.

    Attributes:
        device: FX name of the device; of a comparison, its instruction.
        tag: Tag and comment; empty = none.
        on: Value that it would need.
        at: Index of its first instruction.
        rung: Number of the rung of this instruction.
        step: Program step of this instruction.
        instruction: The instruction.
    """

    device: str
    tag: Text
    on: bool
    at: int
    rung: int
    step: int
    instruction: str

    def text(self, *, present: bool = False) -> Text:
        """Return the contact with the value that it needs, or that it has at present."""
        on = self.on != present
        level = texts.truth(on) if " " in self.device else texts.level(on)
        return Text(*(" ".join(filter(None, words)) for words in zip((self.device,) * 2, self.tag, level, strict=True)))


@dataclass(frozen=True, slots=True)
class WhySet:
    """Minimal set of contacts that would have to change together.

    Attributes:
        contacts: Contacts that can be followed and changed.
        causes: Contacts of safeguards and interlocks: causes, never contacts to bridge.
    """

    contacts: tuple[WhyContact, ...]
    causes: tuple[WhyContact, ...]


@dataclass(frozen=True, slots=True)
class WhyStep:
    """Step from a device to its cause.

    Attributes:
        device: FX name of the device.
        scan: Scan to which the step refers.
        rung: Number of the rung that decided it; None = no rung.
        text: The step in words.
    """

    device: str
    scan: int
    rung: int | None
    text: Text


@dataclass(frozen=True, slots=True)
class WhyCause:
    """Cause at the end of the steps.

    Attributes:
        kind: Its kind.
        device: FX name of the device at which the steps end.
        scan: Scan in which it began, as far as it is known.
        text: The cause in words.
        change: Change of a branch that removes the cause; empty = none, or it is not to be removed.
    """

    kind: CauseKind
    device: str
    scan: int
    text: Text
    change: str = ""


@dataclass(frozen=True, slots=True)
class WhyProof:
    """Replay with the cause removed.

    Attributes:
        proved: Whether the device then has the other value.
        change: Change of the branch; empty = no replay.
        scan: Scan in which the device has the other value; None = it never has.
        text: The result in words; if the cause is not proved, the reason.
    """

    proved: bool
    change: str
    scan: int | None
    text: Text


@dataclass(frozen=True, slots=True)
class WhyAnswer:
    """Answer to one question.

    Attributes:
        device: FX name of the device.
        tag: Tag and comment; empty = none.
        scan: Scan to which the question refers.
        question: The question in words.
        sets: Minimal sets of contacts that would give the device the other value, smallest first.
        more: Whether there are further sets.
        steps: Steps from the device to the causes.
        causes: Causes, the most specific one first.
        proof: Replay with the first cause removed.
    """

    device: str
    tag: Text
    scan: int
    question: Text
    sets: tuple[WhySet, ...]
    more: bool
    steps: tuple[WhyStep, ...]
    causes: tuple[WhyCause, ...]
    proof: WhyProof

    @property
    def cause(self) -> WhyCause | None:
        """The most specific cause."""
        return self.causes[0] if self.causes else None

    def lines(self) -> Iterator[WhySentence]:
        """Yield the answer in words, line by line."""
        yield WhySentence(self.question)
        for number, each in enumerate(self.sets, 1):
            parts = [_listed(texts.NEEDS, _SPACE, each.contacts, present=False)] if each.contacts else []
            parts += [_listed(texts.HELD_BY, _COLON, each.causes, present=True)] if each.causes else []
            text = Text(*(f"  {number}. {'; '.join(words)}" for words in zip(*parts, strict=True)))
            yield WhySentence(text, tuple(sorted({contact.rung for contact in (*each.contacts, *each.causes)})))
        if self.more:
            yield WhySentence(_after("  ", texts.MORE_SETS))
        for step in self.steps:
            yield WhySentence(_after("  ", step.text), () if step.rung is None else (step.rung,))
        for cause in self.causes[:3]:
            label = texts.CAUSE if cause is self.cause else texts.ALSO
            text = Text(f"{label.en}: {cause.text.en}", f"{label.zh}：{cause.text.zh}")
            yield WhySentence(text, is_cause=cause is self.cause)
        yield WhySentence(self.proof.text)


@dataclass(frozen=True, slots=True)
class WhySentence:
    """Line of an answer.

    Attributes:
        text: The line in words.
        rungs: Numbers of the rungs to which it refers.
        is_cause: Whether it names the most specific cause.
    """

    text: Text
    rungs: tuple[int, ...] = ()
    is_cause: bool = False

    def shown(self, language: Language = "en") -> str:
        """Return the line with its rungs."""
        words: str = getattr(self.text, language)
        where = f"{getattr(texts.RUNG, language)} {', '.join(map(str, self.rungs))}"
        return f"{words}  [{where}]" if self.rungs else words


def _after(prefix: str, text: Text) -> Text:
    return Text(prefix + text.en, prefix + text.zh)


def _listed(label: Text, joint: Text, contacts: tuple[WhyContact, ...], *, present: bool) -> Text:
    listed = [contact.text(present=present) for contact in contacts]
    return Text(
        f"{label.en}{joint.en}{', '.join(each.en for each in listed)}",
        f"{label.zh}{joint.zh}{', '.join(each.zh for each in listed)}",
    )
