"""Private folders of machine code that exist during a test only."""

from __future__ import annotations

import atexit
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from controller.common.files import trust


@contextmanager
def private_folders(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Make a private folder of machine code on its first use, and delete it at the end, as the end of the process."""
    folders = []
    monkeypatch.setenv(trust._PRIVATE, "")
    monkeypatch.setattr(atexit, "register", lambda _, folder, **__: folders.append(folder))
    trust._private_folder.cache_clear()
    try:
        yield
    finally:
        trust._private_folder.cache_clear()
        trust._report.cache_clear()
        for folder in folders:
            shutil.rmtree(folder)
