"""Campaigns: every run is stored exactly once, also after kill -9, a full disk, damage and a change of the program."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
import pytest
from filelock import FileLock

from plant_sim.cli.main import main
from plant_sim.faults import parse_fault
from plant_sim.machine.parameters import load_machine
from plant_sim.study.campaign import version
from plant_sim.study.campaign.record import report_record
from plant_sim.twin.trial import run_trial
from tests.paths import DOCS, ROOT
from tests.plant_sim.study.campaign.folders import (
    FEW,
    FEW_RUNS,
    LONG,
    LONG_RUNS,
    SMALL,
    SMALL_RUNS,
    campaign,
    command,
    environment,
    keys,
    shards,
    table,
    written,
)
from tests.real_time import COMMAND_S, WAIT_S


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a complete campaign, which a test copies before it changes it."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert campaign(written(folder), folder / "out", "--shard", "5") == 0
    return folder / "out"


@pytest.fixture
def complete(undisturbed: Path, tmp_path: Path) -> tuple[Path, Path]:
    """Return a campaign file and a copy of its complete folder."""
    return written(tmp_path), Path(shutil.copytree(undisturbed, tmp_path / "out"))


def test_a_campaign_stores_each_combination_once(undisturbed: Path) -> None:
    rows = table(undisturbed)
    assert len({row["key"] for row in rows}) == len(rows) == SMALL_RUNS
    assert [len(pd.read_parquet(path)) for path in shards(undisturbed)].count(5) == 3
    settings = Counter(
        (row["crop.claw_pressure_mpa"], row["program.pause_at_feed"], row["faults"], row["trial"]) for row in rows
    )
    assert len(settings) == SMALL_RUNS
    assert {pause_ms for _, pause_ms, _, _ in settings} == {200.0, 300.0}
    assert {faults for _, _, faults, _ in settings} == {"", "stuck_off:left.lift_up@26000ms..34000ms"}
    seeds = {(row["seed"], row["faults"]) for row in rows}
    assert len(seeds) == SMALL_RUNS
    assert len({seed for seed, _ in seeds}) == SMALL_RUNS / 2  # every set of faults has the same seeds


def test_a_row_contains_the_complete_report_of_its_trial(undisturbed: Path) -> None:
    row = next(row for row in table(undisturbed) if row["faults"] and row["crop.claw_pressure_mpa"] == 0.5)
    report = run_trial(
        seed=row["seed"],
        seedlings=12,
        parameters=load_machine().with_values({"crop.claw_pressure_mpa": 0.5}),
        set_points={"pause_at_feed": round(row["program.pause_at_feed"] / 10)},
        faults=[parse_fault(row["faults"])],
    )
    assert {name: row[name] for name in report_record(report)} == report_record(report)
    stored = {name.partition("_low")[0].partition("_high")[0] for name in row}
    assert set(report.record()) - stored <= {"wall_s", "intervals", "missed_cups_by_row"}
    assert row["version"] == version.code_version()


def test_duckdb_and_pandas_read_the_folder(undisturbed: Path) -> None:
    """DuckDB runs in a process of its own, because version 2.0.0 prints a report of its memory when Python ends."""
    program = "import duckdb, json, sys; print(json.dumps(duckdb.sql(sys.argv[1]).fetchall()))"
    query = (
        "SELECT \"crop.claw_pressure_mpa\", count(*), CAST(sum(in_cups) AS INTEGER) FROM 'runs/*.parquet' "
        "WHERE completed GROUP BY ALL ORDER BY ALL"
    )
    arguments = [sys.executable, "-c", program, query]
    done = subprocess.run(arguments, check=True, capture_output=True, text=True, cwd=undisturbed, timeout=COMMAND_S)
    frame = pd.read_parquet(undisturbed / "runs")
    groups = frame[frame.completed].groupby("crop.claw_pressure_mpa").in_cups
    expected = [[pressure, len(group), int(group.sum())] for pressure, group in groups]
    assert json.loads(done.stdout) == expected
    assert sum(count for _, count, _ in expected) == SMALL_RUNS


@pytest.mark.nightly
def test_the_program_of_the_guide_reads_the_folder(undisturbed: Path, tmp_path: Path) -> None:
    page = (DOCS / "campaigns.md").read_text(encoding="utf-8")
    program = page.partition("```python\n")[2].partition("```")[0]
    (tmp_path / "var").mkdir()
    (tmp_path / "var/campaign").symlink_to(undisturbed)
    arguments = [sys.executable, "-c", program]
    done = subprocess.run(arguments, check=True, capture_output=True, text=True, cwd=tmp_path, timeout=COMMAND_S)
    assert "stuck_off:left.lift_up@26000ms..34000ms" in done.stdout
    assert "crop.claw_pressure_mpa" in done.stdout


@pytest.fixture(scope="module")
def long_table(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Return the table of the long campaign."""
    folder = tmp_path_factory.mktemp("long")
    assert campaign(written(folder), folder / "out", *LONG) == 0
    return table(folder / "out")


@contextmanager
def interrupted(file: Path, out: Path) -> Iterator[subprocess.Popen[str]]:
    """Run the long campaign with two processes; yield it when some files are written."""
    with subprocess.Popen(
        command(file, out, "--shard", "2", "--workers", "2", *LONG),
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=environment(),
    ) as process:
        assert process.stderr is not None
        line = next(line for line in process.stderr if int(line.split()[0]) >= 4)
        assert line.endswith(" left\n")
        yield process


@pytest.mark.nightly
def test_kill_9_loses_no_run_and_repeats_none(long_table: list[dict[str, Any]], tmp_path: Path) -> None:
    """The process is killed when some files exist; its worker processes end, and one process completes the campaign."""
    file, out = written(tmp_path), tmp_path / "out"
    with interrupted(file, out) as process:
        workers = psutil.Process(process.pid).children(recursive=True)
        os.kill(process.pid, signal.SIGKILL)
    before = keys(out)
    assert 2 <= len(before) < LONG_RUNS
    assert len(workers) >= 2
    assert psutil.wait_procs(workers, timeout=WAIT_S)[1] == []

    assert campaign(file, out, "--shard", "2", *LONG) == 0
    assert table(out) == long_table
    assert len(set(keys(out))) == len(keys(out)) == LONG_RUNS
    assert set(before) < set(keys(out))


def test_stored_runs_are_not_computed_again(
    complete: tuple[Path, Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = complete
    times_ns = {path: path.stat().st_mtime_ns for path in shards(out)}
    monkeypatch.setattr("plant_sim.study.campaign.run.run_trial", None)
    assert campaign(file, out, "--json") == 0
    printed = capsys.readouterr()
    record = json.loads(printed.out)
    assert (record["runs"], record["computed"], record["files"]) == (SMALL_RUNS, 0, len(times_ns))
    assert record["origin"][0].startswith("What was fitted to what: ")
    assert record["changed_parameters"] == []
    assert printed.err == f"{SMALL_RUNS} of {SMALL_RUNS} runs\n"
    assert {path: path.stat().st_mtime_ns for path in shards(out)} == times_ns


def test_an_extended_campaign_keeps_its_runs(
    complete: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """More trials and another level add runs; a change that abandons stored runs is rejected, and nothing changes."""
    _, out = complete
    before = table(out)
    more = written(tmp_path, SMALL.replace("[0.3, 0.5]", "[0.3, 0.4, 0.5]"))
    assert campaign(more, out, "--json") == 0
    assert json.loads(capsys.readouterr().out)["computed"] == SMALL_RUNS / 2
    rows = table(out)
    assert len({row["key"] for row in rows}) == len(rows) == 1.5 * SMALL_RUNS
    assert [row for row in rows if row["crop.claw_pressure_mpa"] != 0.4] == before

    other = written(tmp_path, SMALL.replace("[0.3, 0.5]", "[0.4, 0.5]"))
    assert campaign(other, out) == 2
    assert capsys.readouterr().err == (
        f"--out {out}: contains 8 runs that are not in {other} with this machine and I/O map; use another folder\n"
    )
    assert table(out) == rows


def damaged_end(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def damaged_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def emptied(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("damage", [damaged_end, damaged_byte, emptied])
def test_a_damaged_file_is_reported_and_its_runs_are_computed_again(
    damage: object, complete: tuple[Path, Path], undisturbed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = complete
    lost, path = min((len(pd.read_parquet(path)), path) for path in shards(out))
    assert callable(damage)
    damage(path)
    assert campaign(file, out, "--json") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["computed"] == lost
    (line,) = (line for line in printed.err.splitlines() if not line[0].isdigit())
    assert line.startswith(f"{path}: is damaged or incomplete (")
    assert line.endswith(f"; renamed to {path.name}.damaged, and its runs are computed again")
    assert path.with_name(f"{path.name}.damaged").exists()
    assert table(out) == table(undisturbed)


def test_remains_of_a_killed_process_and_copied_files_are_not_used(
    complete: tuple[Path, Path], undisturbed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = complete
    first = shards(out)[0]
    shutil.copy(first, first.with_name("copy.parquet"))
    (out / "runs/x.part").write_bytes(b"PAR1")
    assert campaign(file, out) == 0
    assert "copy.parquet: is damaged or incomplete" in capsys.readouterr().err
    assert not (out / "runs/x.part").exists()
    assert table(out) == table(undisturbed)


def test_results_of_another_version_are_not_mixed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A changed source moves the results away; after a return to the old source they are used again."""
    file, out = written(tmp_path, FEW), tmp_path / "out"
    assert campaign(file, out) == 0
    capsys.readouterr()
    before, old = table(out), version.code_version()
    changed = tmp_path / "changed.py"
    changed.write_text("# a changed source\n")
    sources = [*version.version_sources(), changed]
    with monkeypatch.context() as patch:
        patch.setattr(version, "version_sources", lambda: sources)
        version.code_version.cache_clear()
        new = version.code_version()
        assert campaign(file, out, "--json") == 0
    version.code_version.cache_clear()
    printed = capsys.readouterr()
    record = json.loads(printed.out)
    assert (record["computed"], record["version"]) == (FEW_RUNS, new)
    assert printed.err.splitlines()[0] == (
        f"{out}: {FEW_RUNS} runs of version {old} moved to other-versions; this is version {new}, which computes "
        "them again"
    )
    rows = table(out)
    assert {row["version"] for row in rows} == {new} != {old}
    assert {row["key"] for row in rows}.isdisjoint(row["key"] for row in before)

    assert campaign(file, out, "--json") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["computed"] == 0
    assert f"{FEW_RUNS} runs of version {new} moved to other-versions" in printed.err
    assert table(out) == before


def test_a_full_disk_is_reported_in_one_line_and_the_stored_runs_remain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The operating system limits the size of files, so that a result file cannot be written."""
    file, out = written(tmp_path, FEW), tmp_path / "out"
    assert campaign(file, out) == 0
    capsys.readouterr()
    before = table(out)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
    try:
        code = campaign(file, out, "--trials", "5", "--shard", "1")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    errors = capsys.readouterr().err
    assert code == 2, errors
    (line,) = (line for line in errors.splitlines() if not line[0].isdigit())
    assert line == (
        f"--out {out}: cannot be written (File too large); free some disk space or use another folder; {FEW_RUNS} of "
        "5 runs are stored, the same command computes the others"
    )
    assert table(out) == before
    assert list((out / "runs").glob("*.part")) == []
    assert campaign(file, out, "--trials", "5", "--json") == 0
    assert json.loads(capsys.readouterr().out)["computed"] == 2
    assert len(set(keys(out))) == 5


def test_a_folder_is_used_by_one_process_at_a_time(
    complete: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = complete
    with FileLock(out / "campaign.lock"):
        assert campaign(file, out) == 2
    assert capsys.readouterr().err == f"--out {out}: in use by another process; wait for it, or use another folder\n"


@pytest.mark.nightly
def test_a_killed_worker_process_does_not_end_the_campaign(long_table: list[dict[str, Any]], tmp_path: Path) -> None:
    file, out = written(tmp_path), tmp_path / "out"
    with interrupted(file, out) as process:
        children = psutil.Process(process.pid).children()
        next(each for each in children if "popen_loky_posix" in " ".join(each.cmdline())).kill()
        assert process.stderr is not None
        rest = process.stderr.read()
    assert process.returncode == 0, rest
    (line,) = (line for line in rest.splitlines() if not line[0].isdigit())
    assert line.startswith("--workers: a process was killed, ")
    assert line.endswith("; its runs are computed again")
    assert table(out) == long_table


@pytest.mark.nightly
def test_the_version_covers_every_source_that_a_trial_loads() -> None:
    program = (
        "import sys\n"
        "from plant_sim.faults import parse_fault\n"
        "from plant_sim.study.campaign.record import report_record\n"
        "from plant_sim.twin.trial import run_trial\n"
        "before = set(sys.modules)\n"
        "report_record(run_trial(seed=1, seedlings=1, faults=[parse_fault('stuck_off:left.lift_up@26s..34s')]))\n"
        "names = [name for name in sys.modules if name.partition('.')[0] in ('controller', 'plant_sim')]\n"
        "print(*(sys.modules[name].__file__ for name in names), sep='\\n')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        capture_output=True,
        text=True,
        env=environment(),
        timeout=COMMAND_S,
    )
    loaded = {Path(line) for line in done.stdout.splitlines()}
    assert ROOT / "plant_sim/machine/kernel.py" in loaded
    packages = {path for path in loaded if path.name == "__init__.py"}
    assert loaded - packages <= set(version.version_sources())


def test_a_folder_that_is_not_a_campaign_is_not_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, notes = written(tmp_path), tmp_path / "results"
    notes.mkdir()
    (notes / "notes.txt").write_text("mine")
    assert campaign(file, notes) == 2
    assert campaign(file, notes / "notes.txt") == 2
    assert main(["study", "campaign", str(file)]) == 2
    assert capsys.readouterr().err.splitlines() == [
        f"--out {notes}: contains other files; specify a new folder or that of the campaign",
        f"--out {notes / 'notes.txt'}: is not a folder; specify a new folder or that of the campaign",
        "--out: is missing; specify the folder of the campaign",
    ]
    assert [path.name for path in notes.iterdir()] == ["notes.txt"]


def test_a_file_is_written_when_its_oldest_run_is_due(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plant_sim.study.campaign.campaign.SHARD_S", 0.0)
    out = tmp_path / "out"
    assert campaign(written(tmp_path, FEW), out) == 0
    assert len(shards(out)) == FEW_RUNS
