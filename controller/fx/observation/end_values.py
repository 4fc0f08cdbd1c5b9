"""END values of a scan: contacts, power and coils evaluated from the devices at END, as in the monitor of GX Works.

Pulse contacts and pulsed applied instructions are unknown, because the devices at END do not tell whether they have
changed in the scan; power that depends on a pulse contact is unknown as well. Jumps and calls are not visible: all
rungs outside inactive steps and zones without master control are evaluated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any, Final

from controller.core.devices import Memory
from controller.fx.engine.code import (
    CONTACT_RECORD,
    MAIN,
    POWER_RECORD,
    ZONE_RECORD,
    Condition,
    Conjunction,
    Disjunction,
    Inverse,
    Let,
    LocalVariable,
    Network,
    Routine,
    RowElement,
    Statement,
    Store,
    TranslatedProgram,
)
from controller.fx.engine.coils import contact
from controller.fx.engine.conditions import Numbering, RungBuilder, are_last_outputs
from controller.fx.engine.cpu import Cpu
from controller.fx.engine.operations import Operations, Watchdog
from controller.fx.engine.outputs import active
from controller.fx.engine.parts import LadderStep, Loop, Part, number_of, parts_of
from controller.fx.engine.python_functions import PythonFunctions
from controller.fx.language.instruction import DeviceOperand, Ladder, WordBit
from controller.fx.language.rung_shapes import ON_BUS
from controller.fx.observation.observation import ObservedAt, ScanObservation, Value, is_contact, is_output

_PULSE, _NAMED = "p", "t"
"""First letters of the variables of pulse contacts and of intermediate results."""
_LEAST, _MOST = 0, 1
"""Rails of a value: on even if no pulse is on, and on if suitable pulses are on. They differ if it is unknown."""
_COILS: Final = frozenset({"OUT", "SET", "RST", "PLS", "PLF", "MC"})


class EndValues:
    """Evaluator of the END values of one program."""

    def __init__(self, ladder: Ladder) -> None:
        """Translate a program.

        Raises:
            LadderError: The program contains a part that the engine does not support.
        """
        self._ladder = ladder
        program = _Translator(ladder).program()
        self._functions = PythonFunctions(program)
        cpu = Cpu(self._functions.memory, model=ladder.cpu)
        operations = Operations(ladder, cpu, Watchdog(cpu, self._functions.registers))
        self._functions.link(operations.functions(program.operations))

    def observe(self, memory: Memory) -> ScanObservation:
        """Return the END values of a memory, which is not changed."""
        own = self._functions.memory
        for field in fields(Memory):
            if field.name != "E":
                row: list[Any] = getattr(memory, field.name)
                getattr(own, field.name)[: len(row)] = row
        for row in self._functions.records.values():
            row[:] = [None] * len(row)
        self._functions.run(0)
        instructions = self._ladder.instructions
        records = self._functions.records
        zones = records[ZONE_RECORD]
        powers = _Known(records[POWER_RECORD])
        executed = tuple(None if not powers.seen[i] else zones[i] is not False for i in range(len(instructions)))
        contacts = tuple(
            value if is_contact(instruction) and ran else None
            for instruction, value, ran in zip(
                instructions, _Known(records[CONTACT_RECORD]).values, executed, strict=True
            )
        )
        coils = tuple(self._coil(i, memory) for i in range(len(instructions)))
        return ScanObservation(ObservedAt.END_VALUES, executed, contacts, powers.values, coils)

    def _coil(self, i: int, memory: Memory) -> Value:
        """Return whether the device of a coil is on."""
        instruction = self._ladder.instructions[i]
        if instruction.name not in _COILS or not is_output(instruction):
            return None
        match instruction.operands[-1 if instruction.name == "MC" else 0]:
            case WordBit(number, bit):
                return bool(memory.D[number] >> bit & 1)
            case DeviceOperand("T", number, "") if instruction.name == "OUT":
                return memory.TS[number] >= 0
            case DeviceOperand("C", number, "") if instruction.name == "OUT":
                return memory.CE[number]
            case DeviceOperand("X" | "Y" | "M" | "S" | "T" | "C" as kind, number, ""):
                return memory.bits(kind)[number]
        return None


class _Known:
    """Values of which both rails are known.

    Attributes:
        values: Value of each instruction; None = unknown.
        seen: Whether each instruction has a record.
    """

    def __init__(self, row: list[Value]) -> None:
        half = len(row) // 2
        least, most = row[:half], row[half:]
        self.values = tuple(one if one == other else None for one, other in zip(least, most, strict=True))
        self.seen = tuple(one is not None for one in least)


class _Translator:
    """Translator of one program to the records of its END values, on both rails."""

    def __init__(self, ladder: Ladder) -> None:
        self._list = ladder.instructions
        self._cpu = ladder.cpu
        self._parts = parts_of(ladder)
        self._numbering = Numbering()
        self._is_last = are_last_outputs(self._list)
        self._rung = RungBuilder([], self._numbering)
        self._gates: dict[int, Condition] = {}

    def program(self) -> TranslatedProgram:
        networks: list[Network] = []
        for body in self._parts.bodies:
            self._gates = {}
            networks.extend(self._networks(body))
        numbering, count = self._numbering, len(self._list)
        operations = tuple(sorted(numbering.operations))
        main = Routine(MAIN, (), tuple(networks))
        return TranslatedProgram(main, (), (), operations, (), 0, 0, 0, self._cpu, observed=2 * count)

    def _networks(self, body: tuple[Part, ...]) -> Iterator[Network]:
        for part in body:
            match part:
                case LadderStep():
                    yield from self._step(part)
                case Loop():
                    yield Network(tuple(self._power(part.at, True)), "", begins_block=False)
                    yield from self._networks(part.body)
                case _:
                    yield Network(tuple(self._instruction(part)), "", begins_block=False)

    def _step(self, step: LadderStep) -> Iterator[Network]:
        self._rung.clear()
        self._gates[-1] = active(step)
        statements = [record for head in step.heads for record in self._record(POWER_RECORD, head, active(step))]
        statements += [record for i in step.body for record in self._instruction(i)]
        yield Network(tuple(statements), "", begins_block=False)
        del self._gates[-1]
        self._rung.clear()

    def _instruction(self, i: int) -> Iterator[Statement]:
        instruction, rung = self._list[i], self._rung
        if instruction.name == "MCR":
            level = number_of(instruction)
            self._gates = {number: gate for number, gate in self._gates.items() if number < level}
        if instruction.name in ON_BUS:
            rung.clear()
            yield from self._power(i, True)
        elif rung.add(i, instruction):
            yield from self._named()
            if rung.contact is not None:
                yield from self._record(CONTACT_RECORD, i, rung.contact)
            yield from self._power(i, True if rung.condition is None else rung.condition)
        else:
            yield from self._power(i, True if rung.condition is None else rung.condition)
            if instruction.name == "MC":
                self._gates[number_of(instruction)] = contact(instruction.operands[1])
            if self._is_last[i]:
                rung.end_output()

    def _named(self) -> Iterator[Statement]:
        """Yield both rails of the intermediate results of the rung, without the statements of its pulse contacts."""
        for statement in self._rung.statements:
            match statement:
                case Let(LocalVariable(name) as variable, value) if name.startswith(_NAMED):
                    for rail in (_LEAST, _MOST):
                        yield Let(_on_rail(variable, rail), _rail(value, rail))  # type: ignore[arg-type]
        self._rung.statements.clear()

    def _power(self, i: int, power: Condition) -> Iterator[Statement]:
        zone: Condition | None = None
        for gate in self._gates.values():
            zone = gate if zone is None else Conjunction(zone, gate)
        if zone is not None:
            yield Store(RowElement(ZONE_RECORD, i), zone)
            power = Conjunction(zone, power)
        yield from self._record(POWER_RECORD, i, power)

    def _record(self, row: str, i: int, value: Condition) -> Iterator[Statement]:
        yield Store(RowElement(row, i), _rail(value, _LEAST))
        yield Store(RowElement(row, i + len(self._list)), _rail(value, _MOST))


def _on_rail(variable: LocalVariable, rail: int) -> LocalVariable:
    return LocalVariable(f"{variable.name}_{rail}")


def _rail(condition: Condition, rail: int) -> Condition:
    """Return one rail of a condition: what is known to be on, or what can be on."""
    match condition:
        case LocalVariable(name):
            return rail == _MOST if name.startswith(_PULSE) else _on_rail(condition, rail)
        case Inverse(operand):
            return Inverse(_rail(operand, _MOST if rail == _LEAST else _LEAST))
        case Conjunction(left, right):
            return Conjunction(_rail(left, rail), _rail(right, rail))
        case Disjunction(left, right):
            return Disjunction(_rail(left, rail), _rail(right, rail))
    return condition
