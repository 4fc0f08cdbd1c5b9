"""The install command names the place from which the package was installed, and the extra that is missing."""

from __future__ import annotations

import importlib.metadata
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from controller.common.extras import install_hint

EDITABLE = {"url": "file:///src/a%20folder", "dir_info": {"editable": True}}
WHEEL = {"url": "file:///downloads/seedling_transplanter-0.1.0-py3-none-any.whl", "archive_info": {}}
COPY = {"url": "file:///src/copy", "dir_info": {}}
REMOTE = {"url": "https://example.org/w.whl", "archive_info": {}}
INDEX: dict[str, Any] = {}
COMMANDS = {
    "wheel": (WHEEL, "pip install '/downloads/seedling_transplanter-0.1.0-py3-none-any.whl[parquet]'"),
    "copy of a folder": (COPY, "pip install '/src/copy[parquet]'"),
    "checkout": (EDITABLE, "pip install -e '/src/a folder[parquet]'"),
    "address": (REMOTE, "pip install 'seedling-transplanter[parquet] @ https://example.org/w.whl'"),
    "unknown": (INDEX, "pip install 'WHEEL[parquet]', with the path of the wheel of seedling-transplanter "),
}


def installed_from(origin: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the package be one that was installed from an origin."""

    class Installed(importlib.metadata.Distribution):
        def read_text(self, filename: str) -> str | None:
            if filename == "METADATA":
                return "Name: seedling-transplanter\nVersion: 0.1.0\n"
            return json.dumps(origin) if origin and filename == "direct_url.json" else None

        def locate_file(self, path: Any) -> Any:
            raise NotImplementedError

    monkeypatch.setattr(importlib.metadata, "distribution", lambda _: Installed())


def hint(module: str, preferred: str = "") -> str | None:
    return install_hint(ModuleNotFoundError(f"No module named {module!r}", name=module), preferred)


@pytest.mark.parametrize("case", COMMANDS)
def test_the_command_installs_from_the_origin_of_the_package(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    origin, command = COMMANDS[case]
    installed_from(origin, monkeypatch)
    assert (hint("pyarrow.parquet") or "").startswith(f"pyarrow is not installed; run: {command}")


@pytest.mark.parametrize(("module", "set_"), [("pyarrow", "plant"), ("uvicorn", "plant"), ("z3", "dev")])
def test_the_environment_of_a_checkout_is_completed_by_its_script(
    module: str, set_: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed_from({"url": "file:///src/here", "dir_info": {"editable": True}}, monkeypatch)
    monkeypatch.setattr(sys, "prefix", str(Path("/src/here/.venv")))
    assert hint(module) == f"{module} is not installed; run: /src/here/scripts/setup {set_}"


@pytest.mark.parametrize(
    ("module", "preferred", "extra"),
    [
        ("numpy", "", "plant"),
        ("numpy", "studies", "studies"),
        ("llvmlite", "verify", "verify"),
        ("pyarrow", "studies", "parquet"),
    ],
)
def test_the_extra_of_the_command_is_named_if_it_provides_the_module(
    module: str, preferred: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed_from(COPY, monkeypatch)
    assert hint(module, preferred) == f"{module} is not installed; run: pip install '/src/copy[{extra}]'"


def test_a_module_of_no_extra_has_no_hint() -> None:
    assert hint("colander") is None
