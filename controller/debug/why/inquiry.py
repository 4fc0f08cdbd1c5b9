"""Inquiry into the scans that are known: from a device through its rungs and past scans to the causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from controller.core.devices import device_name
from controller.debug.why.answer import CauseKind, WhyAnswer, WhyCause, WhyProof, WhyStep
from controller.debug.why.contacts import Contacts
from controller.debug.why.history import ScanHistory, size_of
from controller.debug.why.program import ExplainedProgram
from controller.debug.why.texts import level, sentence
from controller.fx.engine.cpu import RETENTIVE_TIMER_NUMBERS
from controller.fx.language.instruction import DeviceOperand, Instruction
from controller.fx.language.operand_rules import Key
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.why import MOST_SETS, ChangeSet, OutputReason, RequiredChange
from controller.program.texts.operator import Text

_MOST_STEPS: Final = 24
"""Number of steps after which an inquiry ends."""
_SETS: Final = 40
"""Number of sets in which the one that has changed is looked for; fewer are shown."""
_COILS: Final = frozenset({"OUT", "SET", "RST", "ZRST", "PLS", "PLF", "MC"})
_MOST_VALUES: Final = 2
"""Number of values of a word, such as the state of the machine, that are followed into the past."""
_SPECIAL: Final = 8000
"""Number of the first special relay."""


class Inquiry:
    """Inquiry into one history.

    Attributes:
        program: The program.
    """

    def __init__(self, run: ScanHistory, program: ExplainedProgram) -> None:
        """Take the scans that are known, and their program."""
        self._run, self.program = run, program
        self._list = program.reference.ladder.instructions
        self._contacts = Contacts(program)
        self._visited: set[tuple[Key, int | None]] = set()
        self._steps: list[WhyStep] = []
        self._causes: list[WhyCause] = []

    def ask(self, key: Key, scan: int) -> WhyAnswer:
        """Return why a device has its value after a scan; for an active step, why it has not left.

        The proof is missing: see `controller.debug.why.proof`.

        Args:
            key: The device.
            scan: The scan, after the first one that is known.
        """
        self._visited, self._steps, self._causes = set(), [], []
        value, name, where = self._run.value(key, scan), self.program.name(key), self._run.where(scan)
        reasons = self._reasons(key, scan)
        if key[0] in "DVZ":
            question = sentence("why word", name=name, value=int(value), **where)
        elif value and self._body(key):
            question = sentence("why step", name=name, **where)
        else:
            question = sentence("why", name=name, level=level(value), **where)
        self._follow(key, scan)
        if not self._is_decided:
            self._causes += self._run.suspects(self.program, scan)
        found = [each for reason in reasons for each in reason.sets]
        causes = sorted(dict.fromkeys(self._causes), key=lambda cause: cause.kind)
        return WhyAnswer(
            device_name(*key),
            self.program.tag(key),
            scan,
            question,
            tuple(self._contacts.set_of(key, each) for each in found[:MOST_SETS]),
            len(found) > MOST_SETS or not all(reason.complete for reason in reasons),
            tuple(self._steps),
            tuple(causes),
            WhyProof(proved=False, change="", scan=None, text=sentence("no change", reason=sentence("no input"))),
        )

    # steps and causes

    def _step(self, key: Key, scan: int, at: int | None, text: Text) -> None:
        rung = None if at is None else self.program.reference.rung_at(at)
        self._steps.append(WhyStep(device_name(*key), scan, rung, text))

    def _cause(self, kind: CauseKind, key: Key, scan: int, text: Text) -> None:
        self._causes.append(WhyCause(kind, device_name(*key), scan, text))

    # reasons within one scan

    def _writers(self, key: Key) -> list[int]:
        return [use.at for use in self.program.reference.device(key).uses if use.written]

    def _reasons(self, key: Key, scan: int) -> list[OutputReason]:
        """Return the reason for a device in one scan; for an active step, that of each of its transitions."""
        if key[0] in "XDVZ" or scan <= self._run.first:
            return []
        seen = self._run.observed(scan)
        reasons = self.program.reasons
        if self._run.value(key, scan):
            leaving = [reasons.of_output(at, seen, _SETS) for at in self._body(key)]
            if leaving:
                return sorted(
                    (each for each in leaving if each.executed and not each.driven),
                    key=lambda each: min((size_of(one) for one in each.sets), default=0),
                )
        coils = [at for at in self._writers(key) if self._list[at].name in _COILS]
        if not coils:
            return []
        reason = reasons.of_device(coils, bool(self._run.value(key, scan - 1)), seen, _SETS)
        skipped = self._skipped(coils, seen)
        if not reason.sets and not self._run.value(key, scan) and skipped:
            return [replace(reason, sets=tuple(self._around(skipped[0], seen, scan)))]
        return [reason]

    def _skipped(self, coils: Sequence[int], seen: ScanObservation) -> list[int]:
        """Return the outputs that would turn a device on and were not executed."""
        return [at for at in coils if seen.executed[at] is False and self._list[at].name in ("OUT", "SET")]

    def _body(self, key: Key) -> list[int]:
        """Return the transitions of a step; none if the device is not a step."""
        if key[0] != "S":
            return []
        return [
            at
            for at, instruction in self.program.reference.outputs_in_step(key)
            if instruction.name in ("SET", "OUT") and _device(instruction, "S") not in (None, key)
        ]

    # through past scans

    def _follow(self, key: Key, scan: int) -> None:
        changed = self._run.changed([key], scan)
        if (key, changed) in self._visited or len(self._steps) >= _MOST_STEPS or self._is_decided:
            return
        self._visited.add((key, changed))
        if key[0] == "X":
            self._follow_input(key, scan, changed)
        elif not self._writers(key):
            self._follow_outside(key, scan, changed)
        elif key[0] in "DVZ":
            self._follow_word(key, scan, changed)
        elif self._run.value(key, scan) and self._body(key):
            self._follow_step(key, scan, changed)
        elif key[0] in "TC":
            self._follow_timer(key, scan, changed)
        else:
            self._follow_bit(key, scan, changed)

    @property
    def _is_decided(self) -> bool:
        """True if a cause has been found behind which nothing is to be looked for."""
        return any(cause.kind <= CauseKind.SAFEGUARD for cause in self._causes)

    def _dated(self, words: str, key: Key, value: int, changed: int | None, **more: str | int) -> Text:
        """Return a sentence about a value and the scan since which a device has it; None = no change is known."""
        shown = {"name": self.program.name(key), "level": level(value), "value": str(value), **more}
        if changed is not None:
            return sentence(words, **shown, **self._run.where(changed))
        return sentence(f"{words} {self._run.unchanged}", **shown)

    def _follow_input(self, key: Key, scan: int, changed: int | None) -> None:
        value, since = self._run.value(key, scan), self._run.first if changed is None else changed
        text = self._dated("input", key, value, changed)
        self._step(key, since, None, text)
        causes = self._run.input_causes(self.program, key, scan, changed)
        self._causes += causes
        driver = self.program.driver(key)
        if driver is not None and not value and not self._is_decided and not self._run.value(driver, scan):
            self._follow(driver, scan)  # the part does not come because nothing moves it
        if not causes:
            guarded = self.program.is_safeguard(key, key)
            change = "" if guarded or changed is None else self._run.flip(key, changed)
            kind = CauseKind.SAFEGUARD if guarded else CauseKind.INPUT
            self._causes.append(WhyCause(kind, device_name(*key), since, text, change))

    def _follow_outside(self, key: Key, scan: int, changed: int | None) -> None:
        if key[0] == "M" and key[1] >= _SPECIAL:
            return
        value, since = self._run.value(key, scan), self._run.first if changed is None else changed
        if key[0] in "DVZ":
            text = sentence("set-point", name=self.program.name(key), value=value)
            self._cause(CauseKind.SET_POINT, key, since, text)
        else:
            kind = CauseKind.UNCHANGED if changed is None and self._run.is_recorded else CauseKind.COMMAND
            self._cause(kind, key, since, self._dated("command", key, value, changed))

    def _follow_word(self, key: Key, scan: int, changed: int | None) -> None:
        name = self.program.name(key)
        if changed is None:
            text = self._dated("word", key, self._run.value(key, scan), None)
            self._cause(CauseKind.UNCHANGED, key, self._run.first, text)
            return
        if sum(step.device == device_name(*key) for step in self._steps) >= _MOST_VALUES:
            return
        seen = self._run.observed(changed)
        at = next((at for at in reversed(self._writers(key)) if seen.executed[at] and seen.powers[at]), None)
        text = sentence("written", name=name, value=self._run.value(key, changed), **self._run.where(changed))
        self._step(key, changed, at, text)
        if at is None:
            return
        source = _device(self._list[at], "D") if self._list[at].name == "MOV" else None
        if source is not None:
            is_later = any(writer > at for writer in self._writers(source))
            self._follow(source, changed - 1 if is_later else changed)
            return
        sets = self.program.reasons.of_output(at, seen, _SETS).sets
        compared = {
            each: None
            for one in sets
            for change in one.changes
            if change.device is None
            for each in self._contacts.read_by(change)
            if each[0] == "D" and self._writers(each)
        }
        for each in compared:  # a state follows from the one before
            self._follow(each, changed)
        self._follow_sets(key, sets, changed, recent=True)

    def _follow_step(self, key: Key, scan: int, changed: int | None) -> None:
        since = self._run.first if changed is None else changed
        self._step(key, since, self._body(key)[0], self._dated("step waits", key, 1, changed))
        for reason in self._reasons(key, scan)[:1]:
            self._follow_sets(key, reason.sets, scan, recent=False)

    def _follow_timer(self, key: Key, scan: int, changed: int | None) -> None:
        coil = next((at for at in self._writers(key) if self._list[at].name == "OUT"), None)
        if coil is None:
            self._follow_bit(key, scan, changed)
            return
        on = bool(self._run.value(key, scan))
        if on and changed is None and not self._run.is_recorded and _is_kept(key):
            self._cause(CauseKind.UNCHANGED, key, scan, self._dated("kept", key, 1, None))
            return
        at_scan = changed if on and changed is not None else scan
        name, preset = self.program.name(key), str(self._list[coil].operands[-1])
        seen = self._run.observed(at_scan)
        driven = bool(seen.executed[coil]) and bool(seen.powers[coil])
        if on:
            self._step(key, at_scan, coil, self._dated("elapsed", key, 1, changed, preset=preset))
            if key[0] == "T" and at_scan > self._run.first + 1:
                at_scan -= 1  # before what it has turned on acts
                seen = self._run.observed(at_scan)
        elif driven or key[0] == "C":
            value = self._run.memory(scan).word(*key)
            text = sentence("timer" if key[0] == "T" else "counter", name=name, value=str(value), preset=preset)
            self._step(key, scan, coil, text)
            self._cause(CauseKind.TIMER, key, scan, text)
            return
        else:
            self._changed_step(key, scan, changed, coil)
        self._follow_sets(key, self._of_coil(coil, seen, at_scan), at_scan, recent=False)

    def _of_coil(self, at: int, seen: ScanObservation, scan: int) -> Sequence[ChangeSet]:
        if seen.executed[at]:
            return self.program.reasons.of_output(at, seen, _SETS).sets
        return self._around(at, seen, scan)

    def _follow_bit(self, key: Key, scan: int, changed: int | None) -> None:
        coils = [at for at in self._writers(key) if self._list[at].name in _COILS]
        latched = not any(self._list[at].name in ("OUT", "MC") for at in coils)
        # an OUT coil has its reason in every scan, what is kept has it in the scan in which it has changed
        at_scan = changed if latched and changed is not None else scan
        if at_scan <= self._run.first:
            text = self._dated("kept", key, self._run.value(key, scan), None)
            self._cause(CauseKind.UNCHANGED, key, at_scan, text)
            return
        value, seen = bool(self._run.value(key, at_scan)), self._run.observed(at_scan)
        reason = self.program.reasons.of_device(coils, bool(self._run.value(key, at_scan - 1)), seen, _SETS)
        if key[0] == "S" and not value and reason.driven and self._left(key, at_scan, seen):
            return
        applied = [at for at in self._writers(key) if at not in coils and seen.executed[at] and seen.powers[at]]
        sets: Sequence[ChangeSet] = reason.sets
        decisive = next((at for at in reversed(coils) if seen.executed[at] and bool(seen.powers[at]) == value), None)
        if reason.driven != value or not coils:  # an applied instruction has written it
            decisive = applied[-1] if applied else None
            sets = () if decisive is None else self.program.reasons.of_output(decisive, seen, _SETS).sets
        if decisive is None:
            decisive = next(iter(coils), None)
        self._changed_step(key, scan, changed, decisive)
        for rule in self._blocking(key, scan):
            self._step(key, scan, decisive, sentence("rule", name=self.program.name(key), rule=rule))
            self._cause(CauseKind.INTERLOCK, key, scan, sentence("rule cause", rule=rule))
        skipped = self._skipped(coils, seen)
        if not value and not sets and skipped:
            sets = self._around(skipped[0], seen, at_scan)
            names = ", ".join(str(self._contacts.contact(change).device) for each in sets for change in each.changes)
            text = sentence("not executed", name=self.program.name(key), other=names or "-")
            self._step(key, at_scan, skipped[0], text)
        is_earlier = latched and changed is None and not applied and not self._run.is_recorded
        if is_earlier or (changed is None and not sets):
            self._cause(CauseKind.UNCHANGED, key, self._run.first, self._dated("kept", key, value, None))
        if not is_earlier or not (value or key[0] == "S"):  # what turns it on in this scan is a reason to be off
            self._follow_sets(key, sets, at_scan, recent=changed == at_scan)

    def _blocking(self, key: Key, scan: int) -> list[Text]:
        if key[0] != "Y":
            return []
        return list(self.program.blocking(key, self._run.memory(scan)))

    def _changed_step(self, key: Key, scan: int, changed: int | None, at: int | None) -> None:
        words = {} if changed is not None else {"scan": scan}
        text = self._dated("went", key, self._run.value(key, scan), changed, **words)
        self._step(key, scan if changed is None else changed, at, text)

    def _left(self, key: Key, scan: int, seen: ScanObservation) -> bool:
        """Follow the transition by which a step was left; return False if there is none in this scan."""
        at = next((at for at in self._body(key) if seen.executed[at] and seen.powers[at]), None)
        if at is None:
            return False
        target = _device(self._list[at], "S")
        other = "" if target is None else self.program.name(target)
        self._step(
            key, scan, at, sentence("step left", name=self.program.name(key), other=other, **self._run.where(scan))
        )
        self._follow_sets(key, self.program.reasons.of_output(at, seen, _SETS).sets, scan, recent=True)
        return True

    def _around(self, at: int, seen: ScanObservation, scan: int) -> list[ChangeSet]:
        """Return why an output was not executed: its step, the master control around it, or a jump."""
        reference = self.program.reference
        jumps = [n for n in range(at) if self._list[n].name == "CJ" and seen.powers[n]]
        sets = [
            ChangeSet((RequiredChange((at,), key, on=True),), ())
            for key in reference.around(reference.rung_at(at))
            if not self._run.value(key, scan)
        ]
        if not sets and jumps:
            return list(self.program.reasons.of_output(jumps[-1], seen, _SETS).sets)
        return sets

    def _follow_sets(self, key: Key, sets: Sequence[ChangeSet], scan: int, *, recent: bool) -> None:
        """Follow the contacts of one set: the smallest, and of several of this size the one that changed last.

        Args:
            key: Device that they determine.
            sets: Minimal sets in this scan.
            scan: The scan.
            recent: Whether contacts that have changed in this scan are preferred to a small set.
        """
        if not sets:
            return
        chosen = self._run.choose(sets, scan, self._contacts.read_by, recent=recent)
        read = {
            each: self._executed_after(change, each, scan)
            for change in (*chosen.changes, *chosen.causes)
            for each in self._contacts.read_by(change)
        }
        # what has changed last is the most likely cause
        for each in sorted(read, key=lambda each: self._run.changed([each], scan) or self._run.first, reverse=True):
            if each != key:
                self._follow(each, read[each])

    def _executed_after(self, change: RequiredChange, key: Key, scan: int) -> int:
        """Return the scan after which a device has the value with which its contact was executed in a scan."""
        is_level = change.device is not None and self._list[change.contacts[0]].name[-1] not in "PF"
        return scan - 1 if is_level and bool(self._run.value(key, scan)) == change.on else scan


def _is_kept(key: Key) -> bool:
    """Return whether a timer or counter keeps its value while its rung is off."""
    return key[0] == "C" or key[1] in RETENTIVE_TIMER_NUMBERS


def _device(instruction: Instruction, kind: str) -> Key | None:
    match instruction.operands[:1]:
        case (DeviceOperand(of, number, ""),) if of == kind:
            return of, number
    return None
