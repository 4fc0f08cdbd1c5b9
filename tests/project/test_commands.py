"""Commands of both packages: version, help, lazy imports, missing optional dependencies, portability."""

from __future__ import annotations

import ast
import importlib.metadata
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.common.command_line import CommandLine
from controller.common.extras import EXTRAS, install_command
from plant_sim.cli.main import COMMAND_LINE as PLANT
from tests.paths import ROOT
from tests.project.test_style import tree
from tests.real_time import COMMAND_S
from tests.sampling import first_of

COMMAND_LINES = (CONTROLLER, PLANT)
BASE = {"filelock", "pydantic", "pymodbus", "transitions", "yaml"}
"""Modules of the dependencies that are always installed."""


def python(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=COMMAND_S)


FORKS = """
import contextlib, io, json, os, sys

def forked(work, cases):
    "Print the JSON record that a function returns for each case, each in a fork of this process."
    for case in cases:
        if child := os.fork():
            assert os.waitpid(child, 0)[1] == 0, case
            continue
        print(json.dumps([case, work(case)]), flush=True)
        os._exit(0)
"""
"""Start of a program that examines several cases, each in a fork of an interpreter that has loaded common modules."""
WITHOUT_EXTRAS = f"""
import contextlib, io, json, sys

class Absent:
    "Finder that finds none of the modules of the extras."

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {sorted(EXTRAS)}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""
"""Start of a program in which no module of an extra is installed."""
COMMON = {"controller": "controller.program.machine", "plant_sim": "plant_sim.twin.trial"}
"""Module of each package that many of its commands import."""


@pytest.mark.parametrize("line", first_of(COMMAND_LINES), ids=lambda line: line.package)
def test_the_help_of_every_command_needs_no_extra(line: CommandLine) -> None:
    """No module of the extras can be imported, as after an installation without extras."""
    program = f"""{WITHOUT_EXTRAS}
from {line.package}.cli.main import COMMAND_LINE

for name in COMMAND_LINE.commands:
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
        print(COMMAND_LINE.run([name, "--help"]))
    print(json.dumps([name, shown.getvalue().partition("[")[0]]))
"""
    done = python(program)
    assert (done.returncode, done.stderr) == (0, "")
    usage = dict(map(json.loads, done.stdout.splitlines()))
    assert usage == {name: f"usage: python -m {line.package} {name} " for name in line.commands}


@pytest.mark.parametrize("line", COMMAND_LINES, ids=lambda line: line.package)
def test_version_and_help(line: CommandLine, capsys: pytest.CaptureFixture[str]) -> None:
    for option, expected in (
        ("--version", f"seedling-transplanter {importlib.metadata.version('seedling-transplanter')}\n"),
        ("--help", "\nWithout a command:\n"),
    ):
        with pytest.raises(SystemExit) as ended:
            line.run([option])
        assert ended.value.code == 0
        assert expected in capsys.readouterr().out


def test_the_program_name_is_that_of_the_console_command(monkeypatch: pytest.MonkeyPatch) -> None:
    for argument, name in (("/usr/bin/transplanter-plant", "transplanter-plant"), ("x.py", "python -m plant_sim")):
        monkeypatch.setattr(sys, "argv", [argument])
        assert PLANT.parser(()).prog == name


NEEDING_AN_EXTRA = {
    "controller": [
        ("prove", "z3"),
        ("panel", "uvicorn"),
    ],
    "plant_sim": [
        ("plot run.parquet", "matplotlib"),
        ("planter --plot motion.png", "matplotlib"),
        ("air", "pyarrow"),
        ("trial --record run.parquet", "pyarrow"),
        ("serve --record run.parquet --port 0", "pyarrow"),
        ("study throughput", "joblib"),
        ("study campaign x.yaml --out x", "pyarrow"),
        ("study campaign x.yaml --out x --engine dask --scheduler tcp://127.0.0.1:1", "distributed"),
    ],
}
"""Commands of each package, each with the optional module that is missing."""
WITHOUT_MODULE = """
def work(case):
    command, module = case
    sys.modules[module] = None
    from {package}.cli.main import main
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        code = main(command.split())
    return code, output.getvalue(), errors.getvalue()
"""


@pytest.mark.parametrize("package", first_of(NEEDING_AN_EXTRA))
def test_a_missing_extra_is_one_line_with_the_install_command(package: str) -> None:
    cases = NEEDING_AN_EXTRA[package]
    hidden = {module for _, module in cases}
    program = f"""{FORKS}{WITHOUT_MODULE.format(package=package)}
import {COMMON[package]}
assert not {hidden!r} & set(sys.modules)
forked(work, {cases!r})
"""
    done = python(program)
    assert (done.returncode, done.stderr) == (0, "")
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert found == [[[*case], [2, "", missing_extra(*case)]] for case in cases]


def missing_extra(command: str, module: str, extra: str = "") -> str:
    name = command.split(maxsplit=1)[0]
    return f"{name}: {module} is not installed; run: {install_command(extra or EXTRAS[module][0])}\n"


@pytest.mark.parametrize(("command", "extra"), [("trial", "plant"), ("study throughput", "studies")])
def test_a_missing_dependency_of_the_plant_is_one_line_with_the_extra_of_the_command(command: str, extra: str) -> None:
    program = f"{WITHOUT_EXTRAS}\nfrom plant_sim.cli.main import main\nsys.exit(main({command.split()}))\n"
    done = python(program)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr in [missing_extra(command, module, extra) for module in EXTRAS]


WITHOUT_POSIX = """
import asyncio, concurrent.futures, getpass, multiprocessing.pool, os, shutil, signal, subprocess, sys, tempfile

for name in ("fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"):
    sys.modules[name] = None
for name in ("chown", "fork", "getegid", "geteuid", "getgid", "getpgid", "getuid", "killpg", "mkfifo", "nice",
             "sched_getaffinity", "sched_setscheduler", "setsid", "statvfs"):
    delattr(os, name)
for name in ("SIGALRM", "SIGCHLD", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGUSR1", "SIGUSR2", "pthread_sigmask",
             "setitimer", "sigwait"):
    delattr(signal, name)
"""
"""Start of a program that loads standard modules and then removes the modules and names that Windows lacks."""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("package", "arguments", "expected"),
    first_of(
        [
            ("controller", ("ladder", "export", "--target", "fx2n", "--out", "{folder}/fx2n"), "\nfits\n"),
            ("plant_sim", ("trial", "--trays", "1"), "seedlings 72: "),
            ("controller", ("prove", "--short", "--goal", "left: down away from feed"), "proved"),
            ("plant_sim", ("study", "cabbage-rsm", "--data", "printed"), "="),
            ("plant_sim", ("study", "pepper-rsm", "--trials", "1", "--workers", "1", "--seedlings", "12"), "="),
        ],
    ),
    ids=["ladder", "trial", "prove", "study of a table", "study with trials"],
)
def test_a_command_runs_without_posix(package: str, arguments: tuple[str, ...], expected: str, tmp_path: Path) -> None:
    """The commands ladder, prove, trial and study run without POSIX modules, as on Windows, where GX Works2 runs."""
    program = f"{WITHOUT_POSIX}\nfrom {package}.cli.main import main\nsys.exit(main(sys.argv[1:]))\n"
    done = python(program, *(each.format(folder=tmp_path) for each in arguments))
    assert (done.returncode, done.stderr.count("Error")) == (0, 0), done.stderr
    assert expected in done.stdout


def imported_modules() -> Iterator[str]:
    """Yield the top-level name of every module that the packages and the benchmark import."""
    folders = ("scripts/benchmark", *(line.package for line in COMMAND_LINES))
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(tree(path)):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            yield from (name.partition(".")[0] for name in names)
        yield from re.findall(r"import_module\(\"(\w+)", text)


def every(names: dict[str, set[str]], extra: str) -> set[str]:
    """Return the packages of an extra, with those of the extras that it includes."""
    found = set[str]()
    for name in names[extra]:
        included = re.fullmatch(r"seedling-transplanter\[(.*)\]", name)
        found |= (
            {name.replace("_", "-")}
            if included is None
            else set().union(*(every(names, each) for each in included[1].split(",")))
        )
    return found


def test_every_third_party_module_is_provided_by_a_dependency_or_by_the_extra_of_the_table() -> None:
    own = {"scripts", *(line.package for line in COMMAND_LINES)}
    modules = set(imported_modules()) - set(sys.stdlib_module_names) - own
    modules.discard("pydantic_core")  # a dependency of pydantic
    assert modules == BASE | set(EXTRAS)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    requirements = {"": project["dependencies"], **project["optional-dependencies"]}
    names = {extra: {re.split("[><=]", each)[0].lower() for each in lines} for extra, lines in requirements.items()}
    distributions = importlib.metadata.packages_distributions()
    for module in modules:
        provided = {each.lower().replace("_", "-") for each in distributions[module]}
        for extra in EXTRAS.get(module, ("",)):
            assert provided & every(names, extra), f"{module}: not in the extra {extra or '(none)'}"
