"""Frequent applied instructions as statements: the same result as that of their Python functions."""

from __future__ import annotations

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from controller.core.devices import SIZES, Memory
from controller.fx.engine import outputs
from controller.fx.engine.machine_functions import MachineFunctions
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.translate import translate
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Ladder, LadderError, Operand
from controller.fx.language.instruction_set import FORMS, OPERAND_KINDS
from tests.controller.fx.engine.applied.fx_applied_rig import assert_same
from tests.controller.fx.engine.applied.test_any import memories
from tests.sampling import examples

ALWAYS_ON = "X377"
"""Contact that no instruction writes."""
NAMES = ("MOV", "CMP", "ZCP", "INC", "DEC", "ADD", "SUB", "MUL", "WAND", "WOR", "WXOR", "ZRST")
INSTRUCTIONS = sorted(name for name, form in FORMS.items() if form.kind.name in NAMES and not form.pulsed)
VALUES = st.integers(-3, 20) | st.sampled_from((-32768, 32767, 70_000, -(2**31), 2**31 - 1))
NUMBERS = st.integers(0, 9) | st.sampled_from((199, 200, 203, 255, 999, 3068, 7998, 7999))
UnpairedPlc = FxPlc


@st.composite
def operands(draw: st.DrawFn, kinds: frozenset[str]) -> Operand:
    """Draw an operand without index; the devices of several operands often overlap."""
    kind = draw(st.sampled_from(sorted(kinds - {"D.b", "R"})))
    if kind in ("K", "H"):
        value = draw(VALUES)
        return Constant(abs(value) if kind == "H" else value, "H" if kind == "H" else "K")
    number = draw(st.integers(0, 7) if kind in ("V", "Z") else NUMBERS)
    if kind.startswith("Kn"):
        return Digits(draw(st.integers(1, 8)), DeviceOperand(kind[2:], number))
    return DeviceOperand(kind, number)


def always(instruction: str) -> Ladder:
    """Return a program with one instruction that is always driven."""
    return read_il(f"LD {ALWAYS_ON}\n{instruction}\nEND\n")


@st.composite
def ladders(draw: st.DrawFn) -> Ladder:
    """Draw a valid instruction, always driven."""
    name = draw(st.sampled_from(INSTRUCTIONS))
    drawn = [draw(operands(OPERAND_KINDS[place])) for place in FORMS[name].kind.operands]
    try:
        return always(f"{name} {' '.join(map(str, drawn))}")
    except LadderError:
        assume(False)
        raise


def executed(plc: FxPlc, before: Memory) -> Memory:
    for name in Memory.__slots__:
        getattr(plc.memory, name)[:] = getattr(before, name)
    plc.memory.X[0o377] = True
    plc.execution.run(0)
    return plc.memory


@examples(20, nightly=120)
@given(ladders(), memories())
@example(always("MUL D0 D1 D7999"), Memory())
@example(always("MUL D0 D1 D8255"), Memory())
@example(always("DMOV D1 D2"), Memory(D=list(range(SIZES["D"]))))
def test_statements_have_the_result_of_the_python_function(ladder: Ladder, before: Memory) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outputs, "plain_action", lambda *_: None)
        expected = executed(UnpairedPlc(ladder), before)
    assert_same(executed(UnpairedPlc(ladder), before), expected)
    assert_same(executed(UnpairedPlc(ladder, execution=MachineFunctions), before), expected)


@pytest.mark.parametrize(
    "instruction",
    [
        *(
            "MOV D0 D1",
            "MOVP K5 D1",
            "DMOV D0 D2",
            "MOV K2X0 D0",
            "MOV D0 K4M0",
            "DMOV K8M0 D0",
            "MOV C0 D0",
            "MOV T0 V0",
        ),
        *("CMP D0 K5 M0", "DCMP D0 C200 Y0", "ZCP K1 D0 K3X0 M0", "INC D0", "DEC Z0", "DINC D0", "DDEC C200"),
        *("ADD D0 K1 D0", "DADDP D0 D2 D4", "SUB T0 C0 D0", "MUL D0 D1 D2", "WAND D0 H0F D1", "WOR D0 K1M0 D1"),
        *("DWXOR D0 D2 D4", "ZRST M0 M9", "ANS T0 K5 S900"),
    ],
)
def test_these_instructions_need_no_python_function(instruction: str) -> None:
    assert translate(read_il(f"LD X0\n{instruction}\nLDD> D0 K70000\nAND= K1X0 T0\nOUT Y0\nEND\n")).operations == ()
