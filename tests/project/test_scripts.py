"""Scripts of the repository on a simulated computer: the steps that scripts/setup performs, and the other scripts.

The computer is a folder of tools used as PATH. Its Python is a shell script that logs its arguments, so the tests are
fast and need neither a network nor root privileges.
"""

import fcntl
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.real_time import WAIT_S

COMMANDS = ["scripts/run", "scripts/test", "scripts/bench", "scripts/setup", ".ci/run"]
TOOLS = ["bash", "cat", "chmod", "cp", "dirname", "env", "flock", "mkdir", "readlink", "rm", "sha256sum"]

PYTHON = """#!/usr/bin/env bash
case "$*" in
    -V) echo "Python ${VERSION:-3.11.2}" ;;
    *ensurepip*) exit "${WITHOUT_VENV:-0}" ;;
    "-m venv --clear .venv")
        echo venv >>"$LOG"
        rm -rf .venv
        mkdir -p .venv/bin
        for name in python python3 ruff mypy lint-imports pytest; do cp "$0" ".venv/bin/$name"; done
        ;;
    *"scripts/foreign_files.py --check") [[ ! -e "${LOG%/*}/new text" ]] || exit 1 ;;
    "-m pip install"*)
        [[ -n ${PIP_FAILS:-} ]] || rm -f "${LOG%/*}/new text"
        [[ $* == *" --no-deps "* ]] && alone=" alone"
        echo "pip${alone:-} ${*: -1}" >>"$LOG"
        if [[ -p ${GATE:-} ]]; then cat "$GATE"; fi
        exit "${PIP_FAILS:-0}"
        ;;
    *)
        (IFS='|' && echo "${0##*/}|$*")
        if [[ ${FAILING:-} == "${0##*/}" || " $* " == *" ${FAILING_ARGUMENT:-none} "* ]]; then exit 3; fi
        ;;
esac
"""
NODE = "tests/controller/hmi/mitsubishi/node"
NPM = f"""#!/usr/bin/env bash
[[ "$*" == "install --prefix {NODE} "* ]] && echo npm >>"$LOG" && mkdir -p "{NODE}/node_modules"
exit "${{NPM_FAILS:-0}}"
"""
NO_PYTHON = (
    "scripts/setup: no Python 3.11 or newer with the venv module; "
    "ask the administrator to run: apt-get install -y python3-venv python3-pip\n"
)


@dataclass
class Machine:
    """Simulated computer with the repository in a folder whose name contains a space."""

    repository: Path
    tools: Path
    log: Path
    started: list[subprocess.Popen[str]] = field(default_factory=list)

    def switch_off(self) -> None:
        """Kill the processes that a failed test has left running, and their children."""
        for process in self.started:
            with process:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)

    def start(self, command: str, *arguments: str, **variables: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [str(self.repository / command), *arguments],
            cwd=self.tools.parent,
            env=self.environment(variables),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,
        )
        self.started.append(process)
        return process

    def environment(self, variables: Mapping[str, str]) -> dict[str, str]:
        return {"PATH": str(self.tools), "LOG": str(self.log), **variables}

    def run(self, command: str, *arguments: str, **variables: str) -> tuple[int, str, str]:
        """Run a command; return exit code, standard output and standard error."""
        process = self.start(command, *arguments, **variables)
        output, errors = process.communicate(timeout=WAIT_S)
        return process.returncode, output, errors

    def setup(self, extra: str, **variables: str) -> list[str]:
        """Run a setup that must succeed; return its logged steps."""
        self.log.write_text("")
        code, _, errors = self.run("scripts/setup", extra, **variables)
        assert code == 0, errors
        return self.log.read_text().splitlines()

    def tool(self, name: str, script: str) -> None:
        path = self.tools / name
        path.write_text(script)
        path.chmod(0o755)


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    machine = Machine(tmp_path / "seed lings", tmp_path / "tools", tmp_path / "log")
    for command in COMMANDS:
        (machine.repository / command).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / command, machine.repository / command)
    shutil.copy(ROOT / "pyproject.toml", machine.repository)
    (machine.repository / NODE).mkdir(parents=True)
    shutil.copy(ROOT / NODE / "package.json", machine.repository / NODE)
    machine.tools.mkdir()
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found is not None
        (machine.tools / tool).symlink_to(found)
    machine.tool("python3", PYTHON)
    machine.tool("id", "#!/usr/bin/env bash\necho 1000\n")
    for tool in DEBIAN_TOOLS:
        machine.tool(tool, "#!/usr/bin/env bash\n")
    machine.tool("npm", NPM)
    yield machine
    machine.switch_off()


FROM_NOTHING = ["venv", "pip .[dev]", "npm"]
DEBIAN_TOOLS = ["mbpoll", "chromium", "chromium-headless-shell", "npm"]
"""Debian packages that the tests need."""


@pytest.mark.parametrize("command", COMMANDS)
def test_scripts_are_executable_and_stop_at_the_first_error(command: str) -> None:
    assert os.access(ROOT / command, os.X_OK)
    assert "\nset -euo pipefail\n" in (ROOT / command).read_text()


def test_a_second_setup_does_nothing(machine: Machine) -> None:
    assert machine.setup("dev") == FROM_NOTHING
    assert machine.setup("dev") == []
    assert machine.setup("plant") == []  # dev includes plant


def test_dev_after_plant_is_added_to_the_environment(machine: Machine) -> None:
    assert machine.setup("plant") == ["venv", "pip .[plant,studies,panel,parquet,completion]"]
    assert machine.setup("dev") == ["pip .[dev]", "npm"]


def test_a_changed_pyproject_is_installed_again(machine: Machine) -> None:
    machine.setup("dev")
    with (machine.repository / "pyproject.toml").open("a") as file:
        file.write("# one more line\n")
    assert machine.setup("dev") == ["pip .[dev]", "npm"]
    assert machine.setup("dev") == []


@pytest.mark.parametrize("extra", ["dev", "plant"])
def test_the_font_is_made_again_for_a_new_text(machine: Machine, extra: str) -> None:
    machine.setup(extra)
    (machine.log.parent / "new text").touch()
    assert machine.setup(extra) == ["pip alone ."], "without the dependencies"
    assert machine.setup(extra) == []


def test_a_font_that_cannot_be_made_is_reported_and_tried_again(machine: Machine) -> None:
    machine.setup("plant")
    (machine.log.parent / "new text").touch()
    code, _, errors = machine.run("scripts/run", PIP_FAILS="1")
    assert (code, errors.splitlines()[-1]) == (2, "scripts/setup: pip failed (see above); the next run tries again")
    assert machine.setup("plant") == ["pip alone ."]


def test_deleted_npm_packages_are_installed_again(machine: Machine) -> None:
    machine.setup("dev")
    (machine.repository / NODE / "node_modules").rmdir()
    assert machine.setup("plant") == []
    assert machine.setup("dev") == ["pip .[dev]", "npm"]


def test_a_failed_setup_starts_from_the_beginning(machine: Machine) -> None:
    code, _, errors = machine.run("scripts/setup", "dev", PIP_FAILS="1")
    assert code == 2
    assert errors.endswith("scripts/setup: pip failed (see above); the next run starts from the beginning\n")
    assert machine.setup("dev") == FROM_NOTHING


def test_a_failed_npm_starts_from_the_beginning(machine: Machine) -> None:
    code, _, errors = machine.run("scripts/setup", "dev", NPM_FAILS="1")
    assert code == 2
    assert errors.endswith("scripts/setup: npm failed (see above); the next run starts from the beginning\n")
    assert machine.setup("dev") == FROM_NOTHING


def test_a_failed_addition_starts_from_the_beginning(machine: Machine) -> None:
    machine.setup("plant")
    assert machine.run("scripts/setup", "dev", PIP_FAILS="1")[0] == 2
    assert machine.setup("plant") == ["venv", "pip .[plant,studies,panel,parquet,completion]"]


def test_another_python_version_rebuilds_the_environment(machine: Machine) -> None:
    machine.setup("dev")
    assert machine.setup("dev", VERSION="3.12.0") == FROM_NOTHING


def test_a_missing_python_rebuilds_the_environment(machine: Machine) -> None:
    machine.setup("dev")
    (machine.repository / ".venv/bin/python").unlink()
    assert machine.setup("dev") == FROM_NOTHING


def test_a_moved_repository_rebuilds_the_environment(machine: Machine) -> None:
    machine.setup("dev")
    machine.repository = machine.repository.rename(machine.repository.with_name("moved lings"))
    assert machine.setup("dev") == FROM_NOTHING


def test_a_concurrent_setup_waits_and_has_nothing_left_to_do(machine: Machine, tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    first = machine.start("scripts/setup", "dev", GATE=str(gate))
    assert first.stderr is not None
    assert first.stderr.readline() == "scripts/setup: creating .venv with Python 3.11.2\n"
    expected = "scripts/setup: installing the project with dev in .venv, which takes 1 to 3 minutes\n"
    assert first.stderr.readline() == expected
    second = machine.start("scripts/setup", "dev")
    assert second.stderr is not None
    assert second.stderr.readline() == "scripts/setup: waiting for another setup to finish\n"
    gate.write_text("")  # lets the first pip finish
    done, nothing = (process.communicate(timeout=WAIT_S)[1] for process in (first, second))
    assert re.fullmatch(r"scripts/setup: done in \d+ s\n", done)
    assert nothing == ""
    assert (first.returncode, second.returncode) == (0, 0)
    assert machine.log.read_text().splitlines() == FROM_NOTHING


def test_an_up_to_date_environment_needs_no_lock(machine: Machine) -> None:
    machine.setup("dev")
    descriptor = os.open(machine.repository, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    assert machine.setup("dev") == []
    os.close(descriptor)


def test_an_activated_environment_is_not_rebuilt_by_its_own_python(machine: Machine) -> None:
    machine.setup("dev")
    (machine.repository / ".venv/.base").unlink()
    path = f"{machine.repository}/.venv/bin:{machine.tools}"
    assert machine.setup("dev", PATH=path) == FROM_NOTHING


def test_a_later_python_in_the_path_is_used_if_the_first_has_no_venv(machine: Machine) -> None:
    machine.tool("python3", "#!/usr/bin/env bash\nexit 1\n")
    machine.tool("python3.12", PYTHON)
    assert machine.setup("dev") == FROM_NOTHING


def test_a_missing_venv_module_is_reported_with_the_remedy(machine: Machine) -> None:
    machine.tool("apt-get", '#!/usr/bin/env bash\necho "apt-get $*" >>"$LOG"\n')
    assert machine.run("scripts/run", WITHOUT_VENV="1") == (2, "", NO_PYTHON)
    assert not machine.log.exists()


def test_root_installs_a_missing_venv_module(machine: Machine) -> None:
    machine.tool("id", "#!/usr/bin/env bash\necho 0\n")
    machine.tool("python3", "#!/usr/bin/env bash\nexit 1\n")
    machine.tool("python3.11", PYTHON)
    (machine.tools / "python3.11").rename(machine.tools / "waiting")
    install = f'if [[ "$*" == *" install "* ]]; then cp {machine.tools}/waiting {machine.tools}/python3; fi'
    machine.tool("apt-get", f'#!/usr/bin/env bash\necho "apt-get $*" >>"$LOG"\n{install}\n')
    done = machine.setup("dev")
    assert done == ["apt-get -qq update", "apt-get -qq install -y python3-venv python3-pip", *FROM_NOTHING]


def test_root_installs_missing_tools_of_the_tests(machine: Machine) -> None:
    machine.tool("id", "#!/usr/bin/env bash\necho 0\n")
    for tool in DEBIAN_TOOLS:
        (machine.tools / tool).rename(machine.tools / f"{tool}.waiting")
    install = "".join(f"cp {machine.tools}/{tool}.waiting {machine.tools}/{tool};" for tool in DEBIAN_TOOLS)
    machine.tool(
        "apt-get", f'#!/usr/bin/env bash\necho "apt-get $*" >>"$LOG"\n[[ $* != *install* ]] || {{ {install} }}\n'
    )
    done = machine.setup("dev")
    assert done == ["apt-get -qq update", f"apt-get -qq install -y {' '.join(DEBIAN_TOOLS)}", *FROM_NOTHING]
    assert machine.setup("dev") == []


@pytest.mark.parametrize("there", [[], ["mbpoll"]])
def test_missing_tools_are_reported_to_other_users(machine: Machine, there: list[str]) -> None:
    missing = [tool for tool in DEBIAN_TOOLS if tool not in there]
    for tool in missing:
        (machine.tools / tool).unlink()
    named = " ".join(missing)
    expected = f"scripts/setup: the tests need {named}; ask the administrator to run: apt-get install -y {named}\n"
    assert machine.run("scripts/test") == (2, "", expected)
    assert not machine.log.exists()
    assert machine.run("scripts/run")[0] == 0, "the simulated machine needs none of these tools"


@pytest.mark.parametrize(
    ("script", "command", "extra"),
    [
        ("run", "-P|-m|plant_sim|run", "plant,studies,panel,parquet,completion"),
        ("bench", "-m|scripts.benchmark", "dev"),
    ],
)
def test_run_and_bench_pass_their_arguments_on(machine: Machine, script: str, command: str, extra: str) -> None:
    code, output, _ = machine.run(f"scripts/{script}", "--speed", "2 x")
    assert (code, output) == (0, f"python|{command}|--speed|2 x\n")
    assert machine.log.read_text().splitlines() == ["venv", f"pip .[{extra}]", *(["npm"] if extra == "dev" else [])]


@pytest.mark.parametrize("arguments", [[], ["--nightly", "program"], ["-k", "a b", "-x"]])
def test_scripts_test_sets_up_and_passes_its_arguments_on(machine: Machine, arguments: list[str]) -> None:
    code, output, _ = machine.run("scripts/test", *arguments)
    assert (code, output) == (0, f"{'|'.join(['python', '-m', 'tests.suite', *arguments])}\n")
    assert machine.log.read_text().splitlines() == FROM_NOTHING


def test_continuous_integration_runs_one_nightly_part_after_the_tests(machine: Machine) -> None:
    machine.setup("dev")
    machine.tool("git", "#!/usr/bin/env bash\n[[ $* == 'rev-parse HEAD' ]] && echo 5f\n")
    code, output, _ = machine.run(".ci/run")
    part = "python|-m|tests.suite.parts|5f"  # the simulated Python prints its arguments
    first, named, second = output.splitlines()
    assert (code, first) == (0, "python|-m|tests.suite")
    assert named == f"nightly part of this commit: scripts/test --nightly {part}"
    assert second == f"python|-m|tests.suite|--nightly|{part}"


def test_continuous_integration_fails_with_the_nightly_part(machine: Machine) -> None:
    machine.setup("dev")
    machine.tool("git", "#!/usr/bin/env bash\necho 5f\n")
    code, output, _ = machine.run(".ci/run", FAILING_ARGUMENT="--nightly")
    assert (code, len(output.splitlines())) == (3, 3)


def test_continuous_integration_fails_with_the_tests(machine: Machine) -> None:
    machine.setup("dev")
    code, output, _ = machine.run(".ci/run", FAILING="python")
    assert (code, output) == (3, "python|-m|tests.suite\n")


def test_scripts_test_ends_with_the_exit_code_of_the_suite(machine: Machine) -> None:
    machine.setup("dev")
    assert machine.run("scripts/test", FAILING="python")[0] == 3


@pytest.mark.parametrize("name", ["studies", "", "dev plant"])
def test_an_unknown_set_is_rejected(machine: Machine, name: str) -> None:
    expected = f"scripts/setup: unknown set '{name}'; use plant or dev\n"
    assert machine.run("scripts/setup", name) == (2, "", expected)


def test_setup_without_a_set_lists_every_set(machine: Machine) -> None:
    """Nothing is installed; each listed set can be installed."""
    code, output, errors = machine.run("scripts/setup")
    assert (code, output, machine.log.exists()) == (2, "", False)
    sets = re.findall(r"^  (\w+)  ", errors, re.MULTILINE)
    assert sets == ["plant", "dev"]
    assert [machine.setup(each)[-1] for each in sets] == ["pip .[plant,studies,panel,parquet,completion]", "npm"]
