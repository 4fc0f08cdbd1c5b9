"""Recorder: exact storage of all data, without partial files."""

from __future__ import annotations

import json
import os
import resource
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from plant_sim.crop.seedling import Location
from plant_sim.faults import parse_fault
from plant_sim.scope.columns import columns_of, numbers_of
from plant_sim.scope.errors import RecordingError
from plant_sim.scope.store import TIME, Recording, RecordingWindow
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recording import recorded
from tests.plant_sim.scope.scope_rig import IO_MAP, MACHINE, SEED, fill, new_plant, record_trial, recorder

WHOLE_LINES = [
    f"{side}.{drive}.{port}.{part}.{what}"
    for side in ("left", "right")
    for drive in ("slide", "lift", "claws")
    for port in ("plus", "minus")
    for part in ("tube", "chamber")
    for what in ("pressure_pa", "temperature_k", "mass_kg")
]


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Twin]:
    path = tmp_path_factory.mktemp("scope") / "trial.parquet"
    twin = record_trial(path)
    return Recording(path), twin


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.parquet"


def one_line(error: pytest.ExceptionInfo[RecordingError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


# --- columns -------------------------------------------------------------------------------------


def test_every_line_of_every_cylinder_has_pressure_temperature_and_mass_of_tube_and_chamber() -> None:
    units = {column.name: column.unit for column in columns_of()}
    assert set(WHOLE_LINES) <= units.keys()
    assert units["left.slide.plus.tube.pressure_pa"] == "Pa"
    assert units["right.lift.minus.chamber.temperature_k"] == "K"
    assert units["left.slide.speed_m_s"] == "m/s"
    assert units["right.claws.valve.spool"] == "-"
    assert units["left.slide.decoupled"] == ""


def test_derived_and_internal_values_have_no_column() -> None:
    names = [column.name.rpartition(".")[2] for column in columns_of()]
    private = {"stiffness", "energy_j", "density_kg_m3", "volume_m3", "edge_s", "busy", "stirred", "plus_pending_s"}
    assert not private & set(names)


def test_columns_contain_the_values_of_the_record_that_they_name(path: Path) -> None:
    plant = new_plant()
    arm = plant.state[0]["arms"][1]
    with recorder(plant, path) as scope:
        arm["lift"]["minus"]["tube"]["pressure_pa"] = 123_456.789
        arm["slide"]["decoupled"] = 1
        scope.sample()
    data = Recording(path).read(["right.lift.minus.tube.pressure_pa", "right.slide.decoupled", "left.slide.decoupled"])
    assert data["right.lift.minus.tube.pressure_pa"].tolist() == [123_456.789]
    assert data["right.slide.decoupled"].tolist() == [True]
    assert data["left.slide.decoupled"].tolist() == [False]


def test_parameter_names_match_the_column_names() -> None:
    plant = new_plant()
    params = numbers_of(plant.params)
    assert params["right.lift.stroke_m"] == MACHINE.lift.stroke_m
    assert params["left.slide_switches.2.at_m"] == MACHINE.picks_m[1]


# --- contents of a recording ----------------------------------------------------------------------


@pytest.mark.parametrize("rows_per_group", [1, 3, 7, 100])
def test_every_sample_is_read_back_bit_for_bit_for_any_group_size(path: Path, rows_per_group: int) -> None:
    plant = new_plant()
    outputs = IO_MAP.safe_outputs()
    outputs[IO_MAP["left.slide_inward"].number] = True
    frames = []
    with recorder(plant, path, rows_per_group=rows_per_group) as scope:
        for _ in range(14):
            scope.sample()
            frames.append(plant.state.tobytes())
            plant.step(10, outputs)
    recording = Recording(path)
    stored = np.frombuffer(b"".join(frames), plant.state.dtype)
    data = recording.read([column.name for column in columns_of()])
    assert data[TIME].tolist() == list(range(0, 140, 10))
    for column in columns_of():
        np.testing.assert_array_equal(data[column.name], column.of(stored), err_msg=column.name)
    assert np.ptp(data["left.slide.plus.tube.pressure_pa"]) > 1e5


@pytest.mark.parametrize(
    "window",
    [
        RecordingWindow(0, 130),
        RecordingWindow(20, 20),
        RecordingWindow(25, 75),
        RecordingWindow(30, 59),
        RecordingWindow(100, 900),
    ],
)
def test_a_window_returns_the_samples_between_its_ends(path: Path, window: RecordingWindow) -> None:
    fill(new_plant(), path, samples=14, rows_per_group=3)
    data = Recording(path).read(["air.network.receiver.mass_kg"], window)
    assert data[TIME].tolist() == [at_ms for at_ms in range(0, 140, 10) if window.from_ms <= at_ms <= window.to_ms]
    assert len(data["air.network.receiver.mass_kg"]) == len(data[TIME])


def test_wires_are_recorded_by_logical_state_regardless_of_polarity(path: Path) -> None:
    plant = new_plant()
    assert IO_MAP["stop"].inverted
    outputs = IO_MAP.safe_outputs()
    with recorder(plant, path, outputs=lambda: outputs) as scope:
        scope.sample()
        plant.box.stop = True
        outputs[IO_MAP["right.lift_extend"].number] = True
        plant.step(10, outputs)
        scope.sample()
    recording = Recording(path)
    data = recording.read(["x.stop", "x.left.lift_down", "y.right.lift_extend", "y.left.lift_extend"])
    assert data["x.stop"].tolist() == [False, True]
    assert data["x.left.lift_down"].tolist() == [True, True]
    assert data["y.right.lift_extend"].tolist() == [False, True]
    assert data["y.left.lift_extend"].tolist() == [False, False]
    assert recording.labels["x.left.lift_down"] == "X1"
    assert {name for name in recording.names if name[:2] in ("x.", "y.")} == {
        f"{point.device.lower()}.{point.tag}" for point in (*IO_MAP.inputs, *IO_MAP.outputs)
    }


def test_a_recording_contains_every_scan_of_the_twin(path: Path) -> None:
    twin = Twin(seed=SEED, trays=1)
    seen = []
    twin.watch(lambda t: seen.append((t.now_ms, t.state.name, t.outputs(), t.active_steps(), t.plant.left.slide.x_m)))
    with recorded(twin, path, seed=SEED):
        twin.home()
        twin.start()
        twin.run_for(9_000)
    recording = Recording(path)
    wires = [name for name in recording.names if name.startswith("y.")]
    steps = [name for name in recording.names if name.startswith("step.")]
    data = recording.read([*wires, *steps, "state", "alarms", "left.slide.position_m"])
    assert data[TIME].tolist() == [at_ms for at_ms, *_ in seen]
    assert data["state"].tolist() == [state for _, state, *_ in seen]
    assert {"STOPPED", "IDLE", "EXECUTE"} <= set(data["state"])
    assert data["left.slide.position_m"].tolist() == [x_m for *_, x_m in seen]
    for row, (_, _, outputs, active, _) in enumerate(seen):
        assert {name[2:] for name in wires if data[name][row]} == outputs
        recorded_steps = {f"{name[5:].replace('_', ' ')}: {data[name][row]}" for name in steps if data[name][row]}
        assert recorded_steps == set(active)


def test_alarms_and_faults_are_recorded_from_their_scan_to_their_end(path: Path) -> None:
    twin = Twin(seed=SEED, trays=1)
    twin.plant.faults.add(parse_fault("stuck_off:left.lift_up@500ms..1200ms"))
    twin.plant.faults.add(parse_fault("leak:right.lift.plus=2e-9@1s.."))
    with recorded(twin, path, seed=SEED):
        twin.run_for(400)
        twin.press("emergency_stop", for_ms=300)
        twin.run_for(1_100)
    data = Recording(path).read(["alarms", "faults"])
    stuck, leak = "stuck_off:left.lift_up", "leak:right.lift.plus=2e-09"
    during = [stuck] * 50 + [f"{stuck}; {leak}"] * 20 + [leak] * 30
    assert data["faults"].tolist() == [""] * 50 + during
    first = data["alarms"].tolist().index("emergency_stop")
    assert 400 <= data[TIME][first] <= 430
    assert set(data["alarms"][:first]) == {""}


def test_a_recording_contains_its_metadata(trial: tuple[Recording, Twin]) -> None:
    about = trial[0].about
    assert about["seed"] == SEED
    assert about["sample_ms"] == 10
    assert about["parameters"] == json.loads(json.dumps(asdict(MACHINE)))
    assert about["make"]["left.slide.plus_area_m2"] == MACHINE.slide.area_m2
    assert about["versions"].keys() == {"python", "seedling-transplanter", "numpy", "numba", "pyarrow"}


def test_the_recorded_moves_end_at_the_final_location_of_every_seedling(trial: tuple[Recording, Twin]) -> None:
    recording, twin = trial
    places: dict[tuple[int, int, int], str] = {}
    landed = []
    data = recording.read(["seedlings"])
    for at_ms, moves in zip(data[TIME], data["seedlings"], strict=True):
        for move in moves:
            places[move["tray"], move["column"], move["cell"]] = move["place"]
            landed += [at_ms] if move["place"] == "in_cup" else []
    final = Counter(place.name.lower() for place in (plant.location for plant in twin.plant.seedlings))
    assert Counter(places.values()) == final
    assert final["in_cup"] == len(landed) > 60
    assert {plant for plant, place in places.items() if place == "in_cup"} == {
        (plant.tray, plant.column, plant.along) for plant in twin.plant.seedlings if plant.location is Location.IN_CUP
    }
    assert len(set(landed)) >= 6, "the rows land one after another"


def test_additional_tags_keep_their_type(path: Path) -> None:
    answers: Iterator[int] = iter(range(5))
    tags = {"n": lambda: next(answers), "half": lambda: 0.5, "on": lambda: True, "word": lambda: "yes"}
    fill(new_plant(), path, samples=5, rows_per_group=2, tags=tags)
    data = Recording(path).read([*tags])
    assert data["n"].tolist() == [0, 1, 2, 3, 4]
    assert data["half"].dtype == np.float64
    assert data["on"].dtype == np.bool_
    assert data["word"].tolist() == ["yes"] * 5


# --- sampling ------------------------------------------------------------------------


def test_samples_within_the_period_are_skipped_and_gaps_remain(path: Path) -> None:
    plant = new_plant()
    with recorder(plant, path, sample_ms=20) as scope:
        for for_ms in (5, 5, 5, 5, 5, 5, 10, 303, 17, 5):
            scope.sample()
            plant.step(for_ms, IO_MAP.safe_outputs())
        scope.sample()
    assert Recording(path).time_ms.tolist() == [0, 20, 40, 343, 360]


def test_rows_are_written_during_the_run(path: Path) -> None:
    plant = new_plant()
    sizes = []
    with recorder(plant, path, rows_per_group=50) as scope:
        for row in range(200):
            plant.step(10, IO_MAP.safe_outputs())
            scope.sample()
            if row % 50 == 49:
                sizes.append(path.with_name("run.parquet.part").stat().st_size)
    assert sizes[0] > 0
    assert sizes == sorted(set(sizes))
    assert pq.ParquetFile(path).metadata.num_row_groups == 4


# --- files ---------------------------------------------------------------------------------------


def test_the_file_has_its_final_name_only_once_complete(path: Path) -> None:
    with recorder(new_plant(), path) as scope:
        scope.sample()
        assert [each.name for each in path.parent.iterdir()] == ["run.parquet.part"]
    assert [each.name for each in path.parent.iterdir()] == ["run.parquet"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ZeroDivisionError])
def test_an_interrupted_run_leaves_a_complete_recording_of_its_samples(
    path: Path, interruption: type[BaseException]
) -> None:
    plant = new_plant()

    def interrupted() -> None:
        with recorder(plant, path) as scope:
            for _ in range(5):
                scope.sample()
                plant.step(10, IO_MAP.safe_outputs())
            raise interruption

    with pytest.raises(interruption):
        interrupted()
    assert Recording(path).time_ms.tolist() == [0, 10, 20, 30, 40]
    assert plant.seedlings.moves is None


def test_a_recording_without_samples_leaves_no_file(path: Path) -> None:
    with recorder(new_plant(), path):
        pass
    assert list(path.parent.iterdir()) == []


def test_a_closed_recorder_records_nothing(path: Path) -> None:
    plant = new_plant()
    with recorder(plant, path) as scope:
        scope.sample()
    plant.step(10, IO_MAP.safe_outputs())
    scope.sample()
    scope.close()
    assert Recording(path).time_ms.tolist() == [0]


def test_an_existing_recording_is_never_overwritten(path: Path) -> None:
    path.write_text("older")
    with pytest.raises(RecordingError) as error:
        recorder(new_plant(), path)
    assert one_line(error) == f"{path}: already exists; delete it or use another name"
    assert path.read_text() == "older"
    assert len(list(path.parent.iterdir())) == 1


def test_two_runs_never_write_the_same_recording(path: Path) -> None:
    plant = new_plant()
    with recorder(plant, path):
        with pytest.raises(RecordingError, match=r"run\.parquet\.part: already exists"):
            recorder(new_plant(), path)
        with pytest.raises(ValueError, match="already being recorded"):
            recorder(plant, path.with_name("other.parquet"))


def test_a_folder_with_a_name_of_another_locale(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"\xd2\xc6") / "run.parquet"
    path.parent.mkdir()
    fill(new_plant(), path, samples=2)
    assert Recording(path).full_window == RecordingWindow(0, 10)


@pytest.mark.parametrize("name", ["folder/run.parquet", "file/run.parquet"])
def test_a_path_without_a_folder_is_rejected_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    plant = new_plant()
    with pytest.raises(RecordingError) as error:
        recorder(plant, tmp_path / name)
    path = tmp_path / name
    assert one_line(error) == f"{path}: folder {path.parent} does not exist; create it or use another path"
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]
    assert plant.seedlings.moves is None


def test_a_full_disk_is_reported_in_one_line_and_leaves_no_file(path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, limits[1]))
        with pytest.raises(RecordingError) as error:
            fill(new_plant(), path, samples=20, rows_per_group=5)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert one_line(error) == f"{path}: cannot be written (File too large); free some disk space"
    assert list(path.parent.iterdir()) == []


# --- reading ---------------------------------------------------------------------------------------


def test_a_file_of_another_kind_is_rejected_in_one_line(path: Path) -> None:
    with pytest.raises(RecordingError) as error:
        Recording(path)
    assert one_line(error) == f"{path}: file not found; use a recording created with --record"
    path.write_text("time_ms\n0\n")
    with pytest.raises(RecordingError) as error:
        Recording(path)
    assert one_line(error) == f"{path}: not a recording of the plant; create one with --record"
    pq.write_table(pa.table({"time_ms": [0]}), path)
    with pytest.raises(RecordingError) as error:
        Recording(path)
    assert one_line(error) == f"{path}: not a recording of the plant; create one with --record"


def test_a_truncated_file_is_rejected_in_one_line(path: Path) -> None:
    fill(new_plant(), path, samples=5)
    os.truncate(path, path.stat().st_size // 2)
    with pytest.raises(RecordingError) as error:
        Recording(path)
    assert one_line(error).startswith(f"{path}: ")


def test_a_misspelt_column_is_reported_with_a_suggestion(path: Path) -> None:
    fill(new_plant(), path, samples=2)
    with pytest.raises(RecordingError) as error:
        Recording(path).read(["left.slide.positon_m"])
    assert one_line(error) == f"{path}: no column left.slide.positon_m; did you mean left.slide.position_m?"
    with pytest.raises(RecordingError) as error:
        Recording(path).matching(["y.left.*", "zzz*"])
    assert "valid columns are air.*, conveyor.*, faults, left.*" in one_line(error)


def test_patterns_return_columns_in_order_without_duplicates(path: Path) -> None:
    fill(new_plant(), path, samples=2)
    names = Recording(path).matching(["y.left.lift_*", "x.stop", "y.left.lift_retract"])
    assert names == ["y.left.lift_extend", "y.left.lift_retract", "x.stop"]
