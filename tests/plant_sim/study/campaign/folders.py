"""Small campaigns, their command, and their stored table."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from plant_sim.cli.main import main
from tests.paths import ROOT

SMALL = """\
design: factorial
factors:
  crop.claw_pressure_mpa: {levels: [0.3, 0.5]}
  program.pause_at_feed: {levels: [200 ms, 300 ms]}
replicates: 2
seedlings: 12
faults:
  - []
  - [stuck_off:left.lift_up@26s..34s]
"""
"""Campaign of 16 runs."""
SMALL_RUNS = 16
FEW = "replicates: 3\nseedlings: 1\n"
FEW_RUNS = 3
LONG = ("--trials", "4")
LONG_RUNS = 32
"""Campaign that takes long enough for a process to be killed before its end."""


def written(folder: Path, text: str = SMALL) -> Path:
    """Write a campaign file and return its path."""
    path = folder / "campaign.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def campaign(file: Path, out: Path, *options: str, workers: int = 1) -> int:
    """Run the command in this process; return its exit code."""
    return main(["study", "campaign", str(file), "--out", str(out), "--workers", str(workers), *options])


def command(file: Path, out: Path, *options: str) -> list[str]:
    """Return the command line for a separate process."""
    return [sys.executable, "-m", "plant_sim", "study", "campaign", str(file), "--out", str(out), *options]


def environment() -> Mapping[str, str]:
    """Return the environment of a separate process that imports this checkout."""
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def shards(out: Path) -> list[Path]:
    """Return the result files."""
    return sorted((out / "runs").glob("*.parquet"))


def table(out: Path) -> list[dict[str, Any]]:
    """Return the stored runs in the order of their keys."""
    tables = [pq.read_table(path) for path in shards(out)]
    return pa.concat_tables(tables).sort_by("key").to_pylist() if tables else []


def keys(out: Path) -> list[str]:
    """Return the keys of the stored runs, in order."""
    return [row["key"] for row in table(out)]
