"""Tables of texts: the values of all modules of the controller in which texts can stand."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from typing import Any

import controller


def declared_values() -> Iterator[tuple[str, Any]]:
    """Yield the names and values of the constants of every module of the controller, so that no table is forgotten."""
    for module in pkgutil.walk_packages(controller.__path__, "controller."):
        if not module.name.endswith("__main__"):
            for name, value in vars(importlib.import_module(module.name)).items():
                if not name.startswith("__"):
                    yield f"{module.name}.{name}", value
