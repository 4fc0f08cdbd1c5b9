"""CPU models: an FX2N refuses by name what only an FX3U has, and an FX3U accepts it."""

from __future__ import annotations

import pytest

from controller.fx.language.check import check, usage
from controller.fx.language.cpu_model import CPU_MODELS, FX2N, FX3U
from controller.fx.language.gx_csv import read_gx_csv, write_gx_csv
from controller.fx.language.il import read_il, write_il
from controller.fx.language.instruction import LadderError, RealConstant, WordBit
from controller.fx.language.instruction_set import FORMS, steps
from controller.fx.language.operand_rules import OperandError
from controller.fx.language.parsing import parse_operand

ONLY_FX3U = (
    "DEMOV E1.5 D0",
    "DEADD D0 E-2.5-3 D2",
    "OUT T511 K5",
    "OUT M7679",
    "SET S4095",
    "OUT D100.F",
    "DRVI K100 K1000 Y0 Y4",
    "DDRVA K100000 K1000 Y1 M0",
    "DENEG D0",
    "MOV D8511 D0",
    "MOV K5 R32767",
    "DMOV R32766 D0",
    "OUT T0 R5",
    "MOV R0Z0 D0",
)


@pytest.mark.parametrize("line", ONLY_FX3U)
def test_fx2n_refuses_with_the_remedy(line: str) -> None:
    with pytest.raises(LadderError) as caught:
        read_il(f"LD X0\n{line}\nEND")
    (message,) = str(caught.value).splitlines()
    assert message.startswith("program:2:")
    assert "FX3U" in message or "does not exist on an FX2N" in message
    assert "use --cpu fx3u" in message


def test_fx3u_accepts_and_writes_everything_back() -> None:
    text = "LD X0\n" + "\n".join(ONLY_FX3U) + "\nEND"
    ladder = read_il(text, cpu=FX3U)
    assert ladder.cpu is FX3U
    assert read_il(write_il(ladder), cpu=FX3U) == ladder
    assert read_gx_csv(write_gx_csv(ladder), cpu=FX3U) == ladder
    assert "64000 steps" in str(usage(ladder))
    assert [finding.severity for finding in check(ladder)].count("error") == 0


@pytest.mark.parametrize(
    ("text", "value"),
    [("E1.5", 1.5), ("e-2", -2.0), ("E1.5+3", 1500.0), ("E1-10", 1.000000013351432e-10), ("E0", 0.0)],
)
def test_real_constant_is_single_precision(text: str, value: float) -> None:
    constant = parse_operand(text, FX3U)
    assert constant == RealConstant(value)
    assert parse_operand(str(constant), FX3U) == constant


def test_operands_outside_the_ranges_of_an_fx3u() -> None:
    assert parse_operand("d100.0", FX3U) == WordBit(100, 0)
    for text, reason in {
        "E1+39": "does not fit",
        "E1-39": "does not fit",
        "T512": "T0 to T511",
        "D8512.0": "D0 to D8511",
        "R32768": "R32768 does not exist on an FX3U; it has R0 to R32767",
        "R0.1": "not an operand",
        "ER5": "extension file register",
    }.items():
        with pytest.raises(OperandError, match=reason) as caught:
            parse_operand(text, FX3U)
        assert "--cpu" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("LD M1535", 1),
        ("LD M1536", 2),
        ("LD M3584", 3),
        ("LD S1024", 2),
        ("LD M8256", 2),
        ("OUT M3584", 3),
        ("OUT M8256", 2),
        ("SET S4095", 2),
        ("OUT T511 K1", 3),
        ("DRVI K5 K100 Y0 Y4", 9),
        ("DDRVI K5 K100 Y0 Y4", 17),
        ("DEMOV E1.0 D0", 9),
        ("MOV R0 R1", 5),
        ("DADD R0 R2 R4", 13),
        ("RST R5", 3),
        ("OUT T0 R5", 3),
    ],
)
def test_steps_of_an_fx3u(line: str, count: int) -> None:
    """Step counts of the table in source [13], except those of the M3584 edges."""
    text = f"{line}\nOUT Y0\nEND" if line.startswith("LD") else f"LD X0\n{line}\nEND"
    ladder = read_il(text, cpu=FX3U)
    instruction = next(each for each in ladder.instructions if str(each) == line)
    assert steps(instruction) == count


def test_models_by_key() -> None:
    assert list(CPU_MODELS) == ["fx2n", "fx3u"]
    assert CPU_MODELS["fx2n"] is FX2N
    assert {name for name, form in FORMS.items() if form.kind.fx3} >= {"DEMOV", "DRVI", "DDRVA", "DRADP"}


def test_extension_registers_are_counted_for_an_fx3u_only() -> None:
    assert "2 of 32768 R" in str(usage(read_il("LD X0\nMOV R0 R9\nEND", cpu=FX3U)))
    assert " R" not in str(usage(read_il("LD X0\nMOV D0 D9\nEND")))
    with pytest.raises(LadderError, match="R0 is an extension register, which only an FX3U has; use D, or use --cpu"):
        read_il("LD X0\nMOV R0 D9\nEND")
    with pytest.raises(LadderError, match="2 devices starting at R32767 extend beyond R32767"):
        read_il("LD X0\nDMOV R32767 D9\nEND", cpu=FX3U)
