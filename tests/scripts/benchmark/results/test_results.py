"""Results of the benchmark: file, text and page."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from controller.common.errors import InputError
from scripts.benchmark.catalogue import PARTS
from scripts.benchmark.results.page import main, performance_page
from scripts.benchmark.results.record import BenchmarkRecord, FigureRecord, HostRecord, PartRecord, read_record
from scripts.benchmark.results.text import failure_text, part_text
from tests.scripts.benchmark.fake_parts import GAP, SPEED

HOST = HostRecord(processor="CPU", cores=2, memory_gib=4.0, kernel="Linux 6", python="CPython 3.11", libraries={})
SPEEDS = FigureRecord.of(SPEED, [1.0, 1.5, 3.0], disturbed=True)


def part_record(figures: dict[str, FigureRecord], failed: str | None = None) -> PartRecord:
    return PartRecord(
        title="Part one",
        repetitions=3,
        duration_s=12.3,
        load_average=0.5,
        stolen_pct=1.0,
        other_pct=12.5,
        failed=failed,
        figures=figures,
    )


def bench_record(parts: dict[str, PartRecord], test_duration_s: int | None = 300) -> BenchmarkRecord:
    return BenchmarkRecord(
        version="1.2.3",
        commit="abc",
        date="2026-11-23T12:00:00+00:00",
        seed=1,
        load_average=[0.1, 0.2, 0.3],
        host=HOST,
        test_duration_s=test_duration_s,
        parts=parts,
    )


COMPLETE = bench_record(
    {
        "scan": part_record({"speed": SPEEDS, "gap": FigureRecord.of(GAP, [], disturbed=False)}),
        "rows": part_record({}, "broken"),
    }
)


def test_a_file_that_is_read_back_is_equal(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    COMPLETE.write(path)
    assert read_record(path) == COMPLETE
    assert json.loads(path.read_text("utf-8"))["parts"]["scan"]["figures"]["speed"] == {
        "title": "speed",
        "unit": "m/s",
        "goal": {"at_least": 2.0},
        "repetitions": 3,
        "median": 1.5,
        "minimum": 1.0,
        "maximum": 3.0,
        "absent": "",
        "disturbed": True,
    }
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (
            ("test_duration_s",),
            "long",
            "test_duration_s: cannot be 'long'; write the duration of scripts/test in whole",
        ),
        (("parts", "scan", "figures", "speed", "median"), "x", "parts.scan.figures.speed.median: cannot be 'x'"),
        (("parts", "scan", "figures", "speed", "goal"), {"near": 1}, "parts.scan.figures.speed.goal.near"),
        (("hots",), 1, "hots: unknown key; did you mean host?"),
    ],
)
def test_an_invalid_file_is_one_line_with_file_line_key_and_remedy(
    keys: tuple[str, ...], value: object, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "bench.json"
    values: dict[str, Any] = COMPLETE.model_dump()
    inner = values
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    path.write_text(json.dumps(values, indent=1), "utf-8")
    with pytest.raises(InputError) as error:
        read_record(path)
    text = str(error.value)
    line = int(text.removeprefix(f"{path}:").partition(":")[0])
    assert json.dumps(keys[-1]) in path.read_text("utf-8").splitlines()[line - 1 - (keys[-1] == "goal")]
    assert message in text
    assert text.endswith("; or measure again with scripts/bench --json")
    assert "\n" not in text


def test_a_number_that_is_none_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    COMPLETE.write(path)
    path.write_text(path.read_text("utf-8").replace('"median": 1.5', '"median": 1.5.0'), "utf-8")
    with pytest.raises(
        InputError, match=r"json:\d+: parts\.scan\.figures\.speed\.median: is not a JSON value; correct it"
    ):
        read_record(path)


def test_the_text_states_median_range_goal_and_disturbance() -> None:
    part = COMPLETE.parts["scan"]
    lines = part_text("scan", part).splitlines()
    assert lines[0] == (
        "scan: Part one, 3 measurements in 12 s; load average 0.5 before, other processes 12.5 %, steal time 1 % of a "
        "processor"
    )
    assert re.fullmatch(r"  speed +1\.5 m/s \(disturbed\) \(1 to 3\); goal: at least 2, not met", lines[1])
    assert re.fullmatch(r"  gap +there was no gap", lines[2])
    failed = COMPLETE.parts["rows"]
    assert failure_text("rows", failed).startswith(
        "rows: failed: broken; load average 0.5 before, other processes 12.5 %"
    )
    assert failure_text("rows", failed.model_copy(update={"other_pct": 1.0})) == "rows: failed: broken"


def test_the_page_states_what_the_file_states(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    COMPLETE.write(path)
    page = performance_page(path)
    assert "| speed | 1.5 m/s (disturbed) | 1 to 3 | at least 2, not met |\n" in page
    assert "| gap | there was no gap |  |  |\n" in page
    assert "Not measured: broken\n" in page
    assert "| computer | CPU, 2 cores, 4 GiB, Linux 6 |\n" in page
    assert "`scripts/test` takes about 5 minutes" in page
    assert "The ratio is (not measured) |" in page
    assert "$" not in page


def test_an_explanation_that_parts_share_stands_once(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    bench_record({part.name: part_record({"speed": SPEEDS}) for part in PARTS}).write(path)
    page = performance_page(path)
    assert page.count("two lamps follow the cup counters") == 1
    assert page.count("### Part one\n") == len(PARTS)


def test_the_page_requires_the_duration_of_the_tests_and_known_parts(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    bench_record({}, test_duration_s=None).write(path)
    with pytest.raises(
        InputError, match=r"bench\.json:1: test_duration_s: is null; write the duration of scripts/test"
    ):
        performance_page(path)
    bench_record({"scann": part_record({})}).write(path)
    with pytest.raises(InputError, match=r"bench\.json:1: parts: unknown part scann; measure again"):
        performance_page(path)


def test_the_page_of_an_invalid_file_is_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken, out = tmp_path / "bench.json", tmp_path / "out"
    broken.write_text('{"version": "1"', "utf-8")
    for path, expected in (
        (broken, f"{broken}:1: file: is not YAML"),
        (tmp_path / "none", f"{tmp_path / 'none'}: is not"),
    ):
        assert main([str(path), "--out", str(out)]) == 2
        printed = capsys.readouterr()
        assert printed.err.startswith(expected)
        assert printed.err.count("\n") == 1
        assert not out.exists()
