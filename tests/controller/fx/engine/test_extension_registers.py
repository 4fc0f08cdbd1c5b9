"""Extension registers R0 to R32767 of an FX3U, in both executions."""

from __future__ import annotations

from controller.core.devices import EXTENSION, Memory
from controller.fx.language.cpu_model import FX3U
from controller.fx.language.il import read_il
from tests.controller.fx.engine.fx_pair import PairedPlc

ALWAYS = """\
LD M8000
MOV K7 R0
DMOV K100000 R10
ADD R0 K1 R1
DADD R10 K1 D0
INC R2
MOV K2 Z0
MOV K9 R100Z0
MUL K300 K300 R20
ZRST R30 R32
RST R40
BMOV R0 R50 K2
MOV R32767 D5
WOR R0 H100 R32766
LD> R1 K7
OUT Y0
LDD= R10 K100000
OUT Y1
LD M8000
OUT T0 R60
END
"""


def plc_of(text: str) -> PairedPlc:
    return PairedPlc(read_il(text, cpu=FX3U), input_filter_ms=0)


def registers(memory: Memory, first: int, count: int = 1) -> list[int]:
    return memory.D[EXTENSION + first :][:count]


def test_instructions_of_16_and_32_bits() -> None:
    plc = plc_of(ALWAYS)
    memory = plc.memory
    for number, value in {29: 1, 30: 2, 31: 3, 32: 4, 33: 5, 40: 6, 41: 7, 60: 2, 32767: -8}.items():
        memory.set_word("R", number, value)
    plc.scan(0, [])
    assert registers(memory, 0, 3) == [7, 8, 1]
    assert registers(memory, 10, 2) == [100_000 - 2 * 65_536, 1]
    assert memory.D[:2] == [100_001 - 2 * 65_536, 1]
    assert registers(memory, 100, 4) == [0, 0, 9, 0]
    assert registers(memory, 20, 2) == [90_000 - 65_536, 1]
    assert registers(memory, 29, 5) == [1, 0, 0, 0, 5]
    assert registers(memory, 40, 2) == [0, 7]
    assert registers(memory, 50, 3) == [7, 8, 0]
    assert registers(memory, 32_766, 2) == [0x107, -8]
    assert memory.word("D", 5) == memory.word("R", 32_767) == -8
    assert memory.Y[:2] == [True, True]
    assert memory.TV[0] == 0
    plc.scan(200, [])
    assert (memory.T[0], memory.word("R", 2)) == (True, 2)


def test_no_instruction_reaches_beyond_the_registers_of_its_kind() -> None:
    """D8511 is followed by R0 in memory, but not in the PLC."""
    lines = ("MOV K1 D8511Z0", "MOV K1 R32767Z0", "MOV K1 R0Z1", "MUL K300 K300 D8511", "DMOVP K-1 D8510Z0")
    for line in lines:
        plc = plc_of(f"LD M8000\n{line}\nEND\n")
        memory = plc.memory
        memory.D[8028], memory.D[8182] = 1, -1
        before = memory.D[8200:].copy()
        plc.scan(0, [])
        assert memory.M[8067], line
        assert memory.D[8200:] == before, line


def test_they_are_latched() -> None:
    plc = plc_of("LD X0\nOUT M8032\nLD X1\nOUT M8031\nEND\n")
    plc.memory.set_word("R", 32_767, 5)
    plc.power_cycle()
    plc.scan(0, [False, True])
    plc.scan(10, [False, True])
    assert plc.memory.word("R", 32_767) == 5
    plc.scan(20, [True, False])
    plc.scan(30, [True, False])
    assert plc.memory.word("R", 32_767) == 0
