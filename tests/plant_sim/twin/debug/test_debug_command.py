"""Command ``plant_sim debug``: answers, and one line with exit code 2 for an invalid command."""

from __future__ import annotations

import pytest

from plant_sim.cli.main import main

SHORT = ("debug", "--trays", "1", "--max-s", "20")


def test_commands_are_answered_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [part for command in ("goto 1300", "back 100 scans", "show state X0") for part in ("--do", command)]
    assert main([*SHORT, *arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-4:] == ["scan 1300, 13.00 s", "scan 1200, 12.00 s", "state: EXECUTE", "X0: 0  start"]


def test_an_invalid_command_ends_with_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SHORT, "--do", "rewind", "--do", "show"]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert "rewind: no such command" in captured.err
