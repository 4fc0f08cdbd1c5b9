"""Optional dependencies: the installation extras that provide each third-party module."""

from __future__ import annotations

import importlib.metadata
import json
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

DISTRIBUTION: Final = "seedling-transplanter"
"""Name of the installed package."""

_PLANT: Final = ("plant", "studies", "cluster")
EXTRAS: Final[Mapping[str, tuple[str, ...]]] = {
    "distributed": ("cluster",),
    "joblib": ("studies", "cluster"),
    "llvmlite": (*_PLANT, "verify"),
    "matplotlib": _PLANT,
    "numba": _PLANT,
    "numpy": _PLANT,
    "pandas": ("studies", "cluster"),
    "prometheus_client": ("panel",),
    "pyDOE3": ("studies", "cluster"),
    "pyarrow": ("parquet", "cluster"),
    "pymunk": _PLANT,
    "rich": _PLANT,
    "scipy": _PLANT,
    "serial": ("serial",),
    "shtab": ("completion",),
    "starlette": ("panel",),
    "statsmodels": ("studies", "cluster"),
    "uvicorn": ("panel",),
    "websockets": ("panel",),
    "z3": ("verify",),
}
"""Installation extras that provide each module, by module name; the one with the fewest dependencies first."""
SETUP_PLANT: Final = frozenset({"plant", "studies", "panel", "parquet", "completion"})
"""Extras that ``scripts/setup plant`` installs; ``scripts/setup dev`` installs all."""


def install_hint(error: ModuleNotFoundError, preferred: str = "") -> str | None:
    """Return a one-line message with the install command for a missing module; None if no extra provides it.

    Args:
        error: Error of the import.
        preferred: Extra of the command, which is named if it provides the module.
    """
    module = (error.name or "").partition(".")[0]
    extras = EXTRAS.get(module)
    if extras is None:
        return None
    return f"{module} is not installed; run: {install_command(preferred if preferred in extras else extras[0])}"


def install_command(extra: str) -> str:
    """Return the command that adds an extra to the installed package, from where it was installed.

    The package is in no index, so that its name alone installs nothing. Source: PEP 610, direct_url.json.
    """
    origin = _origin()
    address = urlsplit(origin.get("url", ""))
    if address.scheme != "file":
        source = f"{DISTRIBUTION}[{extra}] @ {origin['url']}" if origin else f"WHEEL[{extra}]"
        note = (
            ""
            if origin
            else f", with the path of the wheel of {DISTRIBUTION} {importlib.metadata.version(DISTRIBUTION)}"
        )
        return f"pip install {shlex.quote(source)}{note}"
    path = Path(unquote(address.path))
    if not origin.get("dir_info", {}).get("editable"):
        return f"pip install {shlex.quote(f'{path}[{extra}]')}"
    if Path(sys.prefix) == path / ".venv":
        return f"{shlex.quote(str(path / 'scripts' / 'setup'))} {'plant' if extra in SETUP_PLANT else 'dev'}"
    return f"pip install -e {shlex.quote(f'{path}[{extra}]')}"


def _origin() -> dict[str, Any]:
    """Return from where the package was installed; empty if this is not recorded, as by an index."""
    text = importlib.metadata.distribution(DISTRIBUTION).read_text("direct_url.json")
    return {} if text is None else dict(json.loads(text))
