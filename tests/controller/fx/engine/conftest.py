"""Every program of these tests runs as Python functions and as machine code."""

from __future__ import annotations

import pytest

from controller.core import object_code
from controller.fx.engine import llvm_program, running
from tests.controller.fx.engine.fx_pair import PairedPlc


@pytest.fixture(autouse=True)
def _both_executions(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare both executions after every scan.

    The machine code is divided into small parts, so that small programs have several. It is compiled without a cache
    folder, because it would fill the user's cache.
    """
    monkeypatch.setattr(object_code, "_folder", lambda: None)
    monkeypatch.setattr(llvm_program, "FEWEST", 10)
    monkeypatch.setattr(llvm_program, "MOST", 40)
    for module in (request.module, running):
        if hasattr(module, "FxPlc"):
            monkeypatch.setattr(module, "FxPlc", PairedPlc)
