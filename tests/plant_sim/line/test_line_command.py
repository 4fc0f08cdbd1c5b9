"""Command ``line``: results, files, reproducibility, invalid input, duration and one million cups."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from plant_sim.cli.main import main
from plant_sim.line.command import line_result
from plant_sim.line.file import lines
from plant_sim.line.result import LineResult
from plant_sim.line.write import COLUMNS, write_result
from plant_sim.machine.parameters import load_machine
from tests.sampling import first_of, one_in

NAMES = tuple(lines())
ROUGH = """\
acceleration: 0.3 m/s2
segments:
  - {speed: 1.0 km/h, over: 10 m}
  - {ramp_to: 1.3 km/h, over: 10 m}
  - {hill: 10 %, over: 5 m}
  - {stand: 8 s}
  - {speed: 0.9 km/h, over: 20 s}
slip: {mean: 5 %, sd: 3 %, patch: 1 m}
hill: {speed_loss: 1.5, slip_gain: 0.5}
"""


@pytest.fixture(autouse=True)
def _signal() -> Iterator[None]:
    """Restore the SIGTERM handler of the test process, which `main` replaces."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def result(name: str, metres: float = 30.0, seed: int = 1, profile: Path | None = None) -> LineResult:
    return line_result(name, profile=profile, metres=metres, seed=seed, machine=load_machine(), repeat=1)


@pytest.fixture(scope="module")
def pepper() -> LineResult:
    return result("pepper", 60.0)


@pytest.mark.parametrize("name", first_of(NAMES))
def test_every_cup_and_seedling_is_accounted_for(name: str, tmp_path: Path) -> None:
    """On level and rough ground, single + double + missing = released, and all other cups are in transit."""
    (tmp_path / "rough.yaml").write_text(ROUGH, encoding="utf-8")
    for profile in (None, tmp_path / "rough.yaml"):
        done = result(name, profile=profile)
        assert done.run.accounted
        assert sum(done.missing.values()) == sum(row.released - row.single - row.double for row in done.rows)
        for row, fed in zip(done.rows, done.run.fed, strict=True):
            assert row.released > 50
            assert row.in_transit > 0
            assert row.released + row.in_transit == len(fed.seedlings)


@pytest.mark.parametrize("name", first_of(NAMES))
def test_the_same_seed_gives_the_same_plants(name: str) -> None:
    first, second, other = (result(name, 20.0, seed=seed) for seed in (3, 3, 4))
    assert first.record() == second.record()
    for row, same, different in zip(first.rows, second.rows, other.rows, strict=True):
        assert np.array_equal(row.position_m, same.position_m, equal_nan=True)
        assert not np.array_equal(row.position_m[:40], different.position_m[:40], equal_nan=True)


def test_a_stop_does_not_lose_or_repeat_a_plant(tmp_path: Path) -> None:
    """The spacing depends on the wheel only, so stops do not change the releases."""
    text = "segments:\n  - {speed: 1.08 km/h, over: 15 m}\n  - {stand: 20 s}\n"
    (tmp_path / "stops.yaml").write_text(text, encoding="utf-8")
    done = result("pepper", 35.0, profile=tmp_path / "stops.yaml")
    assert done.missing["missed_cup"] == 0
    assert list(done.stops) == pytest.approx([2, 40.0])
    assert " s, of which 40 s at 2 stops" in done.text()
    for row in done.rows:
        assert np.diff(row.travel_m) == pytest.approx(0.4 * 0.95, rel=1e-9)  # set for 5 %, no slip present
    assert done.duration_s > 35 / 0.3 + 2 * 20


@pytest.mark.nightly
def test_the_arms_plant_more_than_hands(pepper: LineResult) -> None:
    """45 plants per minute in each of two rows are 5,400 per hour, less the missing plants."""
    missed = pepper.rates["missed"].percent / 100
    assert pepper.plants_per_h == pytest.approx(5400 * (1 - missed), rel=0.02)
    assert "x the 2,500 to 3,000 plants/h fed by hand" in pepper.text()


@pytest.mark.nightly
def test_the_text_lists_what_is_assumed_and_why_plants_are_missing(pepper: LineResult) -> None:
    text = pepper.text()
    released = sum(row.released for row in pepper.rows)
    missing = sum(pepper.missing.values())
    assert f"released {released} = single {released - missing} + double 0 + missing {missing}; in transit" in text
    assert "nozzle.fall 0.2 s" in text
    assert f"P {pepper.missing['P']}, D {pepper.missing['D']}" in text


@pytest.fixture(scope="module")
def written(pepper: LineResult, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the files of a result, in one folder."""
    return write_result(pepper, tmp_path_factory.mktemp("written"))


@pytest.mark.nightly
def test_a_folder_with_a_name_of_another_locale(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"\xd2\xc6")
    folder.mkdir()
    _, table, *_ = write_result(result("pepper"), folder)
    with table.open("rb") as file:
        assert tuple(pq.read_table(file).column_names) == COLUMNS


@pytest.mark.nightly
def test_csv_and_parquet_contain_the_same_plants(pepper: LineResult, written: list[Path]) -> None:
    assert [path.name for path in written] == [
        "plants.csv", "plants.parquet", "rows.png", "rows.svg", "rows.data.csv", "result.json",
    ]  # fmt: skip
    folder = written[0].parent
    table = pq.read_table(folder / "plants.parquet")
    assert tuple(table.column_names) == COLUMNS
    with (folder / "plants.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == table.num_rows == sum(row.released for row in pepper.rows)
    for name in ("position_m", "time_s", "depth_m", "spacing_m"):
        values = [None if row[name] == "" else float(row[name]) for row in rows]
        assert values == table.column(name).to_pylist()
    causes = [row["missing"] for row in rows if row["missing"]]
    assert {name: causes.count(name) for name in pepper.missing} == pepper.missing
    for name in ("missing", "stand"):
        assert [row[name] or None for row in rows] == table.column(name).to_pylist()
    first = next(row for row in rows if row["spacing_m"])
    before = next(row for row in rows if row["position_m"])
    assert float(first["spacing_m"]) == float(first["position_m"]) - float(before["position_m"])
    positions_m = np.array([value for value in table.column("position_m").to_pylist() if value is not None])
    assert np.array_equal(positions_m, np.concatenate([row.position_m[row.planted] for row in pepper.rows]))
    assert json.loads((folder / "result.json").read_text(encoding="utf-8")) == json.loads(json.dumps(pepper.record()))


@pytest.mark.nightly
def test_equal_results_give_identical_files(pepper: LineResult, written: list[Path], tmp_path: Path) -> None:
    again = write_result(pepper, tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


def test_the_command_prints_one_json_object_and_writes_the_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["line", "pepper", "--metres", "5", "--repeat", "1", "--json", "--out", str(tmp_path / "out")]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["accounted"] is True
    assert record["metres"] == 5
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "plants.csv", "plants.parquet", "provenance.json", "result.json", "rows.data.csv", "rows.png", "rows.svg",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["peper"], "peper: unknown line; did you mean pepper?"),
        (["pepper", "--metres", "0"], "--metres 0: must be 1 to 100000"),
        (["pepper", "--metres", "nan"], "--metres nan: must be 1 to 100000"),
        (["pepper", "--metres", "90000"], "--metres: requires "),
        (["pepper", "--repeat", "0"], "--repeat 0: must be 1 to 1000"),
        (["pepper", "--seed", "-1"], "--seed -1: must be 0 or more"),
        (["pepper", "--profile", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["pepper", "--machine", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["pepper", "--out", "nowhere/out"], "nowhere/out: cannot be created"),
        (["nowhere.yaml", "--out", "out"], "nowhere.yaml: "),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str],
    expected: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["line", *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(expected)
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


EXTREMES = [("mean", "90 %"), ("spacing", "2 m"), ("speed", "5 m/s"), ("speed", "0.02 m/s"), ("lag", "60 s")]
EACH_ONCE = [(NAMES[number % len(NAMES)], *extreme) for number, extreme in enumerate(EXTREMES)]
OTHERS = [each for name in NAMES for extreme in EXTREMES if (each := (name, *extreme)) not in EACH_ONCE]


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "key", "value"), one_in(20, [*EACH_ONCE, *OTHERS]))
def test_extreme_values_give_a_result(name: str, key: str, value: str, tmp_path: Path) -> None:
    """Values at the limits of the line file give poor or empty rows, but all cups and seedlings are accounted for."""
    text = lines()[name].read_text(encoding="utf-8")
    if key == "lag":
        text = text.replace("kind: ground_wheel\n  set_for_slip: 5 %, assumed", f"kind: own_motor\n  lag: {value}")
    text = re.sub(rf'{key}: ("[^"]*"|[^,}}\n]*, assumed)', f'{key}: "{value}"', text)
    assert value in text
    (tmp_path / "line.yaml").write_text(text, encoding="utf-8")
    done = result(str(tmp_path / "line.yaml"), 2.0)
    assert done.run.accounted
    assert "released" in done.text()
    json.dumps(done.record(), allow_nan=False)
    write_result(done, tmp_path)


@pytest.mark.parametrize(("metres", "planters"), first_of([(42_500.0, 100_000), (425_000.0, 1_000_000)]))
def test_a_million_planters_are_accounted_for(metres: float, planters: int) -> None:
    """In a row of 425 km, by default of a tenth, each lost or planted block is counted once."""
    done = result("cabbage", metres)
    assert done.run.accounted
    assert sum(row.released for row in done.rows) > planters


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_a_kilometre_takes_less_than_a_minute(name: str) -> None:
    start_s = time.process_time()
    assert result(name, 1000.0).run.accounted
    assert time.process_time() - start_s < 60.0


@pytest.mark.timeout(7_200)
@pytest.mark.parametrize(("cups", "metres"), first_of([(10_000, 2_000.0), (1_000_000, 6_000.0)], 0, nightly=1))
def test_a_million_cups_are_accounted_for(cups: int, metres: float) -> None:
    """In runs of 6 km with several seeds, by night in one of 2 km, each cup of the two rows is counted once."""
    released = 0
    seed = 100
    while released < cups:
        done = result("pepper", metres, seed=seed)
        assert done.run.accounted
        released += sum(row.released for row in done.rows)
        seed += 1
