"""All applied instructions with arbitrary valid operands: they run, or fail without changing the memory."""

from __future__ import annotations

from itertools import cycle, islice

from hypothesis import given
from hypothesis import strategies as st

from controller.core.devices import SIZES, Memory
from controller.fx.engine.applied.table import ACTIONS, LEVELS
from controller.fx.engine.cpu import Cpu, OperationError, index_register
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Operand
from controller.fx.language.instruction_set import FORMS, OPERAND_KINDS, Form
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import assert_same
from tests.sampling import examples

WORD = st.integers(-(2**15), 2**15 - 1)
SMALL = st.integers(-2, 40)
INDEXES: tuple[str, ...] = ("V0", "Z0", "V7", "Z7")
ONLY_FX3U = frozenset({"D.b", "E", "R"})
APPLIED = sorted(name for name, form in FORMS.items() if form.kind.name in {*ACTIONS, *LEVELS} and not form.pulsed)


@st.composite
def devices(draw: st.DrawFn, kind: str) -> DeviceOperand:
    """Draw a device of a kind, often near the ends of its range."""
    if kind in "VZ":
        return DeviceOperand(kind, draw(st.integers(0, 7)))
    ranges = {"M": [(0, 3071), (8000, 8255)], "D": [(0, 7999), (8000, 8255)]}.get(kind, [(0, SIZES[kind] - 1)])
    low, high = draw(st.sampled_from(ranges))
    number = draw(st.integers(low, high) | st.integers(low, low + 20) | st.integers(high - 5, high))
    return DeviceOperand(kind, number, draw(st.sampled_from(["", "", *INDEXES])))


@st.composite
def operands_of(draw: st.DrawFn, place: str, wide: bool) -> Operand:
    """Draw an operand that is valid in the role `place`, a key of `OPERAND_KINDS`."""
    kind = draw(st.sampled_from(sorted(OPERAND_KINDS[place] - {*ONLY_FX3U, "I"})))
    if kind in ("K", "H"):
        value = draw(SMALL | (st.integers(-(2**31), 2**31 - 1) if wide else WORD))
        return Constant(value, draw(st.sampled_from(["K", "H"])), draw(st.sampled_from(["", *INDEXES])))
    if kind.startswith("Kn"):
        return Digits(draw(st.integers(1, 8 if wide else 4)), draw(devices(kind[2:])))
    return draw(devices(kind))


@st.composite
def instructions(draw: st.DrawFn) -> tuple[Form, tuple[Operand, ...]]:
    form = FORMS[draw(st.sampled_from(APPLIED))]
    if form.kind.name == "ZRST":
        kind = draw(st.sampled_from(sorted(OPERAND_KINDS["zone"] - ONLY_FX3U)))
        return form, (draw(devices(kind)), draw(devices(kind)))
    return form, tuple(draw(operands_of(place, form.wide)) for place in form.kind.operands)


@st.composite
def memories(draw: st.DrawFn) -> Memory:
    """Draw a memory with small and arbitrary numbers in the registers, and arbitrary bits."""
    memory = Memory()
    values = draw(st.lists(SMALL | WORD, min_size=5, max_size=9))
    for words in (memory.D, memory.TV, memory.CV):
        words[:] = islice(cycle(values), len(words))
    for name in INDEXES:
        memory.D[index_register(name)] = draw(st.integers(-30, 30) | WORD)
    for kind in "XYMSTC":
        levels = draw(st.lists(st.booleans(), min_size=3, max_size=11))
        cells = memory.bits(kind)
        cells[:] = islice(cycle(levels), len(cells))
    return memory


def assert_sound(memory: Memory) -> None:
    """Check that all values are present and in range."""
    fresh = Memory()
    assert all(len(getattr(memory, name)) == len(getattr(fresh, name)) for name in Memory.__slots__)
    assert all(-(2**15) <= value < 2**15 for value in [*memory.D, *memory.TV, *memory.CV[:200]])
    assert all(-(2**31) <= value < 2**31 for value in memory.CV[200:])
    assert all(isinstance(bit, bool) for kind in "XYMSTC" for bit in memory.bits(kind))


@examples(30, nightly=100)
@given(instructions(), memories())
def test_instruction_runs_or_changes_nothing(instruction: tuple[Form, tuple[Operand, ...]], memory: Memory) -> None:
    form, operands = instruction
    name, cpu = form.kind.name, Cpu(memory, now_ms=12_345, terminals=[True] * 32)
    before = copied(memory)
    try:
        if name in ACTIONS:
            ACTIONS[name](cpu, operands, form.wide)()
        else:
            LEVELS[name](cpu, operands, form.wide)(True)
    except OperationError:
        assert_same(memory, before)
    assert_sound(memory)
