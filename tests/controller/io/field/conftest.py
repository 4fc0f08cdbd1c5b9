"""Fixtures of the tests of field files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import pytest


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Yield a stack for modules and links, which ends them after the test."""
    with ExitStack() as stack:
        yield stack
