"""Provenance of the results of every command, and the command that reproduces them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED, StopRequest
from plant_sim.cli.main import COMMAND_LINE, main
from plant_sim.cli.reproduce import comparison, recorded_run
from plant_sim.cli.reproduce.origin import FILES, OUTPUTS, WITHOUT_EFFECT
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.common.provenance import content
from plant_sim.line.file import LINES
from plant_sim.scenario.file import SCENARIOS
from tests.paths import ROOT
from tests.plant_sim.cli.results import BY_DEFAULT, CAMPAIGN, NIGHTLY, RESULTS, STUDY, TRIALS, WITHOUT, carried, parsers
from tests.sampling import first_of

Change = Callable[[dict[str, Any]], object]


def write(kind: str, folder: Path) -> Path:
    """Write a result of a kind and return its folder."""
    texts = {
        "CAMPAIGN.yaml": CAMPAIGN,
        "TRIALS.csv": TRIALS,
        "LADDER.il": "LD X000\nOUT Y000\nEND\n",
        "LINE.yaml": (LINES / "cabbage.yaml").read_text(encoding="utf-8"),
        "MACHINE.yaml": DEFAULT_MACHINE.read_text(encoding="utf-8") + "\n# ours\n",
        "SCENARIO.yaml": (SCENARIOS / "stuck-reed-switch.yaml").read_text(encoding="utf-8"),
        "STUDY.yaml": STUDY,
    }
    out, inputs = folder / "out", folder / "inputs"
    inputs.mkdir()
    for name, text in texts.items():
        (inputs / name).write_text(text, encoding="utf-8")
    words = RESULTS[kind].replace("IN/", f"{inputs}/").replace("OUT/", f"{out}/").split()
    if "RECORDING" in RESULTS[kind]:
        main(["trial", "--seedlings", "1", "--max-s", "3", "--record", str(inputs / "RECORDING.parquet")])
    assert main([*words, "--out", str(out)]) in {0, 1}
    shutil.rmtree(inputs)  # the folder of the result contains what is needed
    return out


def recorded(folder: Path) -> dict[str, Any]:
    """Return the content of ``provenance.json``."""
    found: dict[str, Any] = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that writes the result of a kind once, and returns its folder, which no test changes."""
    return cache(lambda kind: write(kind, tmp_path_factory.mktemp("result")))


@pytest.mark.parametrize("kind", first_of(RESULTS, BY_DEFAULT, nightly=NIGHTLY))
def test_every_file_carries_its_provenance_and_the_result_is_reproduced(
    kind: str, results: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No file but provenance.json contains a path, the host or the date; the files that the user gave are copied."""
    folder = results(kind)
    whole = recorded(folder)
    record = {key: whole[key] for key in ("command", "version", "code", "parameters", "seed", "settings")}
    written = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert written - {"provenance.json", "campaign.lock", *whole["given"].values()} == set(whole["files"])
    for name in whole["files"]:
        assert carried(folder / name, whole["identity"]) in (record, whole["identity"]), name
        for place in (folder.parent, ROOT):
            assert str(place).encode() not in (folder / name).read_bytes(), name
    capsys.readouterr()
    assert main(["reproduce", str(folder), "--out", str(tmp_path / "again")]) == 0
    assert capsys.readouterr().out.endswith(f"equal: {len(whole['files'])} files, byte for byte\n")


def test_every_command_with_a_folder_and_every_option_is_known() -> None:
    """A new command with --out has a result above; a new option that names a file is one that is read or written."""
    with_out, names, files = set(), set(), set()
    for command, own in parsers().items():
        for action in (each for parser in own for each in parser.arguments):
            names.add(action.dest)
            if action.type is Path:
                files.add(action.dest)
            if action.dest == "out":
                with_out.add(command)
    assert with_out == {command.partition(" ")[0] for command in RESULTS} | set(WITHOUT)
    assert files <= {*FILES, *OUTPUTS, "folder"}
    assert {*FILES, *OUTPUTS, *WITHOUT_EFFECT} - names == {"command", "stop"}
    assert set(recorded_run.REPRODUCED) == {command.partition(" ")[0] for command in RESULTS}


@pytest.fixture(scope="module")
def line_result(results: Callable[[str], Path]) -> Path:
    return results("line")


@pytest.fixture
def line(line_result: Path, tmp_path: Path) -> Path:
    """Copy of the result of a line, which a test may damage."""
    return shutil.copytree(line_result, tmp_path / "line")


def reproduce(folder: Path, change: Change | None = None) -> int:
    """Change ``provenance.json`` and reproduce the result beside it."""
    if change is not None:
        record = recorded(folder)
        change(record)
        (folder / "provenance.json").write_text(json.dumps(record), encoding="utf-8")
    return main(["reproduce", str(folder), "--out", str(folder.parent / "again")])


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda record: record.update(command="docs"), "command: 'docs' is not reproduced"),
        (lambda record: record.update(command="line; touch x"), "command: 'line; touch x' is not reproduced"),
        (lambda record: record.update(command="serve"), "command: 'serve' is not reproduced"),
        (lambda record: record.update(command="reproduce"), "command: 'reproduce' is not reproduced"),
        (
            lambda record: record.update(version="9.9"),
            f"version: is '9.9', but version {content.package_version()} is installed",
        ),
        (lambda record: record.update(code="0" * 32), "code: is '00000000000000000000000000000000', but the code"),
        (lambda record: record["settings"].update(out="../../x"), "settings: 'out' is not a setting"),
        (lambda record: record["settings"].update(record="x"), "settings: 'record' is not a setting"),
        (lambda record: record["settings"].update({"metres --out x": 1}), "settings: 'metres --out x' is not a"),
        (lambda record: record["settings"].update(metres="2 --out=x"), "--metres 2 --out=x: must be a number"),
        (lambda record: record["settings"].update(metres=10**9), "--metres 1000000000: must be"),
        (lambda record: record["settings"].update(metres=[2, {}]), "settings: metres {} must be a number or a text"),
        (lambda record: record["settings"].update(line="/etc/passwd"), "settings: line '/etc/passwd' must be the name"),
        (lambda record: record["settings"].update(profile="--help"), "settings: profile '--help' must be the name"),
        (lambda record: record["given"].update(line="given/line/../../../x"), "given: 'given/line/../../../x' is not"),
        (lambda record: record["given"].update(line="/etc/passwd"), "given: '/etc/passwd' is not a name of a file"),
        (lambda record: record["given"].update(out="given/out/x"), "given: out 'given/out/x' is not a file of"),
        (lambda record: record["files"].update({"../x": ""}), "files: '../x' is not a name of a file"),
        (lambda record: record["files"].update({"a\x1b[2J": ""}), "files: 'a\\x1b[2J' is not a name of a file"),
        (lambda record: record["environment"].update(numpy="\x1b[2J"), "environment: contains control characters"),
        (lambda record: record.update(interrupted=True), "interrupted: a signal ended the run"),
        (lambda record: record.pop("settings"), "settings: is missing or not an object"),
        (lambda record: record["parameters"].update(machine="0"), "machine.yaml: is not the file of the result"),
    ],
)
def test_a_foreign_or_hostile_provenance_is_refused_before_anything_runs(
    line: Path, capsys: pytest.CaptureFixture[str], change: Change, complaint: str
) -> None:
    before = sorted(path.name for path in line.parent.rglob("*"))
    assert reproduce(line, change) == 2
    printed = capsys.readouterr()
    assert complaint in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert sorted(path.name for path in line.parent.rglob("*")) == before


def test_words_of_a_shell_and_options_stay_texts() -> None:
    """A positional argument cannot begin like an option; the value of an option is a part of its word."""
    reader = recorded_run._Reader(Path("provenance.json"), {})
    study, trial = (parsers()[name][0] for name in ("study", "trial"))
    fault = "$(touch x); --out=y"
    assert reader._arguments(trial, {"fault": [fault], "wait": True}, {}) == [f"--fault={fault}", "--wait"]
    with pytest.raises(InputError, match="name '--out=y' begins like an option"):
        reader._arguments(study, {"name": "--out=y"}, {})


def test_a_run_in_real_time_and_a_foreign_controller_are_not_reproduced(
    line: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command, name in (("run", "fast"), ("hil", "way")):
        assert reproduce(line, lambda record, command=command: record.update(command=command)) == 2  # type: ignore[misc]
        assert f"settings: {name} is not" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["trial", "run --fast"])
def test_an_interrupted_trial_is_not_reproduced(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "result"
    with StopRequest() as stop:
        stop.set()
        assert main([*command.split(), "--out", str(folder)], stop) == INTERRUPTED
    assert main(["reproduce", str(folder), "--out", str(tmp_path / "again")]) == 2
    assert "interrupted: a signal ended the run" in capsys.readouterr().err


def test_a_damaged_copy_of_the_parameters_is_refused(line: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = line / "given" / "line" / "LINE.yaml"
    copy.write_text(copy.read_text(encoding="utf-8").replace("spacing: 42 cm", "spacing: 43 cm") + "\n", "utf-8")
    assert reproduce(line) == 2
    assert f"{copy}: is not the file of the result, whose checksum differs" in capsys.readouterr().err


def test_a_damaged_result_is_told(line: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also if its checksum in provenance.json has been changed as well."""
    table = line / "plants.csv"
    table.write_text(table.read_text(encoding="utf-8").replace("upright", "tilted", 1), encoding="utf-8")
    (line / "rows.svg").unlink()

    def forge(record: dict[str, Any]) -> None:
        record["files"]["plants.csv"] = content.content_hash(table.read_bytes())
        record["files"]["result.json"] = "0"

    assert reproduce(line, forge) == 1
    printed = capsys.readouterr().out
    assert "plants.csv: differs in line 2\n" in printed
    assert "result.json: was changed after it was written\n" in printed
    assert "rows.svg: is missing in the original result\n" in printed
    assert "plants.parquet: equal\n" in printed
    assert printed.endswith("DIFFERENT: 7 files, byte for byte\n")


def test_other_libraries_are_named_and_numbers_compared_within_the_tolerance(
    line: Path, line_result: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A last digit may differ; the sixth may not, nor may a text."""
    table = line / "plants.csv"
    text = table.read_text(encoding="utf-8")
    time_s = text.splitlines()[1].split(",")[2]

    def forge(record: dict[str, Any]) -> None:
        record["environment"]["numpy"] = "0.1"
        record["files"]["plants.csv"] = content.content_hash(table.read_bytes())

    def compared(changed: str) -> list[str]:
        table.write_text(changed, encoding="utf-8")
        record = recorded(line)
        forge(record)
        (line / "provenance.json").write_text(json.dumps(record), encoding="utf-8")
        run = recorded_run.read_run(line, COMMAND_LINE)
        return list(comparison.ResultComparison(run, line_result, is_exact=False).lines())

    near = compared(text.replace(time_s, repr(float(time_s) * (1 + 1e-8)), 1))
    assert near[0] == "plants.csv: equal within the tolerance"
    assert near[-1] == "equal: 7 files, numbers within 1e-06, or 1e-09 near zero"
    assert compared(text.replace("upright", "tilted", 1))[0] == "plants.csv: differs in its text"
    table.write_text(text.replace(time_s, repr(float(time_s) * (1 + 1e-5)), 1), encoding="utf-8")
    assert reproduce(line, forge) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("numpy: 0.1 then, ")
    assert f"plants.csv: differs: {float(time_s) * (1 + 1e-5)!r} then, {time_s} now\n" in printed


def test_an_existing_folder_is_never_written(line: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", str(line), "--out", str(line)]) == 2
    assert main(["reproduce", str(line), "--out", str(line / "a" / "b")]) == 2
    assert "exists; specify a new folder" in capsys.readouterr().err


def test_the_checksum_of_the_code_covers_code_and_data_with_any_line_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {name for name, _ in content.code_files()}
    assert {"plant_sim/machine.yaml", "plant_sim/line/run.py", "controller/program/machine.py"} <= names
    package = tmp_path / "package"
    package.mkdir()
    monkeypatch.setattr(content, "_PACKAGES", {"package": package})

    def of(**files: bytes) -> str:
        for name, text in files.items():
            (package / f"{name}.py").write_bytes(text)
        content.code_hash.cache_clear()
        return content.code_hash()

    first = of(a=b"x = 1\ny = 2\n")
    assert of(a=b"x = 1\r\ny = 2\r\n") == first
    assert of(a=b"x = 1\ny = 3\n") != first
    assert of(a=b"x = 1\ny = 2\n", b=b"") != first
    content.code_hash.cache_clear()


def test_numbers_near_zero_and_counts_are_compared() -> None:
    assert comparison.is_close(0.0, 1e-10)
    assert not comparison.is_close(5, 6)
    assert not comparison.is_close(1.0, 1.00001)
