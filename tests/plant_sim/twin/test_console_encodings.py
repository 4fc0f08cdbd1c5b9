"""Commands with names and signs that the encoding of the console cannot express."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from controller.program.states import State
from plant_sim.twin.process import Process
from tests.controller.common.test_output_streams import CONSOLES
from tests.controller.io.field.field_rig import INPUT_TAGS, OUTPUT_TAGS, device, file_of, own_wires, tcp
from tests.plant_sim.twin.process_rig import plant_thread, run_command
from tests.real_time import COMMAND_S, SIMULATED, WAIT_S
from tests.retained import retained
from tests.sampling import first_of

ISLAND = "阀岛"
LINK_LOST = 901


@pytest.mark.nightly
@pytest.mark.parametrize("console", first_of(CONSOLES))
def test_the_loss_of_a_device_with_a_chinese_name_is_told(console: str, tmp_path: Path) -> None:
    """The loss, the state Aborting and the alarm are events of a running controller on every console."""
    extra, encoding = CONSOLES[console]
    retain = retained(tmp_path / "retentive.json")
    with plant_thread() as port:
        field = file_of(
            tmp_path, device(ISLAND, "coils", tcp(port), own_wires(INPUT_TAGS + OUTPUT_TAGS), "watchdog_ms: 300")
        )
        command = ["controller", "run", "--field", str(field), *retain, "--no-hmi", "--events", "json"]
        running = subprocess.Popen(
            [sys.executable, "-m", *command, SIMULATED[0]],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, **extra},
        )
        assert running.stdout is not None
        first = json.loads(running.stdout.readline())
    end_of_hang = threading.Timer(WAIT_S, running.kill)
    end_of_hang.start()
    try:
        events = [first]
        while events[-1].get("state") != State.ABORTED:
            line = running.stdout.readline()
            assert line, f"no further event after {events}"
            events.append(json.loads(line.decode(encoding)))
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=WAIT_S)
    finally:
        end_of_hang.cancel()
        running.kill()
        running.communicate()
    kinds = [(event["event"], event.get("change") or event.get("state") or event.get("number")) for event in events]
    assert {("field", "lost"), ("state", State.ABORTING), ("alarm", LINK_LOST)} <= set(kinds)
    assert all(ISLAND in event["text"] for event in events if event["event"] in {"field", "alarm"})
    assert b"Traceback" not in errors


@pytest.mark.nightly
@pytest.mark.parametrize("console", first_of(CONSOLES))
@pytest.mark.parametrize("command", first_of(["planter", "study cabbage-rsm --data reconciled"]))
def test_a_report_with_signs_is_printed_on_every_console(console: str, command: str) -> None:
    extra, encoding = CONSOLES[console]
    done = subprocess.run(
        [sys.executable, "-m", "plant_sim", *command.split()],
        check=False,
        capture_output=True,
        env={**os.environ, **extra},
        timeout=COMMAND_S,
    )
    text = done.stdout.decode(encoding)
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False), done.stderr
    assert any(sign in text for sign in ("°", r"\u00b0", "²", r"\u00b2"))


def test_the_parts_of_a_live_run_write_in_the_encoding_that_is_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The environment names another encoding than the console of this process."""
    monkeypatch.setenv("PYTHONIOENCODING", "gbk")
    with plant_thread() as port:
        command = run_command(port, tmp_path, "--events", "json", "--language", "zh")
        with Process("controller", command) as controller:
            event = json.loads(controller.next_line(WAIT_S) or "{}")
    assert event["text"] == "已停止"
