"""Provenance of a result: the command, the code, the parameters, the seed and the settings that gave it."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from controller.common.document.parts import Table, listing
from plant_sim.common.provenance.content import content_hash

KEY: Final = "provenance"
"""Name under which a result carries its provenance, in every format."""
_ID_DIGITS: Final = 16


@dataclass(frozen=True)
class Provenance:
    """Provenance of a result, without date, host, duration and paths: equal runs have equal provenances.

    Attributes:
        command: Command of ``plant_sim``.
        version: Version of the package.
        code: Checksum of the code.
        parameters: Checksums of the files with parameters, by the option that names them.
        seed: Seed of all random numbers; None for a result without any.
        settings: Options of the command by name, except files and those without effect on the result.
        given: Files that the user gave, by option; they are copied beside the result.
        begin: Date of the run.
        begin_s: Instant from which the duration of the run is counted, s.
    """

    command: str
    version: str
    code: str
    parameters: Mapping[str, str]
    seed: int | None
    settings: Mapping[str, object]
    given: Mapping[str, Path] = field(default_factory=dict, compare=False)
    begin: datetime = field(default_factory=lambda: datetime.now(UTC), compare=False)
    begin_s: float = field(default_factory=time.perf_counter, compare=False)

    def record(self) -> dict[str, Any]:
        """Return the provenance as a JSON object."""
        return {
            "command": self.command,
            "version": self.version,
            "code": self.code,
            "parameters": dict(sorted(self.parameters.items())),
            "seed": self.seed,
            "settings": dict(sorted(self.settings.items())),
        }

    @cached_property
    def text(self) -> str:
        """The provenance as one line of JSON."""
        return json.dumps(self.record())

    @cached_property
    def identity(self) -> str:
        """Checksum of the provenance, which a table carries in its last column."""
        return content_hash(self.text.encode())[:_ID_DIGITS]

    def table(self) -> Table:
        """Return the provenance as a part of a document."""
        files = [(f"checksum of {name}", value) for name, value in sorted(self.parameters.items())]
        settings = " ".join(f"{name}={json.dumps(value)}" for name, value in sorted(self.settings.items()))
        rows = [
            ("command", self.command),
            ("version", self.version),
            ("checksum of the code", self.code),
            *files,
            ("seed", "none" if self.seed is None else self.seed),
            ("settings", settings or "none"),
            (KEY, self.identity),
        ]
        return listing((KEY, ""), rows)

    def without_paths(self, text: str) -> str:
        """Return a text in which the files that the user gave are named without their folders."""
        for path in self.given.values():
            text = text.replace(str(path), path.name)
        return text
