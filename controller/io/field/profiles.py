"""Profiles of I/O modules, read from ``profiles.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.common.yaml_lines import read_yaml, unfold
from controller.common.yaml_model import validated
from controller.io.field.schema import ProfileEntry

PROFILES_FILE: Final = Path(__file__).with_name("profiles.yaml")
_DEPTH: Final = 6


@cache
def profiles(path: Path = PROFILES_FILE) -> Mapping[str, ProfileEntry]:
    """Return the profiles by name.

    Raises:
        InputError: The file is invalid.
    """
    found: dict[str, ProfileEntry] = {}
    for key, node in read_yaml(path, InputError).value:
        located = unfold(node, _DEPTH)
        entry = validated(ProfileEntry, located)
        if entry is None or located.faults:
            raise InputError(f"{path}:{min(located.faults, key=lambda fault: fault.line)}")
        found[str(key.value)] = entry
    return found
