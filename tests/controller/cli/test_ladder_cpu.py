"""Options ``--cpu`` and ``--modules``, files of GX Developer, and the sampling of the plant between two scans."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from controller.cli.main import main as controller
from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.iomap.loader import load_io_map
from plant_sim.cli.main import main as plant_sim
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.ladder.scan_timing import TrialClock
from tests.paths import ROOT

FX3U_PROGRAM = "LD X0\nOUT D100.F\nDEMOV E1.5 D0\nLD D100.F\nOUT T256 K15\nLD T256\nOUT Y0\nEND\n"
SHORT_RUN = "scan_ms: 10\nscans: 3\ninputs:\n  - {at_ms: 0, set: {X0: 1}}\nwatch: [TN256, D1, Y0]\n"


def written(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str], main: object = controller) -> str:
    """Return the one line of a refusal with exit code 2."""
    assert main(arguments) == 2  # type: ignore[operator]
    printed = capsys.readouterr()
    assert not printed.out
    (line,) = printed.err.splitlines()
    return line


def test_cpu_of_check_run_and_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program, stimulus = written(tmp_path, "a.il", FX3U_PROGRAM), written(tmp_path, "s.yaml", SHORT_RUN)
    assert controller(["ladder", "check", program, "--cpu", "fx3u"]) == 0
    assert "of 64000 steps" in capsys.readouterr().out
    assert controller(["ladder", "run", program, "--cpu", "fx3u", "--stimulus", stimulus, "--json"]) == 0
    scans = json.loads(capsys.readouterr().out)["scans"]
    assert [(scan["TN256"], scan["D1"], scan["Y0"]) for scan in scans] == [
        (0, 16320, 0),
        (10, 16320, 0),
        (15, 16320, 1),
    ]
    assert controller(["ladder", "draw", program, "--cpu", "fx3u", "--out", str(tmp_path / "pictures")]) == 0


def test_an_fx2n_is_the_default(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = written(tmp_path, "a.il", "LD X0\nOUT D100.F\nEND\n")
    assert "2:5: OUT D100.F: D100.F is a bit of a data register" in refused(["ladder", "check", program], capsys)
    assert "use --cpu fx3u" in refused(["trial", "--ladder", program], capsys, plant_sim)
    assert "specify it with --ladder" in refused(["trial", "--cpu", "fx3u"], capsys, plant_sim)


def test_modules_and_serial_line_in_the_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = ["LD M8002", "MOV H81 D8120", "TO K2 K5 K7 K1", "MOV H3241 D10", "SET M8122", "LD M8000"]
    text = "\n".join([*lines, "RS D10 K2 D20 K0", "END", ""])
    program, stimulus = written(tmp_path, "a.il", text), written(tmp_path, "s.yaml", SHORT_RUN.replace("TN256, ", ""))
    modules = written(tmp_path, "m.yaml", "modules:\n  - {position: 2, model: buffer}\n")
    assert controller(["ladder", "run", program, "--stimulus", stimulus, "--modules", modules, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["modules"] == {"2": {"5": 7}}
    assert record["serial"] == [{"ms": 3, "bytes": "41 32"}]
    wrong = written(tmp_path, "w.yaml", "modules:\n  - {position: 9, model: buffer}\n")
    arguments = ["run", program, "--stimulus", stimulus, "--modules"]
    assert f"{wrong}:2: modules[1].position: cannot be 9" in refused(["ladder", *arguments, wrong], capsys)
    missing = str(tmp_path / "none.yaml")
    assert "cannot be read" in refused(["trial", "--ladder", program, "--modules", missing], capsys, plant_sim)


def test_project_files_are_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = written(tmp_path, "line.gxw", "x")
    damaged = tmp_path / "MAIN.wpg"
    damaged.write_bytes(b"\x40\x00" + b"\x20" * 60)
    assert f"{damaged}:1:1: file: not the program part of a GX Developer project; use Write to CSV File" in refused(
        ["ladder", "check", str(damaged)], capsys
    )
    assert "GX Works2 project; open it in GX Works2 and use Write to CSV File" in refused(
        ["ladder", "check", project], capsys
    )


def test_the_plant_is_sampled_and_driven_between_two_scans() -> None:
    """The start button is counted at its millisecond; the output of the comparison reaches the plant before a scan."""
    io_map = load_io_map(ROOT / "io_map.yaml")
    module = IoModule(Plant(io_map, load_machine(), seed=1, trays=1), io_map)
    plc = FxPlc(read_il("LD M8000\nOUT C235 K9\nDHSCS K1 C235 Y0\nEND"))
    module.write_outputs(0, plc.scan(0, module.inputs())[: io_map.output_count])
    module.plant.box.start = True
    TrialClock(None, 0).advance(module, plc, 0, 10)
    assert module.plant.time_ms == 10
    assert plc.memory.CV[235] == 1
    assert module.outputs[0]
    assert plc.scans == 1
