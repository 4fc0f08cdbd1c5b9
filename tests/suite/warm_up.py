"""Cold caches of the tests, filled once on a processor that the type check leaves idle.

The workers of a run start together. With cold caches, each of them would compile every file of the tests with
rewritten assertions, and search every module for the constants that Hypothesis draws.
"""

from __future__ import annotations

from typing import Final

import pytest

from tests.suite.dependencies import own_dependencies

COLLECTION: Final = ("-c", "pyproject.toml", "--collect-only", "-q")


def warm_up() -> None:
    """Collect all tests, which also loads or compiles the machine code; then read the facts of all source files."""
    pytest.main([*COLLECTION])
    own_dependencies()


if __name__ == "__main__":
    warm_up()
