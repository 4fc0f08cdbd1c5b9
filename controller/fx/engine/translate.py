"""Translation of an instruction list to a program of conditions and assignments.

The program does not depend on the execution: `python_functions` and `machine_functions` execute it with the same
result. The rules and their verification marks are those of docs/sources/fx2n.md 1.1 and 1.7. Rules for cases not
covered there:

- An edge contact (LDP and similar) stores the level of its device when it is executed.
- Leaving a step executes its coils once without power. A coil that another active step drives is not affected;
  a PLF does not produce a pulse.
- Timers that are skipped by a jump continue with the clock: their next current value includes the time in between.
- While master control is off, nothing in its range has power. After a jump into its range, master control is on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from controller.fx.engine.code import (
    GATES,
    MAIN,
    Branch,
    Condition,
    Conjunction,
    Label,
    Leave,
    Let,
    LocalVariable,
    Network,
    Repetition,
    Routine,
    RowElement,
    Spend,
    Statement,
    Store,
    TranslatedProgram,
    interrupt_name,
    subroutine_name,
)
from controller.fx.engine.conditions import Numbering, RungBuilder, RungRecorder, are_last_outputs
from controller.fx.engine.outputs import Outputs, active
from controller.fx.engine.parts import LadderStep, Loop, Part, number_of, parts_of, steps_of
from controller.fx.language.instruction import Ladder


def translate(ladder: Ladder, *, observed: bool = False) -> TranslatedProgram:
    """Translate an instruction list.

    Args:
        ladder: The program.
        observed: Whether the program also records contacts and power in `OBSERVED_ROWS`; it has the same effect on all
            other rows.

    Raises:
        LadderError: The program contains a part that the engine does not support.
    """
    return _Translator(ladder, observed=observed).program()


class _Translator:
    """Translator of one program."""

    def __init__(self, ladder: Ladder, *, observed: bool) -> None:
        self._recorder = RungRecorder(len(ladder.instructions) if observed else 0)
        self._list = ladder.instructions
        self._cpu = ladder.cpu
        self._block_starts = {self._first_of_block(title) for title in ladder.titles}
        self._is_last = are_last_outputs(self._list)
        self._parts = parts_of(ladder)
        self._numbering = Numbering()
        self._outputs = Outputs(self._list, self._parts, self._numbering)
        self._gates: dict[int, RowElement] = {}

    def program(self) -> TranslatedProgram:
        main = self._routine(MAIN, self._parts.main)
        subroutines = [self._routine(subroutine_name(n), body) for n, body in self._parts.subroutines.items()]
        interrupts = [self._routine(interrupt_name(n), body) for n, body in self._parts.interrupts.items()]
        used = self._numbering
        return TranslatedProgram(
            main,
            tuple(subroutines),
            tuple(used.shared),
            tuple(sorted(used.operations)),
            tuple(sorted(used.sources)),
            len(used.edges),
            self._parts.step_count,
            len(used.levels),
            self._cpu,
            tuple(interrupts),
            self._recorder.count,
        )

    # structure

    def _routine(self, name: str, parts: tuple[Part, ...]) -> Routine:
        self._gates = {}
        return Routine(name, tuple(sorted(self._levels(parts))), tuple(self._body(parts)))

    def _levels(self, parts: tuple[Part, ...]) -> set[int]:
        """Return the levels of master control that a body opens, including its loops."""
        levels = {number_of(self._list[i]) for i in parts if isinstance(i, int) and self._list[i].name == "MC"}
        return levels.union(*(self._levels(part.body) for part in parts if isinstance(part, Loop)))

    def _body(self, parts: tuple[Part, ...]) -> Iterator[Network | Label | Repetition]:
        """Yield the rungs, steps, labels and loops of a body."""
        rung, indexes = self._rung([]), list[int]()
        for part in parts:
            separate = not isinstance(part, int) or self._list[part].name == "P"
            if indexes and (separate or rung.empty):
                yield self._network(indexes, rung.statements)
                rung, indexes = self._rung([]), []
            match part:
                case LadderStep():
                    yield self._step(part)
                case Loop():
                    yield from self._reached(part.at)
                    yield self._loop(part)
                case _ if separate:
                    yield Label(number_of(self._list[part]))
                    yield from self._reached(part)
                case _:
                    indexes.append(part)
                    self._instruction(part, rung, None)
        if indexes:
            yield self._network(indexes, rung.statements)

    def _network(self, indexes: Sequence[int], statements: Iterable[Statement]) -> Network:
        source = " ".join(str(self._list[i]) for i in indexes)
        return Network(tuple(statements), source, not self._block_starts.isdisjoint(indexes))

    def _reached(self, i: int) -> Iterator[Network]:
        """Yield, in an observed program, the record that an instruction without power has been executed."""
        if self._recorder.count:
            yield Network(tuple(self._recorder.power(i, True, self._gates.values())), "", begins_block=False)

    def _loop(self, loop: Loop) -> Repetition:
        self._numbering.operations.add(loop.at)
        spend = Spend(steps_of(self._list, loop.body))
        return Repetition(loop.at, (Network((spend,), "", begins_block=False), *self._body(loop.body)))

    def _step(self, step: LadderStep) -> Network:
        """Return a step: one branch that runs while its states are on, and one, without power, for the scan after."""
        was_active = RowElement("A", step.number)
        rung = self._rung([Store(was_active, value=True)])
        for i in step.body:
            self._instruction(i, rung, step)
        left: list[Statement] = [Store(was_active, value=False)]
        for i in step.body:
            off = self._outputs.left(i, step)
            left += [*off, *self._recorder.power(i, False)] if off else ()
        execution = Branch(active(step), tuple(rung.statements), (Branch(was_active, tuple(left)),))
        heads = [record for head in step.heads for record in self._recorder.power(head, active(step))]
        return self._network(step.body, [*heads, execution])

    # rungs

    def _rung(self, statements: list[Statement]) -> RungBuilder:
        return RungBuilder(statements, self._numbering)

    def _instruction(self, i: int, rung: RungBuilder, step: LadderStep | None) -> None:
        instruction = self._list[i]
        match instruction.name:
            case "RET":
                rung.clear()
            case "FEND" | "SRET" | "IRET":  # of the main program, followed by code that a jump can reach
                rung.statements += [*self._recorder.power(i, True, self._gates.values()), Leave()]
                rung.clear()
                return
            case "MCR":
                level = number_of(instruction)
                self._gates = {number: gate for number, gate in self._gates.items() if number < level}
                rung.clear()
            case _ if rung.add(i, instruction):
                rung.statements += self._recorder.contact(i, rung, self._gates.values())
                return
            case _:
                self._output(i, rung, step)
                return
        rung.statements += self._recorder.power(i, True, self._gates.values())

    def _output(self, i: int, rung: RungBuilder, step: LadderStep | None) -> None:
        instruction, last = self._list[i], self._is_last[i]
        power = self._power(rung, last=last)
        if self._recorder.count:
            variable = LocalVariable(f"o{i}")
            rung.statements += [Let(variable, power), *self._recorder.power(i, variable, self._gates.values())]
            power = variable
        rung.statements += self._outputs.with_power(i, power, step)
        if instruction.name == "MC":
            level = number_of(instruction)
            self._gates[level] = RowElement(GATES, level)
        if last:
            rung.end_output()

    def _power(self, rung: RungBuilder, *, last: bool) -> Condition:
        """Return the condition of an output, including master control."""
        condition = rung.condition
        if condition is not None and not last:
            condition = rung.named()
        power: Condition | None = None
        for part in (*self._gates.values(), condition):
            if part is not None:
                power = part if power is None else Conjunction(power, part)
        return True if power is None else power

    def _first_of_block(self, title: int) -> int:
        """Return the index of the first instruction after a title that is part of a rung or step."""
        while title < len(self._list) - 1 and self._list[title].name in ("NOP", "STL"):
            title += 1
        return title
