"""Conditions as data: construction, text form, evaluation and compilation."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from controller.core.compile import expression
from controller.core.devices import Memory
from controller.core.expr import (
    COMPARISONS,
    FALSE,
    TRUE,
    And,
    Bit,
    Compare,
    Const,
    Counter,
    Expr,
    Not,
    Or,
    Timer,
    Word,
    all_of,
    any_of,
    evaluate,
    leaves,
)
from controller.core.rungs import Out
from tests.controller.core.core_rig import THOROUGH, Rig, d, m, s, t, x

A, B, C = m(0), m(1), m(2)

BITS = st.builds(Bit, st.sampled_from("XMSTC"), st.integers(0, 3))
WORDS = st.builds(Word, st.sampled_from("DTC"), st.integers(0, 2))
COMPARES = st.builds(Compare, st.sampled_from(sorted(COMPARISONS)), WORDS, WORDS | st.integers(-3, 3))
CONSTANTS = st.sampled_from([TRUE, FALSE])


def _branches(inner: st.SearchStrategy[Expr]) -> st.SearchStrategy[Expr]:
    """Return a strategy for trees built with & | ~ and for unflattened trees built directly from the classes."""
    several = st.lists(inner, min_size=1, max_size=3).map(tuple)
    return st.one_of(
        st.builds(lambda a, b: a & b, inner, inner),
        st.builds(lambda a, b: a | b, inner, inner),
        st.builds(lambda a: ~a, inner),
        st.builds(Not, inner),
        st.builds(And, several),
        st.builds(Or, several),
    )


CONDITIONS: st.SearchStrategy[Expr] = st.recursive(BITS | COMPARES | CONSTANTS, _branches, max_leaves=12)


@st.composite
def memories(draw: st.DrawFn) -> Memory:
    """Draw a memory with arbitrary values in the first devices of each kind."""
    memory = Memory()
    for kind in "XMSTC":
        memory.bits(kind)[:4] = draw(st.lists(st.booleans(), min_size=4, max_size=4))
    for words in (memory.D, memory.TV, memory.CV):
        words[:3] = draw(st.lists(st.integers(-4, 4), min_size=3, max_size=3))
    return memory


def compiled(condition: Expr, memory: Memory) -> object:
    lists = {name: getattr(memory, name) for name in ("X", "Y", "M", "S", "T", "C", "D", "TV", "CV")}
    return eval(expression(condition), lists)  # noqa: S307 - text generated from a checked condition


def truth_table(condition: Expr) -> list[bool]:
    """Return the values of a condition over A, B and C in counting order."""
    table = []
    for row in product([False, True], repeat=3):
        memory = Memory()
        memory.M[:3] = row
        table.append(evaluate(condition, memory))
    return table


@THOROUGH
@given(CONDITIONS, memories())
@example(Not(And((A, Or((B, C))))), Memory())
@example(And((Or((A, TRUE)), Compare("<", d(0), 3))), Memory())
def test_the_compiled_expression_is_equivalent_to_the_condition(condition: Expr, memory: Memory) -> None:
    result = compiled(condition, memory)
    assert result is evaluate(condition, memory)


@pytest.mark.parametrize(
    ("condition", "table"),
    [
        # A B C:     000 001 010 011 100 101 110 111
        (A & B, "00000011"),
        (A | B, "00111111"),
        (~A, "11110000"),
        (A & ~B | C, "01011101"),
        (A & (B | C), "00000111"),
        (~(A & B) & C, "01010100"),
        (all_of(), "11111111"),
        (any_of(), "00000000"),
        (A & TRUE, "00001111"),
        (A & FALSE, "00000000"),
        (A | TRUE, "11111111"),
        (A | FALSE, "00001111"),
    ],
)
def test_truth_tables(condition: Expr, table: str) -> None:
    assert truth_table(condition) == [value == "1" for value in table]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (~(A & B), ~A | ~B),
        (~(A | B), ~A & ~B),
        (~(A & ~B & C), ~A | B | ~C),
        (A & (B | C), (A & B) | (A & C)),
        (A | (A & B), A),
    ],
)
def test_de_morgan_distributive_and_absorption_laws(one: Expr, other: Expr) -> None:
    assert truth_table(one) == truth_table(other)
    assert truth_table(one) != truth_table(~other)


@pytest.mark.parametrize(
    "misuse",
    [
        lambda: A and B,  # type: ignore[unreachable]
        lambda: A or B,  # type: ignore[unreachable]
        lambda: not A,
        lambda: bool(~A),
        lambda: bool(d(0) >= 3),
        lambda: 1 if d(0).equals(0) else 2,
        lambda: bool(TRUE),
        lambda: 0 < d(0) < 3,
    ],
)
def test_boolean_operators_of_python_are_rejected(misuse: Callable[[], object]) -> None:
    with pytest.raises(TypeError, match=r"use & \| ~ instead of and / or / not"):
        misuse()


def test_a_word_compared_with_double_equals_is_not_a_condition() -> None:
    """For words, `==` is Python equality, which tag tables need; its result is rejected as a condition."""
    with pytest.raises(TypeError, match="not a condition: False"):
        Rig(Out(m(9), when=d(0) == 3))  # type: ignore[arg-type, comparison-overlap]


def test_nested_series_and_parallel_conditions_are_flattened() -> None:
    assert A & B & C == A & (B & C) == And((A, B, C))
    assert A | B | C == A | (B | C) == Or((A, B, C))
    assert Or((And((A, B)), C)) == (A & B) | C
    assert And((Or((A, B)), C)) == (A | B) & C
    assert all_of(A) is A
    assert any_of(A) is A
    assert all_of(TRUE, A, TRUE) is A
    assert any_of(FALSE, A, FALSE) is A
    assert (all_of(), any_of()) == (TRUE, FALSE)
    assert all_of(A, FALSE, B) is FALSE
    assert any_of(A, TRUE, B) is TRUE


def test_a_double_negation_is_the_condition_itself() -> None:
    for condition in (A, A & B, A | B, d(0) >= 3):
        assert ~~condition is condition
        assert ~condition == Not(condition)
    assert ~TRUE is FALSE
    assert ~FALSE is TRUE


def test_device_equality_ignores_name_and_comment() -> None:
    assert Bit("M", 3, "left.loaded", "plugs in the claws") == m(3)
    assert hash(Bit("M", 3, "left.loaded")) == hash(m(3))
    assert m(3) != s(3)
    assert m(3) != m(4)
    assert Word("D", 3, "cups") == d(3) != Word("T", 3)
    assert Timer(5, "settle") == Timer(5)
    assert Timer(5, "settle", "plate comes to rest").done == Bit("T", 5)
    assert Timer(5, "settle", "plate comes to rest").done.comment == "plate comes to rest"
    assert Counter(5, "cups").value == Word("C", 5)
    assert Counter(5, "cups").value.name == "cups"


@pytest.mark.parametrize(
    ("condition", "text"),
    [
        (x(8) & ~A, "X10 & ~M0"),
        ((A | B) & C, "(M0 | M1) & M2"),
        (A & B | C, "(M0 & M1) | M2"),
        (~(A | B), "~(M0 | M1)"),
        (~(d(5) >= 12), "~(D5 >= 12)"),
        (d(5).equals(d(6)), "D5 == D6"),
        (d(5).differs(-1), "D5 != -1"),
        (TRUE, "always"),
        (FALSE, "never"),
        (Counter(100).done & Timer(246).done, "C100 & T246"),
    ],
)
def test_the_text_of_a_condition_uses_fx_names(condition: Expr, text: str) -> None:
    assert str(condition) == text


def test_the_text_of_timers_and_counters_uses_fx_names() -> None:
    assert (str(Timer(7)), str(Counter(235)), str(d(8000)), str(t(7))) == ("T7", "C235", "D8000", "T7")


@pytest.mark.parametrize(
    ("condition", "below", "equal", "above"),
    [
        (d(0) < 3, True, False, False),
        (d(0) <= 3, True, True, False),
        (d(0).equals(3), False, True, False),
        (d(0).differs(3), True, False, True),
        (d(0) >= 3, False, True, True),
        (d(0) > 3, False, False, True),
        (d(0) < d(1), True, False, False),
        (d(1) < d(0), False, False, True),
    ],
)
def test_comparisons_around_their_limit(condition: Expr, below: bool, equal: bool, above: bool) -> None:
    memory = Memory()
    memory.D[1] = 3
    for value, expected in ((2, below), (3, equal), (4, above)):
        memory.D[0] = value
        assert evaluate(condition, memory) is expected
        assert compiled(condition, memory) is expected


def test_leaves_are_the_devices_that_a_condition_reads() -> None:
    condition = (A | ~B) & (d(0) < d(1)) & (Word("T", 3) >= 5) & ~(C & TRUE)
    assert list(leaves(condition)) == [A, B, d(0), d(1), Word("T", 3), C]
    assert list(leaves(Const(value=True))) == []


@pytest.mark.parametrize("nonsense", [True, "M0", None, d(0)])
def test_a_value_that_is_not_a_condition_is_rejected(nonsense: object) -> None:
    with pytest.raises(TypeError, match="not a condition"):
        expression(nonsense)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="not a condition"):
        evaluate(nonsense, Memory())  # type: ignore[arg-type]
