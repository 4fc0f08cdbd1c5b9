"""Wheel and source distribution: built, installed outside the source tree, run and uninstalled."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from controller.common.extras import EXTRAS
from tests.machine_code import give_machine_code
from tests.paths import ROOT
from tests.real_time import COMMAND_S

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DIST_INFO = f"seedling_transplanter-{PROJECT['version']}.dist-info"
PACKAGES = ("controller", "plant_sim")
SCRIPTS = ("transplanter-controller", "transplanter-plant")
DATA = {
    "controller/hmi/panel/static/foreign/noto-sans-sc-400.woff2",
    "controller/hmi/panel/static/foreign/noto-sans-sc.LICENSE.txt",
    "controller/hmi/panel/static/foreign/uPlot.LICENSE.txt",
    "controller/hmi/panel/static/foreign/uPlot.css",
    "controller/hmi/panel/static/foreign/uPlot.esm.js",
    "controller/hmi/panel/static/index.html",
    "controller/hmi/panel/static/main.js",
    "controller/hmi/panel/static/cab.css",
    "controller/hmi/panel/static/panel.css",
    "controller/hmi/panel/static/themes.css",
    "controller/hmi/web/static/dom.js",
    "controller/hmi/web/static/fonts.css",
    *(f"controller/hmi/panel/static/foreign/roboto-condensed{end}" for end in ("-400.woff2", ".LICENSE.txt")),
    "controller/hmi/ladder_page/static/index.html",
    "controller/hmi/ladder_page/static/main.js",
    "controller/iomap/io_map.yaml",
    "controller/py.typed",
    "plant_sim/machine.yaml",
    "plant_sim/py.typed",
    "plant_sim/scenario/library/stuck-reed-switch.yaml",
    "plant_sim/common/paper_data/cabbage-table-2.csv",
    "plant_sim/common/paper_data/pepper-table-4.csv",
}
"""Some of the non-Python files that the wheel must contain."""

Files = dict[str, bytes]


@dataclass(frozen=True)
class Distributions:
    """Built distributions.

    Attributes:
        wheel: Wheel built from the checkout.
        sdist: Source distribution.
        wheel_of_sdist: Wheel built from the source distribution.
    """

    wheel: Path
    sdist: Path
    wheel_of_sdist: Path


@dataclass(frozen=True)
class Environment:
    """Virtual environment outside the source tree."""

    folder: Path

    @property
    def site_packages(self) -> Path:
        """Folder of the installed packages."""
        paths = {"base": str(self.folder), "platbase": str(self.folder)}
        return Path(sysconfig.get_path("purelib", "venv", paths))

    @property
    def scripts(self) -> Path:
        """Folder of the console commands."""
        return Path(sysconfig.get_path("scripts", "venv", {"base": str(self.folder)}))

    def pip(self, *arguments: str, timeout_s: float = 60) -> None:
        """Run the pip of the test environment on this environment."""
        python = str(self.scripts / "python")
        run([sys.executable, "-m", "pip", "--python", python, "-q", *arguments], self.folder, timeout_s=timeout_s)

    def run(self, command: str, *arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        """Run a command of the environment in an empty working folder."""
        work = self.folder / "work"
        work.mkdir(exist_ok=True)
        return run([str(self.scripts / command), *arguments], work, code=code, cache=self.folder / "cache")


def run(
    command: list[str], folder: Path, *, code: int = 0, timeout_s: float = COMMAND_S, cache: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command without the environment variables that refer to the checkout."""
    environment = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "NUMBA_CACHE_DIR"}}
    if cache is not None:
        environment["XDG_CACHE_HOME"] = str(cache)
    done = subprocess.run(
        command, cwd=folder, env=environment, check=False, capture_output=True, text=True, timeout=timeout_s
    )
    assert done.returncode == code, f"{command}: {done.stdout}{done.stderr}"
    return done


def built(folder: Path, *options: str) -> Path:
    """Build distributions of the checkout with the front end `build`; return their folder."""
    command = [sys.executable, "-m", "build", "--no-isolation", *options, "--outdir", str(folder), str(ROOT)]
    run(command, ROOT.parent)
    return folder


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel built from the checkout."""
    (wheel,) = built(tmp_path_factory.mktemp("direct"), "--wheel").glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def distributions(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Distributions:
    both = built(tmp_path_factory.mktemp("both"))
    (sdist,), (wheel_of_sdist,) = both.glob("*.tar.gz"), both.glob("*.whl")
    return Distributions(wheel, sdist, wheel_of_sdist)


@pytest.fixture
def environment(wheel: Path, tmp_path: Path) -> Iterator[Environment]:
    """Yield a fresh environment that contains only the wheel."""
    folder = tmp_path / "environment"
    run([sys.executable, "-m", "venv", "--without-pip", str(folder)], tmp_path)
    environment = Environment(folder)
    environment.pip("install", "--no-deps", "--no-index", str(wheel))
    yield environment
    shutil.rmtree(folder)


def borrow_dependencies(environment: Environment) -> Path:
    """Make the packages of the test environment importable in another environment; return the .pth file."""
    link = environment.site_packages / "dependencies.pth"
    link.write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return link


def contents(wheel: Path) -> Files:
    """Return the files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def tracked(*folders: str) -> set[str]:
    """Return the files of the checkout below the given folders, except files written by tools."""
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file())
    written = {"__pycache__", "node_modules"}
    return {str(path.relative_to(ROOT)) for path in paths if not written & {*path.parts}}


@pytest.mark.nightly
def test_the_wheel_contains_both_packages_and_nothing_else(distributions: Distributions) -> None:
    files = contents(distributions.wheel)
    packaged = {name for name in files if not name.startswith(f"{DIST_INFO}/")}
    assert packaged == tracked(*PACKAGES) | {"controller/iomap/io_map.yaml", "controller/hmi/panel/machine.svg"}
    assert packaged >= DATA
    assert files["controller/iomap/io_map.yaml"] == (ROOT / "io_map.yaml").read_bytes()
    assert f"{DIST_INFO}/licenses/LICENSE" in files


@pytest.mark.nightly
def test_the_source_distribution_builds_the_same_wheel(distributions: Distributions) -> None:
    assert contents(distributions.wheel_of_sdist) == contents(distributions.wheel)
    with tarfile.open(distributions.sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "io_map.yaml", "CITATION.cff", "CHANGELOG.md", "LICENSE", "README.md"} <= names
    assert not {name for name in names if name.startswith(".") and name != ".gitignore"}
    assert tracked(*PACKAGES, "tests", "scripts", "docs") <= names


def test_the_metadata_is_complete(wheel: Path) -> None:
    text = contents(wheel)[f"{DIST_INFO}/METADATA"].decode()
    header = text.partition("\n\n")[0]
    for name in ("Author", "Keywords", "License-Expression", "License-File", "Classifier", "Requires-Python"):
        assert re.search(f"^{name}: .", header, re.MULTILINE), name
    assert "\nLicense-Expression: MIT AND OFL-1.1\n" in header, "the wheel contains a font"
    extras = set(re.findall(r"^Provides-Extra: (.*)$", header, re.MULTILINE))
    assert extras == set(PROJECT["optional-dependencies"])
    assert {extra for each in EXTRAS.values() for extra in each} <= extras


def test_the_citation_has_the_version_and_both_papers() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    run([str(Path(sys.executable).parent / "cffconvert"), "--validate", "-i", str(ROOT / "CITATION.cff")], ROOT)
    assert f"\nversion: {PROJECT['version']}\n" in citation
    assert citation.count("type: article") == 2


@pytest.mark.nightly
def test_the_installed_wheel_runs_outside_the_tree_and_is_uninstalled_completely(environment: Environment) -> None:
    site = environment.site_packages
    top = {path.name for path in site.iterdir()}
    assert top == {*PACKAGES, DIST_INFO}
    link = borrow_dependencies(environment)
    give_machine_code(site / "plant_sim", environment.folder / "cache" / "seedling-transplanter")
    for script in SCRIPTS:
        assert environment.run(script, "--version").stdout == f"seedling-transplanter {PROJECT['version']}\n"
    program = "import json, sys, controller.iomap.loader as l, plant_sim.machine.parameters as p\n"
    program += "print(json.dumps([l.__file__, str(l.DEFAULT_IO_MAP), p.__file__, str(p.DEFAULT_MACHINE)]))"
    paths = json.loads(environment.run("python", "-c", program).stdout)
    assert all(Path(path).is_relative_to(site.resolve()) or Path(path).is_relative_to(site) for path in paths)
    export = environment.run(SCRIPTS[0], "ladder", "export", "--target", "fx2n", "--out", "fx2n")
    assert export.stdout.endswith("\nfits\n")
    assert (environment.folder / "work/fx2n/transplanter.il").stat().st_size > 10_000
    environment.run(SCRIPTS[1], "scenario", "stuck-reed-switch")
    link.unlink()
    environment.pip("uninstall", "--yes", "seedling-transplanter")
    assert [str(path.relative_to(site)) for path in site.rglob("*")] == []
    assert not [script for script in SCRIPTS if (environment.scripts / script).exists()]


# --- installation with dependencies ----------------------------------------------------------------

EXTRA_COMMANDS: Mapping[str, tuple[str, ...]] = {
    "plant": (SCRIPTS[1], "trial", "--trays", "1"),
    "studies": (SCRIPTS[1], "study", "cabbage-rsm", "--data", "printed"),
    "verify": (SCRIPTS[0], "prove", "--short", "--goal", "left: down away from feed"),
    "panel": (SCRIPTS[0], "panel", "--help"),
    "parquet": ("python", "-c", "import pyarrow.parquet"),
    "serial": ("python", "-c", "import serial"),
    "completion": (SCRIPTS[0], "--print-completion", "bash"),
    "cluster": ("python", "-c", "import distributed, plant_sim.study.campaign.campaign"),
}
"""Command that needs an extra, by extra."""
MISSING_COMMANDS: Mapping[str, tuple[str, ...]] = {
    "numpy": (SCRIPTS[1], "trial"),
    "z3": (SCRIPTS[0], "prove"),
    "starlette": (SCRIPTS[0], "panel"),
}
"""Command that needs a module of an extra, by module."""


def fresh(folder: Path, requirement: str) -> Environment:
    """Return a new environment in which a requirement and its dependencies are installed."""
    run([sys.executable, "-m", "venv", "--without-pip", str(folder)], folder.parent)
    environment = Environment(folder)
    environment.pip("install", "--disable-pip-version-check", requirement, timeout_s=500)
    return environment


@pytest.mark.nightly
def test_the_controller_alone_needs_no_extra(distributions: Distributions, tmp_path: Path) -> None:
    environment = fresh(tmp_path / "alone", str(distributions.wheel))
    installed = {path.name for path in environment.site_packages.iterdir()}
    assert not installed & {*EXTRAS, "llvmlite", "pandas"}
    assert "--retain" in environment.run(SCRIPTS[0], "run", "--help").stdout
    environment.run(SCRIPTS[0], "ladder", "export", "--target", "fx2n", "--out", "fx2n")
    missing_history = environment.run(SCRIPTS[0], "history", "none.sqlite", code=2)
    assert missing_history.stderr.startswith("none.sqlite: no such file")
    for module, (script, *arguments) in MISSING_COMMANDS.items():
        hint = f"{module} is not installed; run: pip install '{distributions.wheel}[{EXTRAS[module][0]}]'"
        assert environment.run(script, *arguments, code=2).stderr == f"{arguments[0]}: {hint}\n"


@pytest.mark.nightly
@pytest.mark.parametrize("extra", EXTRA_COMMANDS)
def test_an_extra_installs_what_its_command_needs(extra: str, distributions: Distributions, tmp_path: Path) -> None:
    environment = fresh(tmp_path / extra, f"{distributions.wheel}[{extra}]")
    environment.run(*EXTRA_COMMANDS[extra])
    if extra in {"plant", "studies"}:
        assert not (environment.site_packages / "pyarrow").exists()
