"""One-change variants of rungs, steps and their order, and samples of them."""

from __future__ import annotations

import pytest

from controller.core.expr import Expr, Timer, all_of
from controller.core.program import Block, Program
from controller.core.rungs import Mov, OnDelay, Out, Rst, Rung, Set
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.verify.mutants.change import Change, Kind, changes_of, conditions_of
from controller.verify.mutants.sample import mutants_of, sample
from tests.controller.core.core_rig import d, m, x, y
from tests.controller.verify.proof_rig import MACHINE


def variants(expr: Expr, kind: Kind) -> list[str]:
    return [str(changed) for found, _, changed in conditions_of(expr) if found is kind]


def of_kind(kind: Kind, *items: Rung | Sequence) -> list[Change]:
    return [change for change in changes_of(items) if change.kind is kind]


def test_every_contact_is_inverted_alone() -> None:
    """A normally open contact becomes normally closed and vice versa; the other contacts remain."""
    expr = all_of(x(0), ~x(1), x(2) | m(3))
    assert variants(expr, Kind.CONTACT) == [
        "~X0 & ~X1 & (X2 | M3)",
        "X0 & X1 & (X2 | M3)",
        "X0 & ~X1 & (~X2 | M3)",
        "X0 & ~X1 & (X2 | ~M3)",
    ]


def test_every_term_is_dropped_alone() -> None:
    """A term of a series or parallel connection is dropped, at every level; a single contact has no term."""
    assert variants(all_of(x(0), x(2) | ~m(3)), Kind.TERM) == ["X2 | ~M3", "X0", "X0 & ~M3", "X0 & X2"]
    assert variants(x(0), Kind.TERM) == []


def test_negated_connections_are_changed_inside() -> None:
    assert variants(~(x(0) & x(1)), Kind.TERM) == ["~X1", "~X0"]


def test_outputs_are_swapped() -> None:
    """The targets of two coils that follow each other are exchanged; their conditions remain."""
    [change] = of_kind(Kind.OUTPUT, Out(y(0), x(0)), Set(m(0), x(5)), Out(y(1), x(1)))
    assert change.items == (Out(y(1), x(0)), Set(m(0), x(5)), Out(y(0), x(1)))


def test_the_order_of_set_and_reset_is_exchanged() -> None:
    """The latch then gives priority to the other input."""
    [change] = of_kind(Kind.PRIORITY, Set(m(0), x(0)), Out(y(1), x(2)), Rst(m(0), x(1)))
    assert change.items == (Rst(m(0), x(1)), Out(y(1), x(2)), Set(m(0), x(0)))


def test_set_and_reset_are_exchanged() -> None:
    assert [change.items for change in of_kind(Kind.LATCH, Set(m(0), x(0)), Rst(m(0), x(1)))] == [
        (Rst(m(0), x(0)), Rst(m(0), x(1))),
        (Set(m(0), x(0)), Set(m(0), x(1))),
    ]


def test_a_preset_is_doubled_and_halved_within_its_base() -> None:
    """A 100 ms timer with one count cannot be halved."""
    presets = [
        rung.preset
        for timer, preset in ((Timer(0), 100), (Timer(200), 50))
        for change in of_kind(Kind.PRESET, OnDelay(timer, preset, x(0)))
        for rung in change.items
        if isinstance(rung, OnDelay)
    ]
    assert presets == [200, 100, 20]


def test_a_moved_constant_is_replaced_by_another_one_of_the_same_register() -> None:
    changed = of_kind(Kind.TARGET, Mov(1, d(0), x(0)), Mov(2, d(0), x(1)), Mov(3, d(1), x(2)))
    assert [[rung.source for rung in change.items if isinstance(rung, Mov)] for change in changed] == [
        [2, 2, 3],
        [1, 1, 3],
    ]


def test_transfers_lead_to_the_neighbours_of_their_target_and_dwells_change() -> None:
    """The transfer of the first of three steps leads to the third or to the first instead of the second."""
    steps = [
        Step("one", [To("two", x(0))], dwell=Dwell(Timer(200), 100)),
        Step("two", [To("three", x(1))], waits_for="X1"),
        Step("three", [], waits_for="nothing"),
    ]
    sequence = Sequence("steps", 20, steps)
    targets = [
        change.items[0].transfers["one"][0].target
        for change in of_kind(Kind.TARGET, sequence)
        if isinstance(change.items[0], Sequence) and change.text.startswith("'one'")
    ]
    assert targets == [sequence["three"], sequence["one"]]
    assert [change.text for change in of_kind(Kind.PRESET, sequence)] == [
        "dwell of 'one': 200 ms instead of 100 ms",
        "dwell of 'one': 50 ms instead of 100 ms",
    ]
    assert sequence.transfers["one"][0].target == sequence["two"]


# samples


def test_every_kind_of_change_exists_in_the_machine_program_and_names_are_unique() -> None:
    mutants = mutants_of(MACHINE.program)
    assert {mutant.kind for mutant in mutants} == set(Kind)
    assert len({str(mutant) for mutant in mutants}) == len(mutants)


@pytest.mark.nightly
def test_a_sample_contains_every_kind_and_begins_every_larger_one() -> None:
    """Another seed gives another sample; every sampled program differs from the original in one block."""
    mutants = mutants_of(MACHINE.program)
    chosen = sample(mutants, 70, 1)
    assert sample(mutants, 20, 1) == chosen[:20]
    assert sample(mutants, 70, 2) != chosen
    assert [sum(each.kind is kind for each in chosen) for kind in Kind] == [10] * len(Kind)
    for mutant in chosen:
        pairs = zip(mutant.program.blocks, MACHINE.program.blocks, strict=True)
        assert [one.title for one, other in pairs if one != other] == [mutant.block]


@pytest.mark.nightly
def test_a_new_rung_leaves_most_of_a_sample_as_it_was() -> None:
    """After a rung is added to a block, at least nine tenths of the sample are the same changes."""
    program = MACHINE.program
    blocks = list(program.blocks)
    number = next(n for n, block in enumerate(blocks) if block.title == "modes")
    blocks[number] = Block("modes", (*blocks[number].items, Out(m(2999), all_of(x(0), x(1)))))
    extended = Program(program.name, tuple(blocks), program.outputs, program.system, program.set_points)
    one, other = ({str(each) for each in sample(mutants_of(each), 140, 1)} for each in (program, extended))
    assert len(one & other) >= 0.9 * 140
