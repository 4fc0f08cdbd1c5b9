"""Auxiliary relays of the export: conditions are unchanged, and no relay is read after a write to its devices."""

from __future__ import annotations

from typing import TypeGuard

import pytest

from controller.core.expr import And, Bit, Compare, Expr, Not, Or, Timer, Word, all_of, any_of, leaves
from controller.core.program import Block, Program
from controller.core.rungs import Inc, Mov, OnDelay, Out, Rung, Set, ZoneReset, written_devices
from controller.core.sequence import Dwell, Step, To
from controller.core.sequence import Sequence as Steps
from controller.export import instruction_list, sharing
from controller.export.instruction_list import acting, export
from controller.export.sharing import RELAYS, shared
from controller.fx.language.check import budget, usage
from controller.fx.language.instruction import LadderError
from tests.controller.program.interlock_scene import MACHINE

X = [Bit("X", n) for n in range(8)]
M = [Bit("M", n) for n in range(8)]
D = [Word("D", n) for n in range(4)]
LONG = all_of(X[0], X[1] | X[2], ~X[3], X[4])
AT_4 = D[0].equals(4)


def small(*items: Rung | Steps) -> Program:
    return Program("small", (Block("logic", items), Block("outputs", (Out(Bit("Y", 0), M[0]),))), "outputs")


def relays(program: Program) -> dict[str, str]:
    """Return the conditions of the auxiliary relays."""
    return {str(rung.target): str(rung.when) for rung in program.rungs() if is_relay(rung)}


def is_relay(item: Rung | Steps) -> TypeGuard[Out]:
    return isinstance(item, Out) and item.target.kind == "M" and item.target.number in RELAYS


def conditions(program: Program) -> list[str]:
    """Return the conditions of all other rungs and of the sequences, in order."""
    items = (item for block in program.blocks for item in block.items if not is_relay(item))
    return [str(condition) for item in items for condition in _conditions(item)]


def test_repeated_condition_is_evaluated_once_before_its_first_use() -> None:
    program = shared(small(Out(M[2], X[5]), Out(M[3], LONG & X[7]), Out(M[4], X[6] | LONG), Out(M[5], LONG | X[5])))
    assert [str(*written_devices(rung)) for rung in program.block("logic").rungs()] == ["M2", "M3", "M500", "M4", "M5"]
    assert relays(program) == {"M500": str(LONG)}
    assert conditions(program)[2:4] == ["X6 | M500", "M500 | X5"]


def test_complement_is_read_from_the_same_relay() -> None:
    complement = any_of(~X[4], X[3], ~(X[2] | X[1]), ~X[0])
    program = shared(small(Out(M[1], LONG), Out(M[2], complement & X[5]), Out(M[3], ~LONG | X[6])))
    assert relays(program) == {"M500": str(LONG)}
    assert conditions(program)[1:3] == ["~M500 & X5", "~M500 | X6"]


def test_comparison_and_its_complement_have_one_relay() -> None:
    pairs = [(D[0].equals(4), D[0].differs(4)), (D[0] < D[1], D[0] >= D[1]), (D[0] > 4, D[0] <= 4)]
    for one, other in pairs:
        program = shared(small(Out(M[1], one & X[0]), Out(M[2], other & X[1])))
        assert relays(program) == {"M500": str(one)}
        assert conditions(program)[:2] == ["M500 & X0", "~M500 & X1"]


def test_condition_that_is_short_or_used_once_has_no_relay() -> None:
    items = [Out(M[1], X[0] & X[1] & X[2]), Out(M[2], (X[0] & X[1]) | X[3]), Out(M[3], (X[0] & X[1]) | X[4])]
    assert relays(shared(small(*items))) == {}
    assert relays(shared(small(Out(M[1], LONG), Out(M[2], LONG)))) == {}  # such rungs share their contacts


def test_contacts_that_many_conditions_have_in_common_have_one_relay() -> None:
    """Five conditions have X0 and ~X1 in common, one of them as its complement and one with X2 between them."""
    common = [all_of(X[0], ~X[1], X[n]) for n in (3, 4, 5)]
    items = [Out(M[n], condition) for n, condition in enumerate(common, 1)]
    items += [Out(M[4], any_of(X[6], ~X[0], X[1])), Out(M[5], all_of(X[0], X[2], ~X[1], X[7]))]
    program = small(*items)
    assert relays(shared(program)) == {"M500": "X0 & ~X1"}
    assert conditions(shared(program))[:5] == ["M500 & X3", "M500 & X4", "M500 & X5", "X6 | ~M500", "M500 & X2 & X7"]
    assert_every_condition_has_its_value(program)


def test_extracted_contacts_are_contacts_of_other_relays() -> None:
    """The relay of X0 and X1 is a contact of the relay that has X2 in addition."""
    items = [Out(Bit("M", 10 + n), all_of(X[0], X[1], X[2], D[n % 4] > n)) for n in range(8)]
    items += [Out(Bit("M", 20 + n), all_of(X[0], X[1], D[n % 4] < n)) for n in range(8)]
    program = small(*items)
    assert relays(shared(program)) == {"M500": "X0 & X1", "M501": "M500 & X2"}
    assert_every_condition_has_its_value(program)


TIMER = Timer(0, "timer")
DELAYED = all_of(TIMER.done, X[1], X[2], ~X[3], X[4])
HELD = all_of(M[5], X[1], X[2], ~X[3], X[4])
STATE = Bit("S", 21)
BUSY = all_of(STATE, X[1], X[2], ~X[3], X[4])
PAIR = Steps(
    "pair",
    20,
    [
        Step("rest", [To("busy", X[0])], waits_for="start"),
        Step("busy", [To("rest", BUSY | DELAYED | HELD)], dwell=Dwell(TIMER, 200), hold=[M[7]]),
    ],
    consumes=M[5],
)


@pytest.mark.parametrize(
    ("condition", "write"),
    [
        (AT_4, Mov(3, D[0], X[6])),
        (AT_4, Inc(D[0], X[6])),
        (HELD, Out(M[5], X[6])),
        (HELD, Set(M[5], X[6])),
        (HELD, ZoneReset(M[4], M[6], X[6])),
        (DELAYED, OnDelay(TIMER, 200, X[6])),
        (BUSY, PAIR),
        (DELAYED, PAIR),
        (HELD, PAIR),
    ],
)
def test_condition_is_evaluated_again_after_a_write_to_what_it_reads(condition: Expr, write: Rung | Steps) -> None:
    first, second, third = (Out(M[n], condition | X[5 + n]) for n in range(3))
    assert relays(shared(small(first, second))) == {"M500": str(condition)}
    written = {(device.kind, device.number) for device in writes(write)}
    assert not any(reads(rung.when) & written for rung in shared(small(first, write, second)).rungs() if is_relay(rung))
    assert_every_condition_has_its_value(small(first, second, write, third))


def test_condition_of_a_sequence_is_evaluated_before_its_first_step() -> None:
    steps = [
        Step("a", [To("b", any_of(LONG, X[5]))], waits_for="b"),
        Step("b", [To("a", any_of(LONG, X[6]))], waits_for="a"),
    ]
    program = shared(small(Steps("pair", 20, steps)))
    relay, sequence = program.block("logic").items
    assert relay == Out(Bit("M", 500), LONG)
    assert isinstance(sequence, Steps)
    assert conditions(program)[:2] == ["M500 | X5", "M500 | X6"]


def test_a_step_without_instructions_must_be_the_last_one() -> None:
    """The STL instruction of the step after it would follow directly, and the FX would join both branches."""
    begin, end, work = (
        Step("begin", [To("end", X[0]), To("work", X[1])], waits_for="start"),
        Step("end", [], waits_for="reset"),
        Step("work", [To("end", X[2])], waits_for="X2"),
    )
    assert export(small(Steps("bench", 20, [begin, work, end])))
    with pytest.raises(LadderError, match="step 'end' has no instructions"):
        export(small(Steps("bench", 20, [begin, end, work])))


def test_condition_that_the_sequence_changes_is_not_taken_out_of_it() -> None:
    twice = any_of(all_of(BUSY | HELD, X[5]), all_of(BUSY | HELD, X[6]), DELAYED)
    steps = [
        Step("a", [To("b", twice)], waits_for="b"),
        Step("b", [To("a", twice)], dwell=Dwell(TIMER, 200), hold=[M[7]]),
    ]
    assert relays(shared(small(Steps("pair", 20, steps, consumes=M[5])))) == {"M500": "X1 & X2 & ~X3 & X4"}


def normal(expr: Expr, *, negated: bool = False) -> object:
    """Return a normal form; conditions that differ only in order, nesting and inverted contacts have the same form."""
    match expr:
        case Not(operand):
            return normal(operand, negated=not negated)
        case And(operands) | Or(operands):
            series = isinstance(expr, And) != negated
            parts: set[object] = set()
            for part in (normal(operand, negated=negated) for operand in operands):
                nested = isinstance(part, tuple) and part[0] is series
                parts |= part[1] if nested and isinstance(part, tuple) else {part}
            return next(iter(parts)) if len(parts) == 1 else (series, frozenset(parts))
        case Compare(relation, left, right):
            opposites = {"==": "!=", "!=": "==", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
            return f"{left} {opposites[relation] if negated else relation} {right}"
    return f"{'~' if negated else ''}{expr}"


def expanded(expr: Expr, valid: dict[Bit, Expr]) -> Expr:
    """Return a condition with each auxiliary relay replaced by its condition; raise KeyError if a relay is outdated."""
    match expr:
        case Not(operand):
            return ~expanded(operand, valid)
        case And(operands):
            return all_of(*(expanded(operand, valid) for operand in operands))
        case Or(operands):
            return any_of(*(expanded(operand, valid) for operand in operands))
        case Bit("M", number) if number in RELAYS:
            return valid[expr]
    return expr


def assert_every_condition_has_its_value(program: Program) -> None:
    """Compare each condition with the original one, in scan order; a relay is outdated after a write to its devices.

    Raises:
        AssertionError: A condition differs, or a relay is read while it is outdated.
    """
    valid: dict[Bit, Expr] = {}
    for block, other in zip(program.blocks, shared(program).blocks, strict=True):
        originals = iter(block.items)
        for item in other.items:
            if is_relay(item):
                valid[item.target] = expanded(item.when, valid)
                continue
            original = next(originals)
            written = {(device.kind, device.number) for device in writes(original)}
            if isinstance(original, Steps):  # devices written by one step are read by the others
                valid = {relay: when for relay, when in valid.items() if not reads(when) & written}
            pairs = zip(_conditions(item), _conditions(original), strict=True)
            for found, expected in pairs:
                outdated = {bit for bit in leaves(found) if bit.kind == "M" and bit.number in RELAYS} - set(valid)
                assert not outdated, f"{original}: {outdated} outdated"
                assert normal(expanded(found, valid)) == normal(expected)
            valid = {relay: when for relay, when in valid.items() if not reads(when) & written}
        assert next(originals, None) is None


def _conditions(item: Rung | Steps) -> list[Expr]:
    return list(item.conditions()) if isinstance(item, Steps) else [item.when]


def reads(expr: Expr) -> set[tuple[str, int]]:
    return {(device.kind, device.number) for device in leaves(expr)}


def writes(item: Rung | Steps) -> list[Bit | Word]:
    """Return the devices that an item writes; independent of the function of the export."""
    if not isinstance(item, Steps):
        return list(written_devices(item))
    timers = [step.dwell.timer.done for step in item.steps if step.dwell]
    return [*item.bits.values(), *timers, *([] if item.consumes is None else [item.consumes])]


@pytest.mark.nightly
def test_every_condition_of_the_machine_has_its_value() -> None:
    """With the relays expanded, the conditions equal those of the program, and no outdated relay is read."""
    program = acting(MACHINE.program)
    assert_every_condition_has_its_value(program)
    assert len(relays(shared(program))) > 100


def test_relay_read_after_a_write_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "item_writes", lambda item: iter(()))
    with pytest.raises(AssertionError, match="outdated"):
        assert_every_condition_has_its_value(acting(MACHINE.program))


def test_program_that_uses_an_auxiliary_relay_is_rejected() -> None:
    with pytest.raises(LadderError, match="M500 to M1023 are reserved"):
        shared(small(Out(Bit("M", 1023), X[0])))


@pytest.mark.nightly
def test_relays_save_a_sixth_of_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    program = acting(MACHINE.program)
    steps = usage(export(program)).steps
    monkeypatch.setattr(instruction_list, "shared", lambda unchanged: unchanged)
    assert steps < usage(export(program)).steps * 5 / 6


def test_budget_accounts_for_every_step() -> None:
    program = acting(MACHINE.program)
    ladder = export(program)
    used = budget(ladder, ("power-up", *(block.title for block in program.blocks)))
    assert list(used) == ["power-up", *(block.title for block in program.blocks)]
    assert sum(used.values()) == usage(ladder).steps
    assert all(used.values())
