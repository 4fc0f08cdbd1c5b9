"""Command ``panel``: invalid options, the printed URL and a clean exit."""

from __future__ import annotations

import signal
import socket
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import httpx
import pytest

from controller.cli import panel
from controller.cli.options.panel import add_arguments
from controller.common.command_line import Parser
from controller.common.errors import InputError
from controller.hmi.panel.view.trend_file import APPLICATION
from tests.real_time import WAIT_S
from tests.sampling import first_of


def refused(tmp_path: Path, *given: str) -> str:
    parser = Parser()
    add_arguments(parser)
    with pytest.raises(InputError) as raised:
        panel.run(parser.parse_args(["--users", str(tmp_path / "users.json"), "--port", "0", *given]))
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_invalid_options_are_rejected(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("name,table,address\na,input,1\n")
    assert "use --allow-remote" in refused(tmp_path, "--host", "192.0.2.1")
    assert "must be used together" in refused(tmp_path, "--certificate", "a.pem")
    key = tmp_path / "key.pem"
    key.write_text("")
    for mode, problem in ((0o640, f"--key {key}: accessible to other users"), (0o600, "PEM files")):
        key.chmod(mode)
        assert problem in refused(tmp_path, "--certificate", str(tags), "--key", str(key))
    assert "must be used together" in refused(tmp_path, "--telemetry", "127.0.0.1:5020")
    assert "must be used together" in refused(tmp_path, "--telemetry-tags", str(tags))
    assert "specify a CSV file" in refused(tmp_path, "--telemetry-tags", str(tmp_path / "none.csv"))
    for where in ("5021", "host:", "host:0", "host:65536", "host:x"):
        assert refused(tmp_path, "--controller", where).startswith(f"--controller {where}: must be HOST:PORT")
    assert "0 to 65535" in refused(tmp_path, "--port", "65536")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert "choose another --port" in refused(tmp_path, "--port", str(port))
    assert "--host must be an address of this computer" in refused(tmp_path, "--host", "192.0.2.1", "--allow-remote")


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM]))
def test_the_panel_serves_without_a_controller_and_exits_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    given = ("--port", "0", "--users", str(tmp_path / "users.json"), "--controller", "127.0.0.1:1")
    with subprocess.Popen(
        [sys.executable, "-m", "controller", "panel", *given], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("panel at http://127.0.0.1:")
            url = line.removeprefix("panel at ").strip()
            assert httpx.get(f"{url}/api/me", timeout=WAIT_S).json() == {"level": "view", "first_run": True}
            process.send_signal(number)
            out, err = process.communicate(timeout=WAIT_S)
        finally:
            process.kill()
    assert (process.returncode, out, err) == (0, "", "")


def test_trends_of_a_newer_program_end_the_start_in_one_line(tmp_path: Path) -> None:
    trends = tmp_path / "trends.sqlite"
    with closing(sqlite3.connect(trends)) as db:
        db.executescript(f"CREATE TABLE later (id); PRAGMA application_id = {APPLICATION}; PRAGMA user_version = 9")
    before = trends.read_bytes()
    assert refused(tmp_path, "--trends", str(trends)).startswith(f"{trends}: schema 9 is newer than schema 0")
    assert trends.read_bytes() == before
