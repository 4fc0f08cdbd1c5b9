"""Every program of these tests runs as Python functions and as machine code."""

from __future__ import annotations

import pytest

from controller.core import object_code
from controller.fx.engine import running
from tests.controller.fx.engine.fx_pair import PairedPlc


@pytest.fixture(autouse=True)
def _both_executions(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare both executions after every scan; compile without a cache folder, which would fill the user's cache."""
    monkeypatch.setattr(object_code, "_folder", lambda: None)
    for module in (request.module, running):
        if hasattr(module, "FxPlc"):
            monkeypatch.setattr(module, "FxPlc", PairedPlc)
