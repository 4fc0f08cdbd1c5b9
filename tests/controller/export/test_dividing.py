"""Division of conditions that are too tall for the editor of GX Works2: same values, fewer lines."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from random import Random

import pytest

from controller.core.expr import And, Bit, Expr, Not, Or, Timer, all_of, any_of
from controller.core.program import Block, Program
from controller.core.rungs import Annunciate, Out, Rst, Rung, Set
from controller.core.scan import Plc
from controller.export.dividing import divided
from controller.export.instruction_list import contacts, export
from controller.fx.engine.plc import FxPlc
from controller.fx.language.editor_blocks import condition_lines, editor_blocks
from tests.sampling import one_in

X = [Bit("X", n) for n in range(64)]
MOST = 5
"""Lines in these tests, fewer than those of GX Works2 so that small conditions are divided."""


def lines(condition: Expr) -> int:
    return condition_lines(list(contacts(condition)))


def one_block(*rungs: Rung) -> Program:
    return Program("tall", (Block("logic", rungs), Block("outputs", (Out(Bit("Y", 0), X[0]),))), "outputs")


def conditions(chance: Random) -> Iterator[Expr]:
    """Yield random conditions: series in parallel in series, and their complements."""
    while True:
        groups: list[Expr] = [
            all_of(*(any_of(*chance.sample(X, chance.randint(1, 9))) for _ in range(chance.randint(1, 3))))
            for _ in range(chance.randint(1, 6))
        ]
        tall = any_of(*groups)
        yield ~tall if chance.random() < 0.3 else tall


@pytest.mark.parametrize("seed", one_in(2, range(4)))
def test_divided_conditions_are_low_and_have_the_same_values(seed: int) -> None:
    chance = Random(seed)
    whens = [when for when, _ in zip(conditions(chance), range(30), strict=False)]
    program = one_block(*(Out(Bit("M", 10 + n), when) for n, when in enumerate(whens)))
    result = divided(program, count(500), lines, MOST)
    assert max(lines(rung.when) for rung in program.rungs()) > MOST
    assert max(lines(rung.when) for rung in result.rungs()) <= MOST
    one, other = Plc(program, input_filter_ms=0), Plc(result, input_filter_ms=0)
    for scan in range(40):
        share = chance.random()
        levels = [chance.random() < share for _ in X]
        for plc in (one, other):
            plc.scan(10 * scan, levels)
        assert one.memory.M[10:100] == other.memory.M[10:100]


def test_a_relay_is_evaluated_again_after_a_write_to_its_devices() -> None:
    tall = any_of(*(Bit("M", n) for n in range(1, 9)))
    program = one_block(
        Set(Bit("M", 1), X[1]), Rst(Bit("M", 1), tall), Out(Bit("M", 20), tall), Out(Bit("M", 21), tall)
    )
    result = divided(program, count(500), lines, MOST)
    relays = [rung for rung in result.rungs() if isinstance(rung, Out) and rung.target.number >= 500]
    assert len(relays) == 2, "one before RST, one after it, none between the last two rungs"
    plc = Plc(result, input_filter_ms=0)
    plc.scan(0, [n == 1 for n in range(64)])
    assert (plc.memory.M[1], plc.memory.M[20], plc.memory.M[21]) == (False, False, False)


def test_low_conditions_are_unchanged() -> None:
    program = one_block(Out(Bit("M", 1), X[1] | X[2]), Out(Bit("M", 2), ~(X[3] & X[4])))
    assert [*divided(program, count(500), lines, MOST).rungs()] == [*program.rungs()]
    assert {type(condition) for condition in (X[1] | X[2], X[1] & X[2], ~(X[1] & X[2]))} == {Or, And, Not}


def test_many_outputs_of_one_condition_repeat_its_contacts() -> None:
    targets = [Bit("M", 10 + n) for n in range(60)]
    ladder = export(one_block(*(Set(target, X[1]) for target in targets)))
    assert all(block.fits for block in editor_blocks(ladder))
    plc = FxPlc(ladder, input_filter_ms=0)
    plc.scan(0, [n == 1 for n in range(64)])
    assert all(plc.memory.M[target.number] for target in targets)


def test_a_rung_after_an_annunciator_evaluates_its_own_condition() -> None:
    alarm, relay = Bit("S", 900), Bit("M", 10)
    ladder = export(one_block(Annunciate(Timer(1), 300, alarm, X[1]), Out(relay, X[1])))
    plc = FxPlc(ladder, input_filter_ms=0)
    seen = []
    for now_ms in range(0, 500, 100):
        plc.scan(now_ms, [n == 1 for n in range(64)])
        seen.append((plc.memory.S[alarm.number], plc.memory.M[relay.number]))
    assert seen == [(False, True)] * 3 + [(True, True)] * 2
