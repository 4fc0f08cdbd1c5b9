"""The bench judges controllers over a serial line and over the MC protocol, with real processes; both take minutes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from xml.etree import ElementTree

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from scripts.benchmark.live.serial_cable import SerialCable
from tests.paths import ROOT
from tests.real_time import host_delay

LIMIT_S = 1_800
LINK_LIMIT_MS = 10_000
WATCHDOG_MS = 2 * LINK_LIMIT_MS
"""Time of the output watchdog of the plant, as in the field file: longer than the limit of the link, as it must be."""
ONE_STOP = ("--cases", "emergency stop", "--only", "left: lift_retract, loaded")

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(LIMIT_S + 60)]


@contextmanager
def running(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command of the project until the end of the block."""
    with subprocess.Popen(
        [sys.executable, "-m", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def verdicts(folder: Path) -> dict[str, int]:
    root = ElementTree.parse(folder / "reports" / "hil.xml").getroot()  # noqa: S314 - our own text
    return {name: int(root.get(name, "-1")) for name in ("tests", "failures", "skipped")}


def test_the_controller_over_a_serial_line(tmp_path: Path) -> None:
    """In lock step: a scan per exchange, whatever the speed of the computer."""
    io_map = load_io_map(DEFAULT_IO_MAP)
    with SerialCable() as cable, ExitStack() as stack:
        wires = "".join(f"      {point.tag}: {point.offset}\n" for point in (*io_map.inputs, *io_map.outputs))
        (tmp_path / "field.yaml").write_text(
            f"lines:\n  - {{name: bus, device: {cable.ends[1]}, baud: 115200, frame: 8N1}}\n"
            f"devices:\n  - name: plant\n    profile: coils\n    line: bus\n    timeout_ms: 5000\n"
            f"    watchdog_ms: {WATCHDOG_MS}\n    wires:\n{wires}",
            "utf-8",
        )
        serial = ("--serial", f"{cable.ends[0]}:115200:8N1:1")
        bench = stack.enter_context(
            running(
                tmp_path,
                *("plant_sim", "hil", "serve", "--port", "0", *serial, "--lock-step-ms", "10"),
                *("--watchdog-ms", str(WATCHDOG_MS), "--out", "reports"),
                *ONE_STOP,
            )
        )
        assert bench.stdout is not None
        assert "plant listening on" in bench.stdout.readline()
        stack.enter_context(
            running(
                tmp_path,
                *("controller", "run", "--field", "field.yaml", "--simulated-time", "--pace", "65535", "--no-hmi"),
                *("--no-history", "--retain", "retentive.json", "--new-machine"),
                *("--link-limit-ms", str(LINK_LIMIT_MS)),
            )
        )
        printed, _ = bench.communicate(timeout=LIMIT_S)
    assert bench.returncode == 0, printed
    assert verdicts(tmp_path) == {"tests": 6, "failures": 0, "skipped": 0}


@pytest.mark.real_time
def test_the_exported_program_over_the_mc_protocol(tmp_path: Path) -> None:
    """The exported FX program as a PLC with an MC server; the plant is its client, in real time.

    The limits are relative to the delay of the computer, because the bench judges the reaction of the PLC as well.
    """
    delay = host_delay()
    limits = {"--watchdog-ms": 500, "--timeout-ms": 1_000, "--stop-ms": 300}
    relative = [word for name, limit_ms in limits.items() for word in (name, str(delay.relative_ms(limit_ms)))]
    export = [sys.executable, "-m", "controller", "ladder", "export", "--target", "fx2n", "--out", "package"]
    subprocess.run(export, check=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True)
    text = (tmp_path / "package" / "transplanter.il").read_text("utf-8")
    moved = re.sub(r"\bX([0-7]+)\b", lambda found: f"M{7_000 + int(found[1], 8)}", text)  # as the profile asks
    (tmp_path / "moved.il").write_text(moved, "utf-8")
    with ExitStack() as stack:
        plc = stack.enter_context(
            running(
                tmp_path,
                *("controller", "ladder", "run", "moved.il", "--cpu", "fx3u", "--serve-mc", "3e", "--mc-port", "0"),
            )
        )
        assert plc.stdout is not None
        port = str(next(value for name, value in json.loads(plc.stdout.readline()).items() if name.endswith("port")))
        bench = stack.enter_context(
            running(
                tmp_path,
                *("plant_sim", "hil", "connect", "fx5u-slmp", "--host", "127.0.0.1", "--port", port),
                *("--listen-port", "0", *relative),
                *("--out", "reports", *ONE_STOP),
            )
        )
        printed, _ = bench.communicate(timeout=LIMIT_S)
    assert bench.returncode == 0, printed
    assert verdicts(tmp_path) == {"tests": 6, "failures": 0, "skipped": 0}
