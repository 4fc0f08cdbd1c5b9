"""Guides that are performed by tests: their code blocks, their edits of a source tree, and commands in it."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path


def blocks(language: str, text: str) -> list[str]:
    """Return the fenced blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def apply(block: str, root: Path) -> str:
    """Apply one diff block to a source tree; return the name of the changed file.

    Raises:
        AssertionError: The lines to be changed are missing from the file or occur more than once.
    """
    heading, _, places = block.partition("\n")
    name = heading.removeprefix("+++ ")
    path = root / name
    text = path.read_text(encoding="utf-8")
    for place in places.split("@@\n"):
        lines = place.splitlines(keepends=True)
        before = "".join(line[1:] for line in lines if line[0] in " -")
        after = "".join(line[1:] for line in lines if line[0] in " +")
        assert text.count(before) == 1, f"{name}: lines not found exactly once:\n{before}"
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
    return name


def run(root: Path, *arguments: str, timeout_s: float, code: int = 0) -> str:
    """Run Python in a source tree and return its output; on another exit code, fail the test with that output."""
    environment = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(root.with_name("machine-code"))}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
    assert done.returncode == code, f"{shlex.join(arguments)}:\n{done.stdout[-6_000:]}{done.stderr[-2_000:]}"
    return done.stdout
