"""Reference tables made from the plant's declarations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import yaml

from plant_sim.faults import fault_table
from plant_sim.links.box import BOX_COILS
from plant_sim.links.tag_file import tag_csv
from plant_sim.links.telemetry import telemetry_table
from plant_sim.parameters import DEFAULT_MACHINE

GENERATED = "Made by `python -m plant_sim docs`; do not edit."


def _table(rows: Sequence[Sequence[str]]) -> str:
    heading, *body = rows
    lines = ["| " + " | ".join(heading) + " |", "|" + "---|" * len(heading)]
    lines += ["| " + " | ".join(row) + " |" for row in body]
    return "\n".join(lines) + "\n"


def plant_modbus_table() -> str:
    """Return what the plant serves beside the points of the I/O map."""
    box = [("coil", "button", "meaning"), *((str(c.offset), c.button, c.meaning) for c in BOX_COILS)]
    return (
        f"# The plant over Modbus TCP\n\n{GENERATED}\n\nX points are discrete inputs and Y points coils, at the "
        f"offsets of `io_map.yaml` (see io.md).\n\n## Operator box\n\n{_table(box)}\n## Telemetry (input registers)\n\n"
        f"{_table(telemetry_table())}"
    )


def parameter_table() -> str:
    """Return every parameter of the machine with unit and source."""
    sections = yaml.safe_load(DEFAULT_MACHINE.read_text(encoding="utf-8"))
    parts = [f"# Parameters of the machine\n\n{GENERATED}\n"]
    for section, entries in sections.items():
        rows = [("parameter", "value", "unit", "source", "note")]
        rows += [
            (name, str(entry["value"]), str(entry.get("unit", "")), str(entry["source"]), str(entry.get("note", "")))
            for name, entry in entries.items()
        ]
        parts.append(f"## {section}\n\n{_table(rows)}")
    return "\n".join(parts)


def fault_reference() -> str:
    """Return every kind of fault."""
    return f"# Faults\n\n{GENERATED}\n\n{_table(fault_table())}"


REFERENCE = {
    "plant-modbus.md": plant_modbus_table,
    "plant-tags.csv": tag_csv,
    "parameters.md": parameter_table,
    "faults.md": fault_reference,
}


def write_reference(folder: Path) -> list[Path]:
    """Write every table; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, make in REFERENCE.items():
        path = folder / name
        path.write_text(make(), encoding="utf-8")
        paths.append(path)
    return paths
