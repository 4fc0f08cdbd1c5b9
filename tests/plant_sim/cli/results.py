"""A small result of every command with ``--out``, and the provenance that a file carries."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import pyarrow.parquet as pq
from PIL import Image

from controller.common.command_line import Parser
from plant_sim.cli.main import COMMAND_LINE

STUDY: Final = """\
name: small
title: Small
design: factorial
factors:
  crop.claw_pressure_mpa: {levels: [0.3, 0.5]}
seedlings: 1
replicates: 1
responses: [P]
model: none
"""
CAMPAIGN: Final = """\
design: factorial
factors:
  crop.claw_pressure_mpa: {levels: [0.3, 0.5]}
seedlings: 1
"""
TRIALS: Final = "foam (mm),S (%)\n8,90\n8,91\n16,93\n16,95\n"
RESULTS: Final = {
    "trial": "trial --seedlings 1 --max-s 3 --seed 4 --record OUT/trial.parquet",
    "line": "line IN/LINE.yaml --metres 2 --seed 3 --format pdf,png,svg --dpi 80",
    "study own": "study own IN/STUDY.yaml --workers 1 --machine IN/MACHINE.yaml",
    "faults": "faults --fault broken_wire:start --moments 1 --jobs 1",
    "study campaign": "study campaign IN/CAMPAIGN.yaml --workers 2 --shard 1",
    "run": "run --fast --max-s 3 --record OUT/run.parquet",
    "plot": "plot IN/RECORDING.parquet --from 1s --to 2s --tags y.left.* left.slide.position_m",
    "trial ladder": "trial --ladder IN/LADDER.il --trays 1 --max-s 3",
    "stories": "stories --random 1",
    "scenario": "scenario IN/SCENARIO.yaml --record OUT/scenario.parquet",
    "hil": "hil program --no-reference --cases stop --only no-such-case",
    "study cabbage-rsm": "study cabbage-rsm --data printed",
    "study line-slip": "study line-slip",
    "study analyse": "study analyse IN/TRIALS.csv --factors foam --best low",
    "study plan": "study plan --difference 93,95 --design L9 --factors foam=8..16,age=45..55 --trials 2",
    "study pepper-rsm": "study pepper-rsm --trials 1 --seedlings 12",
    "study pepper-single": "study pepper-single --trials 1 --seedlings 12",
    "study calibration": "study calibration",
    "study planter-lodging": "study planter-lodging --trials 10 --seedlings 12",
    "study planter-release": "study planter-release --trials 1",
    "study planter-verdicts": "study planter-verdicts --trials 1",
    "study throughput": "study throughput --seedlings 12 --frequencies 30,60",
}
"""Commands that write a small result, by kind: those that run by default first, then those of a night and of a week."""
BY_DEFAULT: Final = 2
"""Kinds that run by default: a recording, and tables and pictures with a copied file."""
NIGHTLY: Final = 15
"""Further kinds that run every night; the others take a minute each."""
WITHOUT: Final = {"docs": "documentation", "reproduce": "writes the result of another command"}
"""Commands with ``--out`` whose files carry no provenance of their own."""


def parsers() -> dict[str, list[Parser]]:
    """Return the parsers of every command, those of its subcommands included."""
    return {name: [own, *own.subcommands.values()] for name, own in COMMAND_LINE.parser().subcommands.items()}


def carried(path: Path, identity: str) -> Any:
    """Return the provenance that a file carries, or the identity if the file carries only that."""
    read: dict[str, Callable[[], Any]] = {
        ".csv": lambda: {row.get("provenance") for row in csv.DictReader(path.read_text("utf-8").splitlines())},
        ".gif": lambda: json.loads(_info(path)["comment"]),
        ".html": lambda: json.loads(unescape(re.findall('name="provenance" content="([^"]*)"', _text(path))[0])),
        ".json": lambda: json.loads(_text(path))["provenance"],
        ".md": lambda: identity if f"| provenance | {identity} |" in _text(path) else None,
        ".parquet": lambda: _in_schema(path),
        ".pdf": lambda: json.loads(_subject(path)),
        ".png": lambda: json.loads(_info(path)["provenance"]),
        ".svg": lambda: json.loads(unescape(re.findall("<dc:description>(.*?)</dc:description>", _text(path))[0])),
        ".xml": lambda: next(
            json.loads(each.get("value", ""))
            for each in ElementTree.parse(path).iterfind("testsuite/properties/property")  # noqa: S314 - our own text
            if each.get("name") == "provenance"
        ),
    }
    found = read[path.suffix]()
    return identity if path.suffix == ".csv" and found in ({identity}, set()) else found


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _subject(path: Path) -> str:
    """Return the subject of a PDF, a literal string in which brackets and backslashes are escaped."""
    found = re.search(rb"/Subject \((.*?)(?<!\\)\)", path.read_bytes(), re.DOTALL)
    assert found is not None
    return re.sub(rb"\\([()\\])", rb"\1", found[1]).decode()


def _info(path: Path) -> dict[Any, Any]:
    with Image.open(path) as picture:
        return picture.info


def _in_schema(path: Path) -> Any:
    metadata = pq.read_schema(path).metadata
    if b"provenance" in metadata:
        return json.loads(metadata[b"provenance"])
    return json.loads(metadata[b"seedling_transplanter"])["provenance"]
