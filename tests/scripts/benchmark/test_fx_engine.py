"""Benchmark of the FX2N engine: the compared programs have the same results, and a changed rung compiles little."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from controller.core import object_code
from controller.fx.engine.machine_functions import FxMachineCode, MachineFunctions
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.translate import translate
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from scripts.benchmark import fx_engine
from scripts.benchmark.c_program import c_text, compiled_c
from scripts.benchmark.catalogue import PARTS
from scripts.benchmark.fx_engine import seal_ins, shuffled_seal_ins, with_changed_rung
from tests.controller.export.fx_equality import EXPORTED
from tests.sampling import first_of

MOST_RECOMPILED = 4
"""The changed part, the routine, and at most two parts whose division has changed."""


@pytest.mark.parametrize("rungs", [seal_ins, shuffled_seal_ins])
def test_the_c_program_has_the_same_relays_as_the_engine(rungs: Callable[[], Ladder]) -> None:
    ladder = rungs()
    program = compiled_c(ladder)
    if program is None:
        pytest.skip("gcc is not installed")
    plc = FxPlc(ladder, input_filter_ms=0, execution=MachineFunctions)
    for number in range(4):
        image = [(n * 7 + number) % 3 == 0 for n in range(256)]
        plc.scan(10 * number, image)
        program.bits("X")[:] = bytes(image)
        program.scan(0, 0)
        assert [bool(level) for level in program.bits("M")[:200]] == plc.memory.M[:200]
    assert True in plc.memory.M[:200]
    assert False in plc.memory.M[:200]


def test_contacts_and_coils_in_c() -> None:
    text = c_text(read_il("LDI X10\nAND M3\nORI Y1\nOUT Y2\nEND\n"))
    assert "    p = !X[8];\n    p &= M[3];\n    p |= !Y[1];\n    Y[2] = p;\n" in text


@pytest.mark.parametrize("has_gcc", first_of([True, False]))
def test_without_gcc_there_are_no_figures_of_c(has_gcc: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not has_gcc:
        monkeypatch.setattr(shutil, "which", lambda _: None)
    has_c = compiled_c(seal_ins()) is not None
    assert has_gcc or not has_c
    monkeypatch.setattr(fx_engine, "ROUNDS", 1)
    (part,) = (part for part in PARTS if part.name == "instructions")
    figures = part.measure(1)
    assert set(figures) == {key for key, figure in part.figures.items() if has_c or not figure.absent}
    assert figures["python_ratio"] == pytest.approx(figures["interpreted"] / figures["python"])


@pytest.mark.nightly
def test_a_changed_rung_recompiles_its_part_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An additional instruction moves all later ones; the parts after it are nevertheless unchanged."""
    monkeypatch.setattr(object_code, "_folder", lambda: tmp_path)
    FxMachineCode(translate(EXPORTED))
    before = set(tmp_path.iterdir())
    assert len(before) > 30
    FxMachineCode(translate(with_changed_rung(EXPORTED)))
    assert 2 <= len(set(tmp_path.iterdir()) - before) <= MOST_RECOMPILED
