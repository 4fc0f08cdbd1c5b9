"""Expectations of a stimulus file, scans with changes, and the timing diagram of a run."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from controller.cli.main import main as controller
from controller.fx.drawing.timing_diagram import draw_timing
from controller.fx.stimulus.expectations import unmet
from controller.fx.stimulus.stimulus import ExpectedValues, StimulusError, WatchedDevice, load_stimulus

SEAL_IN = "LD X0\nOR Y0\nANI X1\nOUT Y0\nLD Y0\nOUT T0 K5\nLDP X0\nINC D0\nEND\n"
STIMULUS = """\
scan_ms: 100
scans: 12
inputs:
  - {at_ms: 100, set: {X0: 1}}
  - {at_ms: 300, set: {X0: 0}}
  - {at_ms: 900, set: {X1: 1}}
watch: [Y0, TN0]
"""
Y0, Y1, D0 = WatchedDevice("Y", 0), WatchedDevice("Y", 1), WatchedDevice("D", 0)
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    program, stimulus = tmp_path / "seal_in.il", tmp_path / "s.yaml"
    program.write_text(SEAL_IN, encoding="utf-8")
    stimulus.write_text(STIMULUS, encoding="utf-8")
    return program, stimulus


def expecting(stimulus: Path, *entries: str) -> None:
    lines = "".join(f"  - {entry}\n" for entry in entries)
    stimulus.write_text(f"{STIMULUS}expect:\n{lines}", encoding="utf-8")


def ladder_run(files: tuple[Path, Path], *options: str) -> int:
    return controller(["ladder", "run", str(files[0]), "--stimulus", str(files[1]), *options])


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ("{at_ms: 100, values: {Y0: 1, D0: 1}}", None),
        ("{at_ms: 99, values: {Y0: 1, D0: 1}}", "at 0 ms Y0 is 0, must be 1, D0 is 0, must be 1"),
        ("{at_ms: 199, values: {TN0: 0}}", None),
        ("{at_ms: 200, values: {TN0: 0}}", "at 200 ms TN0 is 1, must be 0"),
        ("{from_ms: 100, to_ms: 899, values: {Y0: 1}}", None),
        ("{from_ms: 100, to_ms: 900, values: {Y0: 1}}", "at 900 ms Y0 is 0, must be 1"),
        ("{from_ms: 99, to_ms: 800, values: {Y0: 1}}", "at 0 ms Y0 is 0, must be 1"),
        ("{from_ms: 0, to_ms: 600, reach: {T0: 1}}", None),
        ("{from_ms: 0, to_ms: 599, reach: {T0: 1}}", "from 0 to 599 ms no scan has T0 = 1"),
        ("{from_ms: 0, to_ms: 1100, reach: {T0: 1, X0: 1}}", "from 0 to 1100 ms no scan has T0 = 1, X0 = 1"),
    ],
)
def test_an_expectation_is_met_or_named_with_its_line(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str], entry: str, reason: str | None
) -> None:
    expecting(files[1], "{at_ms: 0, values: {Y0: 0}}", entry)
    assert ladder_run(files) == (0 if reason is None else 1)
    lines = capsys.readouterr().out.splitlines()
    if reason is not None:
        assert lines[-2] == f"{files[1]}:10: {reason}"
    assert lines[-1] == f"{1 if reason else 2} of 2 expectations met"


def test_only_watched_devices_are_traced(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    expecting(files[1], "{at_ms: 100, values: {D0: 2}}")
    assert ladder_run(files, "--json") == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["unmet"] == [f"{files[1]}:9: at 100 ms D0 is 1, must be 2"]
    assert set(answer["scans"][0]) == {"ms", "Y0", "TN0"}


def test_a_run_without_expectations_has_none(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert ladder_run(files, "--json") == 0
    assert set(json.loads(capsys.readouterr().out)) == {"scans"}


def test_an_expectation_of_an_empty_span_of_scans_concerns_the_scan_before_it() -> None:
    records = [{"ms": 0, "Y0": 0}, {"ms": 100, "Y0": 1}]
    assert unmet([ExpectedValues("f:1", 10, 20, {Y0: 0})], records) == []
    assert unmet([ExpectedValues("f:1", 10, 20, {Y0: 1}, once=True)], records) == [
        "f:1: from 10 to 20 ms no scan has Y0 = 1"
    ]


@pytest.mark.parametrize(
    ("entry", "complaint"),
    [
        ("{values: {Y0: 1}}", "is not one scan or one span"),
        ("{at_ms: 0, from_ms: 0, to_ms: 9, values: {Y0: 1}}", "is not one scan or one span"),
        ("{from_ms: 0, values: {Y0: 1}}", "is not one scan or one span"),
        ("{at_ms: 0, reach: {Y0: 1}}", "is not one scan or one span"),
        ("{at_ms: 0}", "needs either values or reach"),
        ("{from_ms: 0, to_ms: 9, values: {Y0: 1}, reach: {Y0: 1}}", "needs either values or reach"),
        ("{from_ms: 9, to_ms: 0, values: {Y0: 1}}", "ends at 0 ms, before it starts"),
        ("{at_ms: 1101, values: {Y0: 1}}", "1101 is outside the run"),
        ("{at_ms: 0, values: {Y8: 1}}", "Y8 has a digit 8 or 9"),
        ("{at_ms: 0, values: {Y0: 2}}", "2 is out of range"),
        ("{at_ms: 0, vales: {Y0: 1}}", "unknown key; did you mean values?"),
    ],
)
def test_an_invalid_expectation_is_named_with_its_line(files: tuple[Path, Path], entry: str, complaint: str) -> None:
    expecting(files[1], entry)
    with pytest.raises(StimulusError, match=re.escape(complaint)) as error:
        load_stimulus(files[1])
    (line,) = str(error.value).splitlines()
    assert line.startswith(f"{files[1]}:9: expect[1]")


def test_only_scans_with_changes_are_printed(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert ladder_run(files, "--changes", "--json") == 0
    scans = json.loads(capsys.readouterr().out)["scans"]
    assert [scan["ms"] for scan in scans] == [0, 100, 200, 300, 400, 500, 600, 900]
    assert ladder_run(files, "--changes") == 0
    assert len(capsys.readouterr().out.splitlines()) == 1 + len(scans)


def lanes(svg: str) -> dict[str, ET.Element]:
    root = ET.fromstring(svg)  # noqa: S314 - written by this test
    return {group.attrib["data-device"]: group for group in root.iter(f"{SVG}g") if "data-device" in group.attrib}


def test_the_timing_diagram_shows_each_device_over_all_scans(files: tuple[Path, Path]) -> None:
    picture = files[0].with_suffix(".svg")
    assert ladder_run(files, "--changes", "--picture", str(picture)) == 0
    shown = lanes(picture.read_text(encoding="utf-8"))
    assert list(shown) == ["Y0", "TN0"]
    (signal,) = shown["Y0"].iter(f"{SVG}polyline")
    points = [tuple(map(float, point.split(","))) for point in signal.attrib["points"].split()]
    xs, ys = [x for x, _ in points], [y for _, y in points]
    from_x, scale = xs[0], (xs[-1] - xs[0]) / 1_200
    assert [round((x - from_x) / scale) for x in xs] == [0, 100, 100, 900, 900, 1200]
    assert ys[2] == ys[3] < ys[0] == ys[1] == ys[4] == ys[5], "on is above off"
    boxes = [round((float(box.attrib["x"]) - from_x) / scale) for box in shown["TN0"].iter(f"{SVG}rect")]
    assert boxes == [0, 200, 300, 400, 500, 600, 900]
    assert [text.text for text in shown["TN0"].iter(f"{SVG}text")] == ["0", "1", "2", "3", "4", "5", "0"]


def test_a_value_that_does_not_fit_its_box_is_omitted() -> None:
    records = [{"ms": ms, "D0": -32_768 + ms} for ms in range(1_000)]
    lane = lanes(draw_timing(records, "many"))["D0"]
    assert len(list(lane.iter(f"{SVG}rect"))) == 1_000
    assert not list(lane.iter(f"{SVG}text"))


@pytest.mark.parametrize("times", [[], [0, 0], [10, 0]])
def test_a_diagram_needs_increasing_times(times: list[int]) -> None:
    with pytest.raises(ValueError, match="increasing times"):
        draw_timing([{"ms": ms, "Y0": 0} for ms in times], "none")


@pytest.mark.parametrize("ms", [0, 7])
def test_one_scan_is_a_diagram(ms: int) -> None:
    assert set(lanes(draw_timing([{"ms": ms, "Y0": 1, "D0": 3}], "one"))) == {"Y0", "D0"}


@pytest.mark.parametrize("option", [["--changes"], ["--picture", "p.svg"]])
def test_a_live_program_has_no_trace(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str], option: list[str]
) -> None:
    assert controller(["ladder", "run", str(files[0]), "--serve-modbus", *option]) == 2
    assert f"{option[0]}: no effect on a live program" in capsys.readouterr().err


def test_a_picture_that_cannot_be_written_is_one_line(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert ladder_run(files, "--picture", str(files[0].parent / "no" / "p.svg")) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
