"""Every program of these tests runs as Python functions and as machine code."""

from __future__ import annotations

import pytest
from hypothesis import is_hypothesis_test

from controller.core import object_code
from controller.fx.engine import llvm_program
from controller.fx.stimulus import running
from tests.controller.fx.engine.fx_pair import PairedPlc
from tests.machine_code import folder_of_fixed_programs


@pytest.fixture(autouse=True)
def _both_executions(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare both executions after every scan.

    The machine code is divided into small parts, so that small programs have several. It would fill the user's cache:
    that of fixed programs is kept in the checkout, and that of drawn programs is compiled without a cache folder.
    """
    folder = None if is_hypothesis_test(request.function) else folder_of_fixed_programs()
    monkeypatch.setattr(object_code, "_folder", lambda: folder)
    monkeypatch.setattr(llvm_program, "FEWEST", 10)
    monkeypatch.setattr(llvm_program, "MOST", 40)
    for module in (request.module, running):
        if hasattr(module, "FxPlc"):
            monkeypatch.setattr(module, "FxPlc", PairedPlc)
