"""Provenance of a command's result, made of its options."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.common.defaults import DEFAULT_MACHINE, DEFAULT_PLANTER
from plant_sim.common.provenance.content import code_hash, content_hash, package_version
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import with_provenance

FILES: Final[Mapping[str, Path | None]] = {
    "file": None,
    "io_map": DEFAULT_IO_MAP,
    "ladder": None,
    "line": None,
    "machine": DEFAULT_MACHINE,
    "modules": None,
    "planter": DEFAULT_PLANTER,
    "profile": None,
    "recording": None,
    "scenario": None,
}
"""Options that name a file that is read, with the default file."""
OUTPUTS: Final = ("out", "record", "plot", "falls")
"""Options that name a file or a folder that is written."""
WITHOUT_EFFECT: Final = frozenset(
    {
        *("command", "stop", "json", "csv"),  # how the result is shown
        *("workers", "jobs", "engine", "scheduler", "timeout"),  # where the runs are computed
        *("host", "port", "hmi_port", "panel_port", "no_panel", "keep", "allow_remote"),  # what is served
        *("listen_host", "listen_port", "serial", "unit"),  # how a PLC or a panel is reached
        *("real_time_priority", "real_time_cpu", "wait_s"),  # the load of the computer
    }
)
"""Options that do not change the numbers of a result."""


def provenance_of(options: argparse.Namespace, *, seed: int | None = None) -> Provenance:
    """Return the provenance of a result; the run begins with this call.

    A file that does not exist is left out: the command reports it when it reads it.

    Args:
        options: Options of the command, with its name.
        seed: Seed, if it is not that of the options.
    """
    settings: dict[str, object] = {}
    parameters: dict[str, str] = {}
    given: dict[str, Path] = {}
    for name, value in vars(options).items():
        if name in FILES:
            default = FILES[name]
            path = default if value is None else _found(name, value)
            if path is None or not path.is_file():
                continue
            parameters[name] = content_hash(path.read_bytes())
            if isinstance(value, str) and str(path) != value:
                settings[name] = value  # the name of a file of the package
            elif path != default:
                given[name] = path
        elif name not in OUTPUTS and name not in WITHOUT_EFFECT and not _is_absent(value):
            settings[name] = value
    if seed is None:
        seed = getattr(options, "seed", None)
    return Provenance(options.command, package_version(), code_hash(), parameters, seed, settings, given)


def print_json(record: Mapping[str, Any], provenance: Provenance, **form: Any) -> None:
    """Print a record with its provenance as one JSON object."""
    print(json.dumps(with_provenance(record, provenance), **form))


def _found(name: str, value: str | Path) -> Path:
    """Return the path of a file that an option names, also if it is a file of the package."""
    if name == "line":
        from plant_sim.line.file import find_line  # noqa: PLC0415 - not needed by other commands

        return find_line(str(value))
    if name == "scenario":
        from plant_sim.scenario.file import find_scenario  # noqa: PLC0415

        return find_scenario(str(value))
    return Path(value)


def _is_absent(value: object) -> bool:
    return value is None or value is False or value == []
