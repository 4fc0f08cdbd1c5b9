"""Command line of the plant, run in the test process: bad input is reported in one line, and nothing is started."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.common.stop_request import StopRequest
from plant_sim import __main__ as entry
from plant_sim.cli.main import main
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.scope.store import Recording
from tests.sampling import first_of

MACHINE_TEXT = DEFAULT_MACHINE.read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def _signal() -> Iterator[None]:
    """Restore the SIGTERM handler of the test process, which `main` replaces."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["trial", "--fault", "low_suply:supply=3bar"], "low_suply: unknown fault; did you mean low_supply?"),
        (["run", "--fault", "jammed:left.slid"], "jammed:left.slid: not a moving part; did you mean left.slide?"),
        (
            ["serve", "--fault", "leak:supply=5mm"],
            "leak:supply: '5mm': mm is a unit of another quantity; use m3/(s Pa)",
        ),
        (["trial", "--record", ""], "'.': not a file name"),
        (
            ["trial", "--record", "/no/such/folder/run.parquet"],
            "/no/such/folder/run.parquet: folder /no/such/folder does not exist; create it",
        ),
        (["trial", "--seed", "-1"], "--seed -1: must be 0 or more"),
        (["serve", "--planting-frequency", "nan"], "--planting-frequency nan: must be 0 to 300"),
        (["scenario", "no-such-story"], "no-such-story: unknown scenario; use one of"),
        (["plot", "/no/such/run.parquet"], "/no/such/run.parquet: file not found"),
        (["air", "/no/such/run.parquet"], "/no/such/run.parquet: file not found"),
        (["air", "--machine", "/no/such/machine.yaml"], "/no/such/machine.yaml: cannot be read"),
    ],
)
def test_invalid_input_is_one_line_and_exit_code_2(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(expected)
    assert printed.err.count("\n") == 1


@pytest.mark.parametrize("command", first_of(["trial", "scenario", "air"], 2))
def test_a_parameter_outside_a_rating_is_warned_about(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = tmp_path / "machine.yaml"
    machine.write_text(MACHINE_TEXT.replace("claw_pressure_mpa: {value: 0.40", "claw_pressure_mpa: {value: 0.75"))
    story = ["stuck-reed-switch"] if command == "scenario" else ["--trays", "1"]
    main([command, *story, "--machine", str(machine)])
    assert capsys.readouterr().err.startswith(
        "warning: crop.claw_pressure_mpa: 0.75 MPa is outside the rating of the MHC2 claws, 0.1 to 0.6 MPa\n"
    )


@pytest.mark.nightly
def test_a_trial_with_a_fault_is_recorded_with_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.parquet"
    fault = "stuck_off:left.lift_up@20s..21s"
    assert main(["trial", "--trays", "1", "--json", "--record", str(path), "--fault", fault]) == 0
    report = json.loads(capsys.readouterr().out)
    recording = Recording(path)
    data = recording.read(["faults", "x.left.lift_up"])
    broken = data["faults"] == "stuck_off:left.lift_up"
    assert data["time_ms"][broken].min() == 20_000
    assert data["time_ms"][broken].max() == 20_990
    assert not data["x.left.lift_up"][broken].any()
    assert data["time_ms"][-1] == pytest.approx(1_000 * report["simulated_s"], abs=20)
    assert main(["trial", "--trays", "1", "--record", str(path)]) == 2
    assert "already exists" in capsys.readouterr().err


@pytest.mark.parametrize(("given", "threads"), [(None, "1"), ("4", "4")])
def test_a_command_calculates_in_one_thread_unless_the_user_wants_more(
    given: str | None, threads: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[str] = []
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", given or "")
    if given is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")

    def command(*, stop: StopRequest) -> int:
        found.append(os.environ["OPENBLAS_NUM_THREADS"])
        return 0

    monkeypatch.setattr("plant_sim.cli.main.main", command)
    with StopRequest() as stop:
        assert entry._main(stop) == 0
    assert found == [threads]
