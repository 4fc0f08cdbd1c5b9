"""Command ``plant_sim debug``: answers, and one line with exit code 2 for an invalid command."""

from __future__ import annotations

import json

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


def test_events_are_sentences(capsys: pytest.CaptureFixture[str]) -> None:
    fault = ("--fault", "broken_wire:emergency_stop@12500ms..")
    assert main([*SHORT, *fault, "--do", "events"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "11.58 s: state Idle; now: press X0 to start" in lines
    (alarm,) = (line for line in lines if ": alarm " in line)
    assert alarm.endswith("s: alarm S900 on: Emergency stop pressed")
    assert not any("=" in line for line in lines if " s: " in line)


def test_a_set_point_has_its_initial_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SHORT, "--max-s", "1", "--set", "settle=30", "--do", "goto 0", "--do", "show settle"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "D520: 30  settle x10 ms"
    for given, told in (("settle=7x", "--set settle=7x: "), ("trays_target=3", "is the number of trays; use --trays")):
        assert main([*SHORT, "--set", given, "--do", "show"]) == 2
        assert told in capsys.readouterr().err
    assert main(["trial", "--ladder", "none.il", "--set", "settle=30"]) == 2
    assert "--ladder: the program has its own initial values; omit --set" in capsys.readouterr().err


def test_a_trial_begins_with_the_given_set_points(capsys: pytest.CaptureFixture[str]) -> None:
    """An arm that settles for 800 ms in place of 50 ms waits less than 7.74 s for its cups."""
    main(["trial", "--trays", "1", "--max-s", "45", "--json", "--set", "settle=80"])
    assert json.loads(capsys.readouterr().out)["cycle_times"]["left row 1"]["waiting_s"] < 7.5
