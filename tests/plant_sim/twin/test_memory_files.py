"""Files of the retentive memory between two runs of the controller: an old copy, a lost file, a killed run."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from controller.core.retentive_store import FileStore
from controller.program.tags import FORGOTTEN
from tests.plant_sim.twin.process_rig import first_events, plant_thread, run_command
from tests.real_time import COMMAND_S, WAIT_S
from tests.sampling import first_of

MEMORY_LOST = 904
"""Number of the alarm of lost memory."""
NOT_IN_ORDER = "the last run did not end in order (power failure or crash); the memory is that of its last stored scan"


def alarms(events: list[dict[str, object]]) -> list[object]:
    return [event["number"] for event in events if event["event"] == "alarm"]


@pytest.mark.nightly
def test_an_old_copy_of_the_memory_is_set_aside_and_the_operator_is_asked(tmp_path: Path) -> None:
    """The memory of the first run is put back after the second one; the third one starts with a new store."""
    memory = tmp_path / "retentive.json"
    with plant_thread() as port:
        first_events(port, tmp_path, count=1)
        copy = memory.read_bytes()
        first_events(port, tmp_path, count=1)
        assert memory.read_bytes() != copy
        memory.write_bytes(copy)
        events, errors = first_events(port, tmp_path)
        assert f"{memory}: an old copy: the mark says " in errors
        assert f"; renamed to {memory}.damaged-1 and {memory}.damaged-1.mark\n" in errors
        assert NOT_IN_ORDER not in errors
        assert alarms(events) == [MEMORY_LOST]
        assert (tmp_path / "retentive.json.damaged-1").read_bytes() == copy
        events, errors = first_events(port, tmp_path, count=1)
    assert "retentive memory is lost" not in errors


@pytest.mark.nightly
def test_a_lost_memory_file_is_reported(tmp_path: Path) -> None:
    """Only both files together may be deleted, for a new machine, and then it must be declared."""
    memory, mark = tmp_path / "retentive.json", tmp_path / "retentive.json.mark"
    with plant_thread() as port:
        first_events(port, tmp_path, count=1)
        memory.unlink()
        events, errors = first_events(port, tmp_path)
        assert f"{memory}: missing, although {mark.name} exists; retentive memory is lost" in errors
        assert alarms(events) == [MEMORY_LOST]
        for declares, expected in ((True, []), (False, [MEMORY_LOST])):
            memory.unlink()
            mark.unlink()
            events, errors = first_events(port, tmp_path, count=1 if declares else 2, declares=declares)
            assert (f"{memory}: no memory, which counts as lost" in errors) is not declares
            assert alarms(events) == expected


@pytest.mark.nightly
@pytest.mark.parametrize("end", first_of([signal.SIGKILL, signal.SIGINT, signal.SIGTERM]))
def test_only_a_run_that_was_killed_is_reported_as_such(tmp_path: Path, end: signal.Signals) -> None:
    store = FileStore(tmp_path / "retentive.json")
    with plant_thread() as port:
        first_events(port, tmp_path, count=1, end=end)
        left = store.load()
        events, errors = first_events(port, tmp_path, count=1)
    assert left is not None
    assert (NOT_IN_ORDER in errors) is (end == signal.SIGKILL) is store.interrupted
    assert alarms(events) == []
    assert [path.name for path in tmp_path.glob("*.damaged*")] == []


def killed_before_the_first_scan(tmp_path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Kill a controller that waits for its field I/O; return the contents of memory and mark."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = [sys.executable, "-m", *run_command(port, tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as waiting:
        assert waiting.stderr is not None
        assert any(f"127.0.0.1:{port}" in line for line in waiting.stderr)
        waiting.kill()
        waiting.communicate(timeout=WAIT_S)
    memory, mark = (json.loads((tmp_path / name).read_bytes()) for name in ("retentive.json", "retentive.json.mark"))
    return memory, mark


def test_a_start_without_a_field_has_confirmed_its_memory(tmp_path: Path) -> None:
    """Both marks are equal before the first scan, so that an old copy is detected also after a run that did nothing."""
    memory, mark = killed_before_the_first_scan(tmp_path)
    assert memory["generation"] == mark["generation"] == 1
    assert mark["open"] is True


def test_a_loss_is_stored_before_the_first_scan(tmp_path: Path) -> None:
    """A controller that is killed after it has set the memory aside still asks for the tray at the next start."""
    (tmp_path / "retentive.json").write_text("damaged", encoding="utf-8")
    memory, _ = killed_before_the_first_scan(tmp_path)
    assert memory["values"]["D561"] == FORGOTTEN


def test_a_refused_start_value_leaves_the_memory_alone(tmp_path: Path) -> None:
    (tmp_path / "retentive.json").write_text("damaged", encoding="utf-8")
    command = [sys.executable, "-m", *run_command(1, tmp_path, "--set", "clamp=1")]
    refused = subprocess.run(command, check=False, capture_output=True, text=True, timeout=COMMAND_S)
    assert (refused.returncode, refused.stderr) == (2, "--set clamp=1: must be 10 to 200\n")
    assert [path.name for path in tmp_path.iterdir()] == ["retentive.json"]


@pytest.mark.nightly
@pytest.mark.parametrize("option", first_of([(("--pace", "6000"),), (("--history", "/proc/no/history.sqlite"),)]))
def test_a_start_that_is_refused_ends_in_order(tmp_path: Path, option: tuple[str, str]) -> None:
    with plant_thread() as port:
        first_events(port, tmp_path, count=1)
        command = [sys.executable, "-m", *run_command(port, tmp_path, *option)]
        refused = subprocess.run(command, check=False, capture_output=True, text=True, timeout=COMMAND_S)
        assert option[0] in refused.stderr
        _, errors = first_events(port, tmp_path, count=1)
    assert NOT_IN_ORDER not in refused.stderr + errors
