"""Scenario guide: the code in the guide, pasted into the file that the guide names, passes the guide's checks."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.machine_code import give_machine_code
from tests.paths import DOCS
from tests.real_time import COMMAND_S

ROOT = DOCS.parent
CHECKED = ("controller", "plant_sim", "tests", "pyproject.toml", "io_map.yaml")


def blocks(language: str) -> list[str]:
    """Return the code blocks of the guide in the given language."""
    guide = (DOCS / "scenario.md").read_text(encoding="utf-8")
    return re.findall(rf"(?ms)^```{language}\n(.*?)^```$", guide)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a copy of the project with the code of the guide pasted into the file that its command names."""
    for name in CHECKED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, tmp_path / name)
    give_machine_code(tmp_path / "plant_sim", tmp_path / "machine-code")
    (tmp_path / path_of_the_guide()).write_text("\n\n".join(blocks("python")), encoding="utf-8")
    return tmp_path


def path_of_the_guide() -> str:
    """Return the path that the guide's command names."""
    (command,) = blocks("sh")
    script, path = command.split()
    assert script == "scripts/test"
    assert path in (DOCS / "scenario.md").read_text(encoding="utf-8").partition("```python")[0]
    return path


@pytest.mark.nightly
@pytest.mark.parametrize(
    "arguments",
    [
        ("ruff", "check", "--no-cache"),
        ("ruff", "format", "--check", "--no-cache"),
        ("pytest", "-p", "no:cacheprovider"),
    ],
    ids=lambda arguments: arguments[0] if arguments[0] == "pytest" else " ".join(arguments[:2]),
)
def test_the_code_of_the_guide_passes_its_command(arguments: tuple[str, ...], checkout: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *arguments, path_of_the_guide()],
        check=False,
        cwd=checkout,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(checkout / "machine-code")},
        capture_output=True,
        text=True,
        timeout=COMMAND_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    if arguments[0] == "pytest":
        assert f"{len(blocks('python'))} passed" in done.stdout
