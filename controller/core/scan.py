"""PLC scan: latch the X image, execute the blocks in order, return the Y image."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from collections.abc import Sequence as Rows
from dataclasses import fields
from functools import partial
from typing import Any, Protocol

from transitions import Machine

from controller.common.saved import Saved
from controller.core.compile import BlockFunction, Transfers, compile_program, trigger
from controller.core.devices import (
    ANNUNCIATOR_ON,
    ANNUNCIATORS,
    CLOCK_1_S,
    INITIAL_PULSE,
    LOWEST_ANNUNCIATOR,
    RUN_MONITOR,
    Memory,
    is_32_bit_counter,
)
from controller.core.expr import Bit, Word
from controller.core.input_filter import InputFilter
from controller.core.program import Program
from controller.core.sequence import Sequence, Transfer


class StepMachine:
    """Sequence as a `transitions` machine. Its state is the step entered last; the S bits are authoritative.

    The compiled scan calls a trigger only if the transfer's condition is true. The transfer sets the
    destination and queues the source to be reset at END.
    """

    state: str

    def __init__(self, sequence: Sequence, index: int, memory: Memory, leaving: list[int]) -> None:
        self._states = memory.S
        self._leaving = leaving
        rows = [
            {
                "trigger": trigger(index, t.source, n),
                "source": title,
                "dest": self._title(sequence, t),
                "after": partial(self._transfer, t),
            }
            for title, transfers in sequence.transfers.items()
            for n, t in enumerate(transfers)
        ]
        self._machine = Machine(
            model=self,
            states=list(sequence.bits),
            transitions=rows,
            initial=sequence.steps[0].title,
            auto_transitions=False,
        )
        self.triggers: Transfers = {
            str(row["trigger"]): partial(self._fire, str(row["source"]), getattr(self, str(row["trigger"])))
            for row in rows
        }

    def _fire(self, source: str, fire: Callable[[], None]) -> None:
        # Rungs can also set S bits (initial step, restart) without notifying the machine.
        if self.state != source:
            self._machine.set_state(source)
        fire()

    def _transfer(self, transfer: Transfer) -> None:
        source, target = transfer.source.number, transfer.target.number
        self._states[target] = True
        if target in self._leaving:
            self._leaving.remove(target)
        if source != target:
            self._leaving.append(source)

    @staticmethod
    def _title(sequence: Sequence, transfer: Transfer) -> str:
        return next(title for title, bit in sequence.bits.items() if bit == transfer.target)


class Execution(Protocol):
    """Executor of one program on its own device memory.

    Attributes:
        memory: All devices.
    """

    memory: Memory

    def run(self, now_ms: int, *, first: bool) -> None:
        """Execute all blocks and the END processing with the latched inputs.

        Args:
            now_ms: Time of the scan, ms.
            first: True in the first scan.
        """

    def image_of(self, spans: Iterable[tuple[str, slice]]) -> Callable[[], object]:
        """Return a function that copies spans of the memory, given by row and range, for comparison with later copies.

        The copies are equal if and only if the spans have equal values.
        """

    def save(self) -> Any:
        """Return a copy of all devices."""

    def restore(self, saved: Any) -> None:
        """Restore a copy returned by `save`."""


class PythonExecution:
    """Execution of a program as Python functions, with a `transitions` machine for each sequence."""

    def __init__(self, program: Program) -> None:
        """Compile a program for a new memory."""
        self.memory = Memory()
        self._leaving: list[int] = []
        transfers: Transfers = {}
        for index, sequence in enumerate(program.sequences()):
            transfers |= StepMachine(sequence, index, self.memory, self._leaving).triggers
        self._blocks: list[BlockFunction] = compile_program(program, self.memory, transfers)

    def run(self, now_ms: int, *, first: bool) -> None:
        """Execute all blocks and the END processing with the latched inputs."""
        memory = self.memory
        special = memory.M
        special[RUN_MONITOR] = True
        special[INITIAL_PULSE] = first
        special[CLOCK_1_S] = now_ms % 1000 < 500
        tick_100, tick_10 = now_ms // 100, now_ms // 10
        for block in self._blocks:
            block(tick_100, tick_10, now_ms)
        if self._leaving:
            for state in self._leaving:
                memory.S[state] = False
            self._leaving.clear()
        self._watch_annunciators()

    def image_of(self, spans: Iterable[tuple[str, slice]]) -> Callable[[], object]:
        """Return a function that copies spans of the memory for comparison."""
        rows = [(getattr(self.memory, row), span) for row, span in spans]
        return lambda: tuple(row[span] for row, span in rows)

    def save(self) -> Any:
        """Return a copy of all devices."""
        return [row.copy() for row in self._rows()]

    def restore(self, saved: Any) -> None:
        """Restore a copy returned by `save`."""
        for row, values in zip(self._rows(), saved, strict=True):
            row[:] = values

    def _rows(self) -> list[list[Any]]:
        return [getattr(self.memory, row.name) for row in fields(Memory)]

    def _watch_annunciators(self) -> None:
        memory = self.memory
        active = True in memory.S[ANNUNCIATORS.start :]
        if active or memory.M[ANNUNCIATOR_ON]:
            memory.M[ANNUNCIATOR_ON] = active
            memory.D[LOWEST_ANNUNCIATOR] = memory.S.index(True, ANNUNCIATORS.start) if active else 0


class Plc(Saved):
    """PLC in RUN mode with one program: memory and scan.

    Attributes:
        program: Program that is executed.
        execution: Executor of the program.
        memory: All devices.
        scans: Number of scans since start.
        input_filter: Filter of the inputs.
        retentive_image: Function that copies the memory spans that contain all retentive devices, for comparison with
            later copies.
    """

    SAVED = ("scans",)

    def __init__(self, program: Program, *, input_filter_ms: int = 10, execution: Execution | None = None) -> None:
        """Start the PLC with cleared memory; M8002 is on in the first scan.

        Args:
            program: Program to execute.
            input_filter_ms: Filter time of X0-X17, ms. X20 and up are fixed at 10 ms; 0 disables all filters.
            execution: Executor of the program with cleared memory; None = a `PythonExecution`.
        """
        self.program = program
        self.execution = execution or PythonExecution(program)
        self.memory = self.execution.memory
        self.scans = 0
        self.input_filter = InputFilter(self.memory.X, input_filter_ms)
        self._retentive = program.retentive
        self._retentive_names = {_retentive_name(device): device for device in self._retentive}
        self.retentive_image = self.execution.image_of(self._retentive_spans())
        for word, value in program.set_points:
            self.memory.set_word(word.kind, word.number, value)

    def save(self) -> Any:
        """Return all devices and the state of the input filter."""
        return super().save(), self.execution.save(), self.input_filter.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, execution, input_filter = saved
        super().restore(own)
        self.execution.restore(execution)
        self.input_filter.restore(input_filter)

    def scan(self, now_ms: int, levels: Rows[bool]) -> list[bool]:
        """Run one scan.

        Args:
            now_ms: Monotonic time of the scan, ms. The caller reads the clock once per scan.
            levels: Raw levels of the X terminals from X0, indexed by the value of the octal address.

        Returns:
            Copy of the Y image: raw levels indexed by the value of the octal address.
        """
        self.input_filter.latch(now_ms, levels)
        self.execution.run(now_ms, first=self.scans == 0)
        self.scans += 1
        return self.memory.Y.copy()

    def press(self, bit: Bit) -> None:
        """Set a system bit before the next scan; a command bit is on for that scan only."""
        self.memory.bits(bit.kind)[bit.number] = True

    def write(self, device: Bit | Word, value: int) -> None:
        """Write a system bit or a set-point before the next scan."""
        if isinstance(device, Bit):
            self.memory.bits(device.kind)[device.number] = bool(value)
        else:
            self.memory.set_word(device.kind, device.number, value)

    def read(self, device: Bit | Word) -> int:
        """Return the value of any device after a scan."""
        if isinstance(device, Bit):
            return int(self.memory.bits(device.kind)[device.number])
        return self.memory.word(device.kind, device.number)

    def annunciators(self) -> list[int]:
        """Return the numbers of the annunciators that are set, lowest first."""
        states = self.memory.S
        return [n for n in ANNUNCIATORS if states[n]] if self.memory.M[ANNUNCIATOR_ON] else []

    def retained(self) -> dict[str, int]:
        """Return the values of the program's battery-backed devices by FX name.

        T246 and C100 are contacts; the current values are TN246 and CN100, as in the FX protocols.
        """
        return {name: self.read(device) for name, device in self._retentive_names.items()}

    def restore_retained(self, values: Mapping[str, int]) -> None:
        """Restore the values returned by `retained`, before the first scan.

        Raises:
            ValueError: The names differ from those of this program's retentive devices, or a value is invalid;
                nothing is changed.
        """
        expected = self._retentive_names
        if expected.keys() != values.keys():
            differing = ", ".join(sorted(expected.keys() ^ values.keys()))
            raise ValueError(f"retentive devices of another program: {differing}")
        for name, device in expected.items():
            if not self._is_valid(device, values[name]):
                raise ValueError(f"{name} {device.name}: {values[name]} is not a valid value")
        for name, device in expected.items():
            self.write(device, values[name])

    def _is_valid(self, device: Bit | Word, value: int) -> bool:
        """Return True if a retained value is one that the program can have stored."""
        if isinstance(device, Bit):
            return value in {0, 1}
        long = device.kind == "C" and is_32_bit_counter(device.number)
        bits = 31 if long else 15
        return -(2**bits) <= value < 2**bits and value in self.program.valid.get(device, (value,))

    def _retentive_spans(self) -> Iterator[tuple[str, slice]]:
        """Yield the rows of `Memory` that contain retentive devices, with the range of these devices."""
        for kind, rows in {"M": ("M",), "D": ("D",), "C": ("C", "CV"), "T": ("T", "TV")}.items():
            numbers = [device.number for device in self._retentive if device.kind == kind]
            if numbers:
                yield from ((row, slice(min(numbers), max(numbers) + 1)) for row in rows)


def _retentive_name(device: Bit | Word) -> str:
    return f"{device.kind}N{device.number}" if isinstance(device, Word) and device.kind in "TC" else str(device)
