"""Commands that support the items of the papers, and the texts that their output must contain."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import pytest

from controller.cli.main import main as controller_main
from plant_sim.cli.main import main as plant_main
from plant_sim.common.paper_items import PaperItem, PaperName, paper_items

PAPERS: Final[tuple[PaperName, ...]] = ("pepper", "cabbage")
ITEMS: Final = [(paper, item) for paper in PAPERS for item in paper_items(paper)]
TESTS: Final = "scripts/test"
MAIN: Final = {"controller": controller_main, "plant_sim": plant_main}
SLOW: Final = {
    "plant_sim study cabbage-rsm --data reconciled",
    "plant_sim study cabbage-rsm --data reconciled --out var/cabbage",
    "plant_sim study planter-lodging",
    "plant_sim study planter-release",
    "plant_sim study planter-verdicts",
    "plant_sim study pepper-rsm",
    "plant_sim study pepper-single",
    "plant_sim study throughput",
}
"""Commands that are run only with ``--nightly``.

They take more than 10 s, except the first two, which take 2 s.
"""
QUICK: Final = {command for command in SLOW if "cabbage-rsm" in command}


def run(command: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command in a folder; return its output and the text of its files, with single spaces."""
    package, *words = shlex.split(command)
    (folder / "var").mkdir(parents=True)
    with contextlib.chdir(folder):
        assert MAIN[package](words) == 0, command
    texts = [capsys.readouterr().out]
    texts += [path.read_text(encoding="utf-8") for path in files(folder) if path.suffix in {".csv", ".md", ".svg"}]
    return " ".join(" ".join(texts).split())


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def check(
    command: str,
    items: Iterable[tuple[PaperName, PaperItem]],
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Run a command in a new folder; its output must contain the texts of the items, and its files must exist."""
    printed = run(command, folder, capsys)
    missing = [f"{item}: {text}" for item, text in _claims(command, items) if text not in printed]
    assert not missing, f"{command} does not print:\n" + "\n".join(missing)
    words = shlex.split(command)
    written = [words[words.index(option) + 1] for option in ("--plot", "--out") if option in words]
    assert bool(files(folder)) == bool(written)
    for name in written:
        assert (folder / name).exists()


def _claims(command: str, items: Iterable[tuple[PaperName, PaperItem]]) -> Iterator[tuple[str, str]]:
    """Yield the items that name a command and the texts that its output must contain."""
    for paper, item in items:
        yield from ((f"{paper}, {item.item}", text) for text in item.commands.get(command, []))
