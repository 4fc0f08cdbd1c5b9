"""Observed scans: the translated program of the engine, with the statements that record.

An observed program runs in a PLC of its own, which continues from the devices of another one, or for single scans in
place of the execution of a PLC, whose complete state it then has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from typing import Any, Final

from controller.core.devices import Memory
from controller.fx.engine.code import CONTACT_RECORD, POWER_RECORD, ZONE_RECORD
from controller.fx.engine.execution import Functions, FxExecution
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.python_functions import PythonFunctions
from controller.fx.engine.translate import translate
from controller.fx.language.instruction import Instruction, Ladder
from controller.fx.observation.observation import ObservedAt, ScanObservation, is_contact, is_output

_ERROR_RELAYS: Final = (8067, 8004)
_ERROR_REGISTERS: Final = (8067, 8069, 8004)


class ObservedFunctions(PythonFunctions):
    """Execution of a program that records its contacts and its power."""

    def __init__(self, ladder: Ladder, shared: FxExecution | None = None) -> None:
        """Translate a program.

        Args:
            ladder: Parsed program.
            shared: Execution of the same program on whose rows this one operates; None = on rows of its own.

        Raises:
            LadderError: The program contains a part that the engine does not support.
        """
        self._program = translate(ladder, observed=True)
        self._kinds = [(each.name, is_contact(each), is_output(each)) for each in ladder.instructions]
        super().__init__(self._program, shared)

    def link(self, functions: Functions) -> None:
        """Set the functions of the instructions that Python executes, and their trials."""
        trials = {i + self._program.observed: self._trial(function) for i, function in functions.items()}
        super().link({**functions, **trials})

    def forget(self) -> None:
        """Clear the records."""
        for row in self.records.values():
            row[:] = [None] * len(row)

    def was_executed(self, at: int) -> bool:
        """Return whether an instruction was executed in the last scan."""
        power, zone = self.records[POWER_RECORD][at], self.records[ZONE_RECORD][at]
        return bool(_executed(self._kinds[at][0], power, zone))

    @property
    def observation(self) -> ScanObservation:
        """The last scan, as executed."""
        records = self.records
        powers, zones = tuple(records[POWER_RECORD]), records[ZONE_RECORD]
        executed, contacts, coils = [], [], []
        rows = zip(self._kinds, records[CONTACT_RECORD], powers, zones, strict=True)
        for (name, contact, output), value, power, zone in rows:
            ran = _executed(name, power, zone)
            executed.append(ran)
            contacts.append(value if ran and contact else None)
            coils.append(power if output else None)
        return ScanObservation(ObservedAt.AS_EXECUTED, tuple(executed), tuple(contacts), powers, tuple(coils))

    def _trial(self, function: Callable[..., int | None]) -> Callable[[], bool]:
        """Return a function that evaluates a comparison and leaves the error devices unchanged."""
        bits, words = self.memory.M, self.memory.D

        def evaluate() -> bool:
            relays, registers = [bits[n] for n in _ERROR_RELAYS], [words[n] for n in _ERROR_REGISTERS]
            try:
                return bool(function())
            finally:
                for number, on in zip(_ERROR_RELAYS, relays, strict=True):
                    bits[number] = on
                for number, value in zip(_ERROR_REGISTERS, registers, strict=True):
                    words[number] = value

        return evaluate


class ObservedPlc(FxPlc):
    """PLC that observes each of its scans.

    An interrupt routine that runs after END replaces the records of its instructions.
    """

    def __init__(self, ladder: Ladder, **options: Any) -> None:
        """Load the program and go to RUN.

        Args:
            ladder: Parsed program.
            options: Options of `FxPlc`, except the execution.

        Raises:
            LadderError: The program contains a part that the engine does not support.
        """
        self._functions = ObservedFunctions(ladder)
        super().__init__(ladder, execution=lambda _: self._functions, **options)

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        """Run one scan and record it."""
        self._functions.forget()
        return super().scan(now_ms, levels)

    def load(self, memory: Memory, activity: Sequence[bool] | None = None, *, first: bool = False) -> None:
        """Continue from the devices of another PLC with this program.

        The state of the input filter, of pulse outputs and ramps, and of special function modules is not part of
        the devices.

        Args:
            memory: Devices before the scan; without its stored levels (E), those of this PLC remain.
            activity: Previous activity of the steps (row A); None = not known, and the coils of all inactive steps are
                executed without power.
            first: Whether the next scan is the first one, with M8002 on.
        """
        for field in fields(Memory):
            row: list[Any] = getattr(memory, field.name)
            if field.name != "E" or row:
                getattr(self.memory, field.name)[: len(row)] = row
        steps = len(self.execution.activity)
        self.execution.activity[:] = [True] * steps if activity is None else activity
        self.scans = 0 if first else max(1, self.scans)

    @property
    def records(self) -> ObservedFunctions:
        """Records of the last scan."""
        return self._functions

    @property
    def observation(self) -> ScanObservation:
        """The last scan, as executed."""
        return self._functions.observation


@contextmanager
def observed(plc: FxPlc, records: ObservedFunctions) -> Iterator[None]:
    """Let a PLC record its scans: its execution is replaced by `records`, which operates on its rows."""
    execution = plc.execution
    records.link(execution.functions)
    records.forget()
    plc.execution = records
    try:
        yield
    finally:
        plc.execution = execution


_WITHOUT_RECORD: Final = frozenset({"NOP", "NEXT", "SRET", "IRET", "FEND", "END", "I"})


def has_record(instruction: Instruction) -> bool:
    """Return whether an observation tells if an instruction was executed."""
    return instruction.name not in _WITHOUT_RECORD


def _executed(name: str, power: bool | None, zone: bool | None) -> bool | None:
    if power is None:
        return None if name in _WITHOUT_RECORD else False
    return zone is not False
