"""Plots of recordings: window, units, and markers for alarms and faults."""

from __future__ import annotations

import argparse
import io
import re
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from plant_sim.cli.main import main
from plant_sim.cli.options.plot import add_arguments
from plant_sim.common.figure_style import STYLE
from plant_sim.faults import parse_fault
from plant_sim.scope.plot import plot
from plant_sim.scope.store import TIME, Recording, RecordingWindow
from plant_sim.scope.style import marks_of, spans_of
from plant_sim.scope.timing import default_tags, timing_diagram
from plant_sim.scope.trends import default_panels, trend_plot
from plant_sim.scope.window import selected_window
from tests.plant_sim.scope.scope_rig import MACHINE, fill, new_plant, record_trial

LEAK = "leak:right.claws.plus=1e-09"


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("plot") / "trial.parquet"
    record_trial(path, parse_fault(f"{LEAK}@25s..26s"))
    return Recording(path)


def labels_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].get_yticklabels()]


def texts_of(figure: Figure) -> str:
    return " ".join(text.get_text() for axes in figure.axes for text in axes.texts)


def curve_of(line: Line2D) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def timing_of(recording: Recording, side: str) -> Figure:
    window = selected_window(recording, None, None, side=side)
    data = recording.read(default_tags(recording, side), window)
    return timing_diagram(data, recording.labels, "")


# --- window ------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_default_is_the_second_full_cycle_of_the_arm(trial: Recording, side: str) -> None:
    step = f"step.{side}_arm"
    data = trial.read([step])
    began = (data[step][1:] == "approach row") & (data[step][:-1] != "approach row")
    starts_ms = data[TIME][1:][began]
    assert len(starts_ms) == 3
    window = selected_window(trial, None, None, side=side)
    assert starts_ms[1] - 300 <= window.from_ms <= starts_ms[1]
    assert starts_ms[2] <= window.to_ms <= starts_ms[2] + 300


def test_a_recording_without_a_cycle_is_shown_completely(tmp_path: Path) -> None:
    fill(new_plant(), tmp_path / "run.parquet", samples=6)
    assert selected_window(Recording(tmp_path / "run.parquet"), None, None, side="left") == RecordingWindow(0, 50)


def test_times_require_a_unit_and_are_clipped_to_the_recording(trial: Recording) -> None:
    assert selected_window(trial, "12s", "20500ms", side="left") == RecordingWindow(12_000, 20_500)
    assert selected_window(trial, "12s", None, side="left") == RecordingWindow(12_000, trial.full_window.to_ms)
    assert selected_window(trial, None, "1 h", side="left") == trial.full_window


# --- lanes -----------------------------------------------------------------------------------------


@given(st.lists(st.sampled_from(["a", "b", ""]), min_size=1, max_size=30))
def test_spans_are_contiguous_and_match_every_sample(texts: list[str]) -> None:
    time_s = np.arange(len(texts)) / 100
    spans = spans_of(time_s, np.array(texts, dtype=object))
    assert spans[0][0] == 0.0
    assert spans[-1][1] == time_s[-1]
    assert all(one[1] == other[0] and one[2] != other[2] for one, other in pairwise(spans))
    for at_s, text in zip(time_s, texts, strict=True):
        assert text in [value for from_s, to_s, value in spans if from_s <= at_s <= to_s]


def test_each_of_several_alarms_is_marked_from_start_to_end() -> None:
    texts = ["", "a", "a; b", "a; b", "b", ""]
    data = {"alarms": np.array(texts, dtype=object), "faults": np.array([""] * 6, dtype=object)}
    marks = marks_of(np.arange(6.0), data)
    assert [(mark.kind, mark.text, mark.from_s, mark.to_s) for mark in marks] == [
        ("alarms", "a", 1.0, 4.0),
        ("alarms", "b", 2.0, 5.0),
    ]


def test_the_timing_diagram_shows_one_arm_its_steps_in_order_and_the_other_arms_step(trial: Recording) -> None:
    labels = labels_of(timing_of(trial, "left"))
    steps = ["wait at feed", "approach row", "lift from row", "slide to feed", "spread", "open claws", "converge"]
    assert [label for label in labels if label in steps] == steps
    wires = ["lift extend  Y1", "slide inward  Y5", "claws close  Y16", "lift down  X1", "cup pulse  X22"]
    assert [label for label in labels if label in wires] == wires
    assert labels.index("Left arm") < labels.index("slide inward  Y5") < labels.index("Right arm")
    assert labels[-2:] == ["Right arm", "step"]
    assert "slide inward  Y7" in labels_of(timing_of(trial, "right"))


def test_constant_wires_are_listed_below_instead_of_drawn(trial: Recording) -> None:
    figure = timing_of(trial, "left")
    note = figure.texts[-1].get_text()
    assert note.startswith("Unchanged: ")
    assert "slide at pick 3  X10" in note
    assert "slide at pick 3  X10" not in labels_of(figure)
    assert "slide at pick 2  X7" in labels_of(figure)


def test_the_list_of_constant_tags_is_inside_the_picture(trial: Recording) -> None:
    names = default_tags(trial, "left")
    data = trial.read(names, RecordingWindow(18_000, 18_500))
    with mpl.rc_context(STYLE):
        figure = timing_diagram(data, trial.labels, "")
        figure.savefig(io.BytesIO())
    note = figure.texts[-1]
    lines = note.get_text().split("\n")
    assert len(lines) > 1
    wires = [name for name in names if name in trial.labels]
    still = [trial.labels[name] for name in wires if len(set(data[name])) == 1]
    named = " ".join(lines).removeprefix("Unchanged: ").split(", ")
    assert [name.split()[-1] for name in named if name.split()[-1] in still] == still
    assert note.get_window_extent().y0 >= 0
    assert note.get_window_extent().y1 < figure.axes[0].xaxis.label.get_window_extent().y0
    assert note.get_window_extent().x1 < figure.bbox.width
    assert all(re.search(r"(,|[XY]\d+)$", line) for line in lines), "broken within a name"


def test_the_state_is_written_as_on_the_panel(trial: Recording) -> None:
    data = trial.read(["state"], RecordingWindow(18_000, 19_000))
    assert texts_of(timing_diagram(data, trial.labels, "", requested=list(data))) == "Execute"


def test_the_title_names_the_contents(trial: Recording, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    titles: list[str] = []

    def saved(figure: Figure, *_: object) -> list[Path]:
        titles.append(figure.texts[0].get_text())
        return []

    monkeypatch.setattr("plant_sim.scope.plot.save", saved)
    window = RecordingWindow(18_000, 19_000)
    plot(trial, tmp_path, window, side="left", tags=None)
    plot(trial, tmp_path, window, side="left", tags=["left.slide.*.pressure_pa", "y.left.slide_inward"])
    assert titles == [
        f"trial: {what}, 18 to 19 s, seed {trial.about['seed']}"
        for what in ("timing", "positions and pressures", "timing", "selected tags")
    ]


def test_a_coil_is_drawn_high_exactly_while_it_was_on(trial: Recording) -> None:
    data = trial.read(["y.left.slide_inward"], RecordingWindow(14_000, 32_000))
    figure = timing_diagram(data, trial.labels, "", requested=list(data))
    (wave,) = figure.axes[0].get_lines()
    times_s, levels = curve_of(wave)
    assert (times_s[0], times_s[-1]) == (14.0, 32.0)
    high = min(levels)  # the axis points down
    edges = np.flatnonzero(np.diff(data["y.left.slide_inward"].astype(int))) + 1
    assert len(edges) >= 2
    assert sorted(set(times_s[1:-1])) == [data[TIME][edge] / 1000 for edge in edges]
    for (from_s, level), (to_s, end) in pairwise(zip(times_s, levels, strict=True)):
        if from_s != to_s:
            row = np.searchsorted(data[TIME], 500 * (from_s + to_s), "right") - 1
            assert level == end
            assert (level == high) == data["y.left.slide_inward"][row]


def test_a_wire_that_is_on_at_both_ends_of_the_window_is_drawn_high_to_both(trial: Recording) -> None:
    data = {TIME: np.arange(0, 100, 10), "x.left.lift_up": np.array([True] * 3 + [False] * 4 + [True] * 3)}
    figure = timing_diagram(data, trial.labels, "", requested=list(data))
    _, levels = curve_of(figure.axes[0].get_lines()[0])
    high, low = min(levels), max(levels)  # the axis points down
    assert levels.tolist() == [high, high, low, low, high, high]


def test_a_requested_tag_has_a_lane_even_if_empty(trial: Recording) -> None:
    requested = ["alarms", "step.left_homing", "x.stop", "y.tray_run"]
    data = trial.read([*requested, "faults"], RecordingWindow(18_000, 19_000))
    labels = labels_of(timing_diagram(data, trial.labels, "", requested=requested))
    assert labels == ["Machine", "alarms", "tray run  Y0", "stop  X24", "Left arm", "left homing"]


def test_a_fault_is_named_and_marked_in_both_pictures(trial: Recording) -> None:
    window = RecordingWindow(24_000, 28_000)
    data = trial.read(default_tags(trial, "left"), window)
    timing = timing_diagram(data, trial.labels, "")
    panels = default_panels(trial)
    columns = [trace.column for panel in panels for trace in panel.traces]
    trends = trend_plot(panels, trial.read([*columns, "alarms", "faults"], window), "")
    assert "fault" in labels_of(timing)
    for figure in (timing, trends):
        assert texts_of(figure).count(LEAK) == 1
        for axes in figure.axes:
            assert 25.0 in [times_s[0] for times_s, _ in map(curve_of, axes.get_lines()) if len(set(times_s)) == 1]


# --- panels ----------------------------------------------------------------------------------------


def test_positions_are_drawn_in_millimetres_and_pressures_as_gauge(trial: Recording) -> None:
    panels = default_panels(trial)
    columns = [trace.column for panel in panels for trace in panel.traces]
    data = trial.read([*columns, "alarms", "faults"], RecordingWindow(12_000, 30_000))
    figure = trend_plot(panels, data, "")
    by_name = {axes.get_ylabel(): axes for axes in figure.axes}
    assert list(by_name) == [
        "slide position\n(mm)",
        "slide chambers\n(MPa gauge)",
        "lift extension\n(mm)",
        "lift chambers\n(MPa gauge)",
        "claw opening\n(mm)",
        "claw chambers\n(MPa gauge)",
        "belt travel\n(mm)",
        "supply\n(MPa gauge)",
    ]
    drawn = {line.get_color(): curve_of(line)[1] for line in by_name["slide position\n(mm)"].get_lines()[:2]}
    np.testing.assert_allclose(drawn["#0072B2"], 1000 * data["left.slide.position_m"])
    np.testing.assert_allclose(drawn["#D55E00"], 1000 * data["right.slide.position_m"])
    supply = {line.get_color(): curve_of(line)[1] for line in by_name["supply\n(MPa gauge)"].get_lines()}
    manifold = supply["#009E73"]
    np.testing.assert_allclose(manifold, (data["air.network.manifold.pressure_pa"] - 101_325) / 1e6)
    assert np.median(manifold) == pytest.approx(0.5, abs=0.01)
    assert by_name["lift extension\n(mm)"].yaxis_inverted()
    assert {axes.get_xlim() for axes in figure.axes} == {(12.0, 30.0)}
    assert figure.axes[-1].get_xlabel() == "plant time (s)"


def test_the_bands_are_the_ranges_in_which_the_switches_are_on(trial: Recording) -> None:
    panels = {panel.title: panel for panel in default_panels(trial)}
    bands = {level.label: (level.low, level.high) for level in panels["slide position"].levels}
    band_m = MACHINE.slide.switch_band_m
    assert bands.keys() == {"feed", "pick 1", "pick 2", "pick 3"}
    assert bands["pick 2"] == pytest.approx((MACHINE.picks_m[1] - band_m, MACHINE.picks_m[1] + band_m))
    data = trial.read(["left.slide.position_m", "x.left.slide_at_pick_2"])
    standing = np.abs(np.gradient(data["left.slide.position_m"])) < 1e-7
    low, high = bands["pick 2"]
    inside = (data["left.slide.position_m"] > low) & (data["left.slide.position_m"] < high) & standing
    assert data["x.left.slide_at_pick_2"][inside].all()
    assert inside.any()
    assert [level.label for level in panels["lift extension"].levels] == ["up", "down"]


# --- the command -----------------------------------------------------------------------------------


def run(recording: Recording, out: Path, *arguments: str) -> int:
    return main(["plot", str(recording.path), "--out", str(out), *arguments])


def pictures(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.suffix in {".png", ".svg"})


def test_the_command_writes_both_plots_in_both_formats_and_prints_their_paths(
    trial: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    assert run(trial, out) == 0
    names = ["trial-timing.png", "trial-timing.svg", "trial-trends.png", "trial-trends.svg"]
    assert pictures(out) == names
    assert capsys.readouterr().out.splitlines()[:4] == [str(out / name) for name in names]
    assert (out / "trial-timing.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.nightly
def test_the_same_recording_gives_the_same_bytes_without_a_date(trial: Recording, tmp_path: Path) -> None:
    window = RecordingWindow(18_000, 20_000)
    pictures = []
    for name in ("one", "other"):
        paths = plot(trial, tmp_path / name, window, side="left", tags=["y.left.*", "left.slide.position_m"])
        pictures.append({path.name: path.read_bytes() for path in paths})
    assert pictures[0] == pictures[1]
    assert len(pictures[0]) == 4
    for name, picture in pictures[0].items():
        assert b"<dc:date>" not in picture
        assert not re.search(rb"20[23]\d-\d\d-\d\d", picture), name


def test_selected_tags_are_split_into_lanes_and_curves(trial: Recording, tmp_path: Path) -> None:
    assert run(trial, tmp_path, "--from", "18s", "--to", "19s", "--tags", "*.claws.plus.chamber.pressure_pa") == 0
    assert pictures(tmp_path) == ["trial-trends.png", "trial-trends.svg"]
    assert run(trial, tmp_path / "lanes", "--from", "18s", "--to", "19s", "--tags", "step.*", "y.tray_*") == 0
    assert pictures(tmp_path / "lanes") == ["trial-timing.png", "trial-timing.svg"]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--tags", "left.slide.positon_m"], "no column left.slide.positon_m; did you mean left.slide.position_m?"),
        (["--tags", "seedlings"], "seedlings cannot be plotted; specify other tags"),
        (
            ["--from", "20s", "--to", "12s"],
            "--from 20000 ms --to 12000 ms: the window is empty; --from must be less than --to",
        ),
        (["--from", "5000s"], "the window is empty; --from must be less than --to"),
        (["--from", "5000s", "--to", "6000s"], "contains fewer than two samples"),
        (["--from", "12"], "--from '12': a time requires a unit; write 12 s or 12 ms"),
        (["--to", "soon"], "--to 'soon': not a number"),
    ],
)
def test_tags_and_windows_that_cannot_be_plotted_are_rejected_in_one_line(
    trial: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    assert run(trial, tmp_path / "out", *arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert complaint in line
    assert not (tmp_path / "out").exists()


def test_invalid_files_are_rejected_in_one_line(
    trial: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("no recording")
    for arguments, complaint in [
        (["plot", str(tmp_path / "none.parquet")], "none.parquet: file not found; use a recording"),
        (["plot", str(tmp_path / "file")], "file: not a recording of the plant; create one with --record"),
        (["plot", str(trial.path), "--out", str(tmp_path / "file")], "file: is not a writable folder (File exists)"),
    ]:
        assert main(arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert complaint in line


def test_by_default_the_plots_are_written_next_to_the_recording() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = parser.parse_args(["run/trial.parquet"])
    assert (options.out, options.start, options.end, options.arm, options.tags) == (None, None, None, "left", None)
