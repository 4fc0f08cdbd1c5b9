"""Every command of every guide, executed as printed, in a separate folder for each page.

By default, one page in sixteen runs, a command that is on several pages runs on the first of them, and of some commands
only the options are checked; the complete pages run with ``--nightly``, but for commands of minutes or hours, which run
with ``--weekly``.
The commands of a page run in order, because later ones read files that earlier ones have written. Files that a page
expects its reader to have (``my.il``, ``my_map.yaml``, ...) are created beforehand. Servers use free ports and are
stopped with Ctrl-C when they are ready.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, get_args

import pytest
from _pytest.mark import ParameterSet

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.cli.main import main as controller_main
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.cli.main import COMMAND_LINE as PLANT
from plant_sim.cli.main import main as plant_main
from plant_sim.common.paper_items import PaperName, paper_items
from scripts.benchmark.results.page import main as page_main
from tests.paths import DOCS, ROOT
from tests.real_time import LIVE_RUN_OPTION, LOCK_STEP, SIMULATED, judge_live_run
from tests.sampling import one_in

PAGES: Final = {
    page.relative_to(ROOT).as_posix(): page
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
    if page.exists()
}
LINES: Final = {"controller": CONTROLLER, "plant_sim": PLANT}
MAIN: Final = {"controller": controller_main, "plant_sim": plant_main, "scripts.benchmark.results.page": page_main}
LIMIT_S: Final = 600
START_LIMIT_S: Final = 60

_, _, _EXCEPTIONS = (
    (DOCS / "README.md").read_text(encoding="utf-8").partition("## Commands that the tests do not run\n")
)
NOT_RUN: Final = dict(re.findall(r"^- `([^`]+)`: (.+)$", _EXCEPTIONS, re.MULTILINE))
"""Commands that need hardware, each with the hardware that it needs, as listed in docs/README.md."""
NOT_RUN_COUNT: Final = 7
RUN_ELSEWHERE: Final = re.compile(
    r"scripts/test\b|\.venv/bin/python -m controller (prove$|capture record|run --real-time-priority)"
    r"|scripts/bench\b|\.venv/bin/python -m controller prove .*(tray moves while clamped|other outputs)"
    r"|\.venv/bin/python -m plant_sim (hil program|faults --fault slow_valve:lift )|\S+ -m .* --dap\b"
    r"|\.venv/bin/python -m controller ladder page .*--connect"
    r"|\.venv/bin/python -m tests\.plant_sim\.hil\.score "
)
"""Commands that are covered elsewhere: `scripts/test` runs this test, test_scenario_guide.py runs the checks of the
scenario guide, test_prove.py runs the complete proof, test_capture.py the proxy, test_real_time.py the priority, which
a system may refuse, test_parts.py every part of the benchmark, test_adding_a_device.py the proof of the added output,
test_adding_a_case.py the added row and the added cases, test_hil_command.py the bench of the program,
tests/plant_sim/hil the score of damages, of which this command takes hours, test_machine_page.py the page of a live
program, and test_foreign_client.py the debug adapter."""
PAPERS: Final = {
    f".venv/bin/python -m {command}"
    for paper in get_args(PaperName)
    for item in paper_items(paper)
    for command in item.commands
}
"""Commands that ``tests/plant_sim/papers`` runs."""
LONG: Final = {
    ".venv/bin/python -m controller prove --mutants 20 --seed 1",
    ".venv/bin/python -m controller prove --mutants 300 --seed 1 --out docs/reference",
    ".venv/bin/python -m controller ladder sizes --out docs/reference",
    ".venv/bin/python -m plant_sim faults --all --out fault-matrix",
    ".venv/bin/python -m plant_sim faults --all --yield-inputs --moments 1 --out fault-matrix",
    ".venv/bin/python -m plant_sim faults --yield-inputs --fault jammed:claws --fault stuck_valve:claws "
    "--out fault-matrix",
    ".venv/bin/python -m plant_sim faults --all --times 0.25 --times 0.5 --times 2 --times 4 --out fault-matrix",
    ".venv/bin/python -m plant_sim faults --at-rest --all --out fault-matrix",
    ".venv/bin/python -m plant_sim faults --at-rest --all --stop stopped --every 500",
}
"""Slow commands that take minutes to hours and run only with ``--weekly``; no other command reads their files."""
SLOW: Final = LONG | {
    '.venv/bin/python -m controller prove --goal "homing arrives in Idle"',
    '.venv/bin/python -m controller prove --goal "homing ends within T"',
    '.venv/bin/python -m controller prove --without "left: down at feed only" --goal "left: down away from feed" '
    "--traces traces",
    '.venv/bin/python -m controller replay --without "left: down at feed only" traces/left-down-away-from-feed.json',
    '.venv/bin/python -m controller prove --goal "left: down away from feed"',
    ".venv/bin/python -m controller run --hmi-port 5021",
    ".venv/bin/python -m controller run --mc 3e --mc-port 5007",
    '.venv/bin/python -m plant_sim faults --at-rest --fault stuck_on:slide_at_feed --stop "emergency stop" '
    '--stop "link lost"',
    ".venv/bin/python -m plant_sim faults --stored-air --trays 1 --out stored-air",
    ".venv/bin/python -m plant_sim line cabbage --metres 10 --out my-row",
    ".venv/bin/python -m plant_sim line pepper --metres 100 --out my-row",
    ".venv/bin/python -m plant_sim plot var/trial.parquet",
    ".venv/bin/python -m plant_sim planter --figure 9 --plot var/planter.gif",
    ".venv/bin/python -m plant_sim reproduce my-row --out my-row-again",
    ".venv/bin/python -m plant_sim serve --watchdog-ms 500",
    ".venv/bin/python -m plant_sim stories --random 50",
    ".venv/bin/python -m plant_sim stories --random 50 --undirected",
    ".venv/bin/python -m plant_sim stories --replay 'seed=541 trays=3 work=30540; 31100 press stop for=300; "
    "45000 push =12.0; 50000 tend'",
    ".venv/bin/python -m plant_sim study campaign docs/examples/campaign.yaml --trials 1 --seedlings 12 "
    "--out var/campaign",
    ".venv/bin/python -m plant_sim study campaign docs/examples/campaign.yaml --trials 2 --seedlings 12 "
    "--out var/campaign",
    ".venv/bin/python -m plant_sim study planter-lodging --out var/planter-lodging",
    ".venv/bin/python -m plant_sim study planter-release --out var/planter-release",
    ".venv/bin/python -m plant_sim study planter-verdicts --out var/planter-verdicts",
    ".venv/bin/python -m plant_sim study throughput --json",
    ".venv/bin/python -m plant_sim trial --ladder my.csv --scan-estimate",
    ".venv/bin/python -m plant_sim trial --ladder my.csv --scan-ms 10 11 --jitter-ms 2 --repeat 2",
    "scripts/run --real-time",
}
"""Commands that are run only with ``--nightly``: those that take more than 2 s, commands that read their files, and
servers like those of docs/first-run.md.
"""
SERVERS: Final = {"serve", "run", "hil"}
EXPECTED_CODES: Final = {"prove --without": 1, "replay --without": 1}
"""Non-zero exit codes of commands that report a violated requirement, by a part of the command."""


def commands(page: Path) -> list[str]:
    """Return the commands of a page, in order."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^( *)```sh\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    return [line.strip() for _, block in blocks for line in block.splitlines() if line.strip()]


def runnable(page: Path) -> list[str]:
    """Return the commands of a page that are run here."""
    return [command for command in commands(page) if command not in NOT_RUN and not RUN_ELSEWHERE.match(command)]


def chosen() -> dict[str, list[str]]:
    """Return the commands of each page for the default run, without pages that have none."""
    done = SLOW | PAPERS
    pages = {}
    for name, page in PAGES.items():
        pages[name] = [command for command in runnable(page) if command not in done]
        done = done | {*pages[name]}
    return {name: found for name, found in pages.items() if found}


BY_DEFAULT: Final = chosen()
COMPLETE: Final = {name: found for name, page in PAGES.items() if (found := runnable(page)) != BY_DEFAULT.get(name, [])}
"""Commands of the pages of which only some or none are run by default."""


def periods() -> list[ParameterSet]:
    """Return the complete pages with the mark of their period: every night without the long commands."""
    pages = []
    for name, found in COMPLETE.items():
        by_night = [command for command in found if command not in LONG]
        live = [pytest.mark.real_time] if LIVE_RUN_OPTION in " ".join(found) else []
        if by_night:
            pages.append(pytest.param(name, by_night, marks=[pytest.mark.nightly, *live], id=name))
        if by_night != found:
            pages.append(pytest.param(name, found, marks=[pytest.mark.weekly, *live], id=f"{name}, complete"))
    return pages


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder that the commands can use as a checkout, with the files that a reader would have.

    Commands that read their standard input find its end. scripts/run is that of the checkout. scripts/setup does
    nothing, because the commands use the environment of this test.
    """
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    interpreter = tmp_path / ".venv/bin/python"
    interpreter.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n', encoding="utf-8")
    interpreter.chmod(0o755)
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/run", tmp_path / "scripts/run")
    (tmp_path / "scripts" / "setup").write_text("#!/bin/sh\n", encoding="utf-8")
    (tmp_path / "scripts" / "setup").chmod(0o755)
    shutil.copytree(DOCS, tmp_path / "docs")
    (tmp_path / "var").mkdir()
    shutil.copy(DEFAULT_IO_MAP, tmp_path / "my_map.yaml")
    (tmp_path / "my.il").write_text("LD X0\nOUT Y0\nLD Y0\nOUT T0 K5\nEND\n", encoding="utf-8")
    (tmp_path / "my.yaml").write_text(
        "scan_ms: 10\nscans: 20\ninputs:\n  - {at_ms: 50, set: {X0: 1}}\nwatch: [X0, Y0]\n", encoding="utf-8"
    )
    (tmp_path / "my-modules.yaml").write_text("modules:\n  - {position: 0, model: FX2N-4AD}\n", encoding="utf-8")
    return tmp_path


def run(command: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Run a command, in this process if it is a Python command; return its exit code, output and error output."""
    words = shlex.split(command)
    if words[0] == ".venv/bin/python" and words[2] in MAIN:
        with contextlib.chdir(folder):
            code = MAIN[words[2]](words[3:])
        printed = capsys.readouterr()
        return code, printed.out, printed.err
    done = run_process(words, folder)
    return done.returncode, done.stdout, done.stderr


def run_process(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        arguments,
        check=False,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        cwd=folder,
        env=environment(),
    )


def environment() -> Mapping[str, str]:
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def python(folder: Path, *arguments: str) -> None:
    done = run_process([sys.executable, "-m", *arguments], folder)
    assert done.returncode == 0, done.stderr


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        return int(reserved.getsockname()[1])


@contextmanager
def served(arguments: list[str], folder: Path, ready: str) -> Iterator[subprocess.Popen[str]]:
    """Run a server during the block, which begins when the server is ready; Ctrl-C must stop it cleanly at the end."""
    with subprocess.Popen(
        arguments,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=folder,
        env=environment(),
        start_new_session=True,
    ) as process:
        try:
            assert process.stdout is not None
            printed: list[str] = []
            for line in process.stdout:
                printed.append(line)
                if ready in line:
                    break
            else:
                pytest.fail(f"{shlex.join(arguments)} ended: {''.join(printed)}")
            yield process
            process.send_signal(signal.SIGINT)
            rest, _ = process.communicate(timeout=START_LIMIT_S)
            assert "Traceback" not in rest
            assert process.returncode in {0, 130}, rest
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def serve(commands: list[str], folder: Path) -> None:
    """Start servers with free ports, a machine in simulated time, and stop them; a controller alone gets a plant."""
    port = ""
    with ExitStack() as stack:
        for arguments in map(shlex.split, commands):
            if arguments[0] == "scripts/run":
                ports = ["--port", str(free_port()), "--hmi-port", "0", "--panel-port", "0"]
                stack.enter_context(served([*arguments, *ports], folder, "Execute"))
                continue
            if "--page" in arguments:
                arguments[arguments.index("--page") + 1] = "0"
                stack.enter_context(served(arguments, folder, "http://127.0.0.1:"))
                continue
            if "plant_sim" in arguments or not port:
                port = str(free_port())
                plant = arguments if "plant_sim" in arguments else [sys.executable, "-m", "plant_sim", "serve"]
                stack.enter_context(served([*plant, "--port", port, *LOCK_STEP], folder, "plant listening on"))
            if "plant_sim" not in arguments:
                stack.enter_context(
                    served([*arguments, "--port", port, *SIMULATED, "--hmi-port", "0"], folder, "Stopped")
                )


def is_server(command: str) -> bool:
    words = shlex.split(command)
    if words[0] == "scripts/run":
        return "--fast" not in words and "--real-time" not in words
    if "--page" in words:
        return True
    return words[0].endswith("python") and (words[3:4] or ["run"])[0] in SERVERS and "--check" not in words


def recorded_history(folder: Path) -> None:
    """Run a controller so that a history exists, as after a first run."""
    serve([f"{sys.executable} -m controller run"], folder)


def exported_program(folder: Path) -> None:
    python(folder, "controller", "ladder", "export", "--target", "fx2n", "--out", "fx2n")
    (folder / "fx2n" / "transplanter.csv").rename(folder / "my.csv")


def story_of_the_faults(folder: Path) -> None:
    page = (DOCS / "faults.md").read_text(encoding="utf-8")
    (story,) = re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (folder / "my-story.yaml").write_text(story, encoding="utf-8")


def ground_of_the_page(folder: Path) -> None:
    page = (DOCS / "line.md").read_text(encoding="utf-8")
    _, ground = re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (folder / "my-ground.yaml").write_text(ground, encoding="utf-8")


PREPARED: Final[Mapping[str, Callable[[Path], None]]] = {
    "docs/history.md": recorded_history,
    "docs/ladder.md": exported_program,
    "docs/adding-a-case.md": story_of_the_faults,
    "docs/faults.md": story_of_the_faults,
    "docs/line.md": ground_of_the_page,
}


def check(name: str, commands: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run commands of a page, and check their exit codes and output; consecutive servers run together."""
    if name in PREPARED:
        PREPARED[name](folder)
    for are_servers, group in itertools.groupby(commands, is_server):
        if are_servers:
            serve([*group], folder)
            continue
        for command in group:
            code, output, errors = run(command, folder, capsys)
            if LIVE_RUN_OPTION in command:
                judge_live_run(code, output, errors)
                continue
            expected = next((code for part, code in EXPECTED_CODES.items() if part in command), 0)
            assert code == expected, f"{name}: {command}: {code}\n{errors}"
            assert "Traceback" not in errors
            if "--json" in command:
                json.loads(output)


@pytest.mark.timeout(3_600)
@pytest.mark.parametrize("name", one_in(16, BY_DEFAULT))
def test_the_commands_of_a_page_run(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(name, BY_DEFAULT[name], folder, capsys)


@pytest.mark.timeout(14_400)
@pytest.mark.parametrize(("name", "found"), periods())
def test_all_commands_of_a_page_run(
    name: str, found: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check(name, found, folder, capsys)


@pytest.mark.parametrize("command", sorted(command for command in SLOW if command.startswith(".venv/bin/python")))
def test_the_options_of_a_slow_command_exist(command: str) -> None:
    _, _, program, *words = shlex.split(command)
    LINES[program].parser({words[0]}).parse_args(words)


def test_every_exception_is_on_a_page() -> None:
    """NOT_RUN and SLOW contain only commands that are on a page, and the pages call only Python and three scripts."""
    everything = {command for page in PAGES.values() for command in commands(page)}
    assert len(NOT_RUN) == NOT_RUN_COUNT
    assert set(NOT_RUN) | SLOW <= everything
    programs = {shlex.split(command)[0] for command in everything}
    assert programs <= {".venv/bin/python", "scripts/run", "scripts/test", "scripts/bench"}


def test_every_command_of_the_pages_is_run() -> None:
    everything = {command for page in PAGES.values() for command in runnable(page)}
    by_default = {command for found in BY_DEFAULT.values() for command in found}
    complete = {command for found in COMPLETE.values() for command in found}
    assert by_default | complete == everything
    assert everything - by_default <= SLOW | PAPERS
