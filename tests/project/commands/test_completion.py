"""Completion of the arguments of both packages by a shell."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.common.arguments.completion import SHELLS
from controller.common.command_line import CommandLine
from controller.common.extras import install_command
from plant_sim.cli.main import COMMAND_LINE as PLANT
from tests.real_time import COMMAND_S

LINES = (CONTROLLER, PLANT)


def script(line: CommandLine, shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        line.run([f"--print-completion={shell}"])
    assert ended.value.code == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    return printed.out


def completed(file: Path, *words: str) -> set[str]:
    """Return the words with which bash completes the last of some words."""
    typed = " ".join(f"'{word}'" for word in words)
    program = (
        f"source {file}; COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}\n"
        f"$(complete -p {words[0]} | sed 's/.*-F \\([^ ]*\\).*/\\1/') {words[0]} '{words[-1]}' '{words[-2]}'\n"
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", program], cwd=file.parent, capture_output=True, text=True, check=True, timeout=COMMAND_S
    )
    assert done.stderr == ""
    return {word.strip() for word in done.stdout.splitlines()}


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.package)
def test_bash_completes_commands_options_choices_and_files(
    line: CommandLine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "completion.sh"
    file.write_text(script(line, "bash", capsys), encoding="utf-8")
    assert set(line.commands) <= completed(file, line.script, "")
    assert completed(file, line.script, "run", "--io-m") == {"--io-map"}
    assert completed(file, line.script, "run", "--language", "z") == {"zh"}
    assert completed(file, line.script, "run", "--io-map", "com") == {"completion.sh"}


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.package)
def test_zsh_is_given_every_command_with_its_help(line: CommandLine, capsys: pytest.CaptureFixture[str]) -> None:
    text = script(line, "zsh", capsys)
    assert text.startswith(f"#compdef {line.script}\n")
    for name in line.commands:
        assert f"\n    {name}:" in text


def test_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        PLANT.run(["--print-completion", "csh"])
    assert ended.value.code == 2
    assert f"choose from {', '.join(map(repr, SHELLS))}" in capsys.readouterr().err


def test_without_the_extra_the_command_that_installs_it_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert CONTROLLER.run(["--print-completion", "zsh"]) == 2
    hint = f"shtab is not installed; run: {install_command('completion')}"
    assert capsys.readouterr().err == f"--print-completion: {hint}\n"
