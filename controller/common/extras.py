"""Optional dependencies: the installation extra that provides each third-party module."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

DISTRIBUTION: Final = "seedling-transplanter"
"""Name of the installed package."""

EXTRAS: Final[Mapping[str, str]] = {
    "distributed": "cluster",
    "joblib": "studies",
    "llvmlite": "plant",
    "matplotlib": "plant",
    "numba": "plant",
    "numpy": "plant",
    "prometheus_client": "panel",
    "pyarrow": "parquet",
    "pymunk": "plant",
    "rich": "plant",
    "scipy": "plant",
    "serial": "serial",
    "starlette": "panel",
    "statsmodels": "studies",
    "uvicorn": "panel",
    "websockets": "panel",
    "z3": "verify",
}
"""Installation extra that provides each module, by module name."""


def install_hint(error: ModuleNotFoundError) -> str | None:
    """Return a one-line message with the install command for a missing module; None if no extra provides it.

    >>> install_hint(ModuleNotFoundError("No module named 'pyarrow.parquet'", name="pyarrow.parquet"))
    "pyarrow is not installed; run: pip install 'seedling-transplanter[parquet]'"
    """
    module = (error.name or "").partition(".")[0]
    extra = EXTRAS.get(module)
    return None if extra is None else f"{module} is not installed; run: pip install '{DISTRIBUTION}[{extra}]'"
