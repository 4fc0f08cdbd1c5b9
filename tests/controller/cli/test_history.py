"""Command ``history``: tables, periods, identical contents in all formats, summary and one-line errors."""

from __future__ import annotations

import csv
import json
import os
import re
import sqlite3
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from controller.cli.history import add_arguments, history_text
from controller.cli.main import main
from controller.common.command_line import Parser
from controller.common.errors import InputError
from controller.common.extras import install_command
from controller.events.alarm_states import AlarmState
from controller.history.file import HistoryFile, HistoryRow
from controller.history.schema import TABLES, HistoryError

S, MINUTE, HOUR = 1_000, 60_000, 3_600_000


def utc_ms(text: str) -> int:
    """Return the timestamp of a local time in ms."""
    return round(datetime.fromisoformat(text).timestamp() * 1000)


@pytest.fixture(autouse=True)
def _far_east(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Use a time zone other than UTC."""
    monkeypatch.setenv("TZ", "Asia/Shanghai")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.fixture
def morning_ms() -> int:
    """Return the wall-clock time at which the newer run of the history starts, ms."""
    return utc_ms("2026-05-01T06:00")


@pytest.fixture
def path(tmp_path: Path, morning_ms: int) -> Path:
    """Return the path of a history with two runs; the first run starts two days before the second."""
    path = tmp_path / "history.sqlite"
    write(path, [("runs", 0, ("transplanter", "0.0.9")), event(0, "state", 2, "Stopped")], morning_ms - 48 * HOUR)
    write(
        path,
        [
            ("runs", 0, ("transplanter", "0.1.0")),
            event(1 * S, "state", 2, "Stopped"),
            event(2 * S, "refusal", 3, "cannot start", '{"command":"start"}'),
            ("cycles", 60 * S, ("left", 1, 15_990, 7_000, 2, "none", '[[0,"Y5",0],[0,"Y5",1]]')),
            ("cycles", 61 * S, ("right", 1, 16_010, 7_000, 0, "tray", "[]")),
            ("alarms", 70 * S, (990, "k", "normal", "unacknowledged", None, "magazine empty", None)),
            ("alarms", 80 * S, (990, "k", "unacknowledged", "shelved", "王", "magazine empty", 99_000)),
            ("audit", 90 * S, ("127.0.0.1:1", "王小明", "clamp", "20", "done")),
            ("audit", 91 * S, ("127.0.0.1:1", "Li\x1b[2J", "clamp", "0", "refused: exception 03")),
        ],
        morning_ms,
    )
    return path


RecordedRow = tuple[str, int, tuple[str | int | None, ...]]


def event(at_ms: int, kind: str, number: int = 0, text: str = "", detail: str = "{}") -> RecordedRow:
    return "events", at_ms, (kind, number, text, detail)


def write(path: Path, rows: Sequence[RecordedRow], began_ms: int) -> None:
    """Append a run; each row is (table, ms since the start of the run, column values)."""
    file = HistoryFile(path, 4_000_000)
    file.append([HistoryRow(table, began_ms + at_ms, at_ms, values) for table, at_ms, values in rows])
    file.close()


def command(path: Path, *arguments: str, now_ms: int = 0) -> str:
    """Run the command and return its output."""
    parser = Parser()
    add_arguments(parser)
    return history_text(parser.parse_args([str(path), *arguments]), now_ms=now_ms)


def ids(path: Path, *arguments: str, table: str = "events", now_ms: int = 0) -> list[int]:
    found = json.loads(command(path, "--table", table, "--format", "json", *arguments, now_ms=now_ms))
    return [row["id"] for row in found]


# text tables


def test_a_table_is_aligned_and_its_times_are_local(path: Path) -> None:
    assert command(path).splitlines() == [
        "time                       run  kind     number  text          detail",
        "2026-04-29 06:00:00+08:00  1    state    2       Stopped",
        "2026-05-01 06:00:01+08:00  3    state    2       Stopped",
        '2026-05-01 06:00:02+08:00  3    refusal  3       cannot start  {"command":"start"}',
    ]


def test_chinese_text_is_aligned_and_control_characters_are_replaced(path: Path) -> None:
    assert command(path, "--table", "audit").splitlines() == [
        "time                       run  peer         who     what   value  result",
        "2026-05-01 06:01:30+08:00  3    127.0.0.1:1  王小明  clamp  20     done",
        "2026-05-01 06:01:31+08:00  3    127.0.0.1:1  Li\ufffd[2J  clamp  0      refused: exception 03",
    ]


def test_edges_and_keys_are_not_shown_as_text(path: Path) -> None:
    assert command(path, "--table", "cycles").splitlines()[1].split()[2:] == [
        "3",
        "left",
        "1",
        "15990",
        "7000",
        "2",
        "none",
    ]
    alarm = command(path, "--table", "alarms").splitlines()[-1]
    assert alarm == (
        "2026-05-01 06:01:20+08:00  "
        "3    990     unacknowledged  shelved         王       99000             magazine empty"
    )


def test_text_shows_the_newest_hundred_rows_by_default(tmp_path: Path, morning_ms: int) -> None:
    path = tmp_path / "history.sqlite"
    write(path, [("runs", 0, ("p", "v")), *(event(n, "tray", n) for n in range(2_500))], morning_ms)
    assert len(command(path).splitlines()) == 1 + 100
    assert command(path).splitlines()[-1].split()[-1] == "2499"
    assert len(command(path, "--since", "2026-01-01").splitlines()) == 1 + 2_500
    assert len(command(path, "--last", "120").splitlines()) == 1 + 120
    assert ids(path) == list(range(2, 2_502)), "all pages must be read and no row repeated"


# selection of rows


def test_a_period_selects_rows(path: Path, morning_ms: int) -> None:
    assert ids(path) == [2, 4, 5]
    assert ids(path, "--since", "2026-05-01T06:00:02") == [5]
    assert ids(path, "--until", "2026-05-01T06:00:02") == [2, 4]
    assert ids(path, "--since", "2026-04-30T22:00:01+00:00", "--until", "2026-05-01 06:00:02") == [4]
    now_ms = morning_ms + 2 * S
    assert ids(path, "--since", "1s", now_ms=now_ms) == [4, 5]
    assert ids(path, "--since", "0s", now_ms=now_ms) == [5]
    assert ids(path, "--since", "3d", now_ms=now_ms) == [2, 4, 5]
    assert ids(path, "--since", "49h", "--until", "1440m", now_ms=now_ms) == [2]
    assert ids(path, "--last", "1") == [5]
    assert ids(path, "--last", "1", "--until", "2026-05-01T06:00:02") == [4], "the newest row of the period"
    assert ids(path, "--since", "2027-01-01") == []


def test_a_text_in_csv_is_no_formula(tmp_path: Path, morning_ms: int) -> None:
    formula = '=HYPERLINK("http://x","阀岛")'
    path = tmp_path / "history.sqlite"
    write(path, [("audit", 0, ("127.0.0.1:1", formula, "clamp", "-20", "done"))], morning_ms)
    (row,) = csv.DictReader(command(path, "--table", "audit", "--format", "csv").splitlines())
    assert (row["who"], row["value"]) == (f"'{formula}", "-20")


# clocks that change


@pytest.fixture
def berlin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()


@pytest.mark.usefixtures("berlin")
def test_the_repeated_hour_has_two_offsets(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    first_ms = utc_ms("2026-10-25T02:30+02:00")
    write(path, [event(0, "state", 2, "Stopped"), event(HOUR, "state", 2, "Stopped")], first_ms)
    lines = command(path, "--since", "2026-10-25T02:30+02:00", "--until", "2026-10-25T02:31+01:00").splitlines()[1:]
    assert [line[:25] for line in lines] == ["2026-10-25 02:30:00+02:00", "2026-10-25 02:30:00+01:00"]
    assert len(ids(path, "--since", "2026-10-25T02:30+01:00")) == 1


@pytest.mark.usefixtures("berlin")
@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("2026-10-25T02:30", "occurs twice, * specify 2026-10-25T02:30:00+02:00 or 2026-10-25T02:30:00+01:00"),
        ("2026-10-25T02:00", "occurs twice, * specify 2026-10-25T02:00:00+02:00 or 2026-10-25T02:00:00+01:00"),
        ("2026-03-29T02:30", "does not exist, * specify 2026-03-29T03:30:00+02:00 or 2026-03-29T01:30:00+01:00"),
        ("2026-03-29T02:59:59", "does not exist, * specify 2026-03-29T03:59:59+02:00 or 2026-03-29T01:59:59+01:00"),
    ],
)
def test_a_time_without_one_meaning_is_refused_with_the_reason(path: Path, text: str, complaint: str) -> None:
    expected = complaint.replace("*", "because the clocks change;")
    with pytest.raises(HistoryError, match=f"^{re.escape(f'--since {text}: {expected}')}$"):
        command(path, "--since", text, "--until", "2026-12-01")
    with pytest.raises(HistoryError, match=f"^--until {re.escape(text)}: "):
        command(path, "--until", text)


@pytest.mark.usefixtures("berlin")
@pytest.mark.parametrize("text", ["2026-10-25T01:59", "2026-10-25T03:00", "2026-03-29T01:59", "2026-03-29T03:00"])
def test_the_minutes_around_a_change_have_one_meaning(path: Path, text: str) -> None:
    command(path, "--since", text)


# formats


@pytest.mark.parametrize("table", TABLES)
def test_all_formats_contain_the_same_rows(table: str, path: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        names = list(TABLES[table])
        rows = [dict(zip(names, row, strict=True)) for row in db.execute(f"SELECT * FROM {table} ORDER BY id")]  # noqa: S608
    assert rows
    out = tmp_path / "rows"
    for form in ("csv", "json", "parquet"):
        assert command(path, "--table", table, "--format", form, "--out", str(out)) == str(out)
        if form == "csv":
            with out.open(encoding="utf-8", newline="") as file:
                texts = list(csv.DictReader(file))
            assert texts == [{name: "" if row[name] is None else str(row[name]) for name in names} for row in rows]
            assert command(path, "--table", table, "--format", form) == out.read_text(encoding="utf-8").rstrip("\n")
        elif form == "json":
            plain = json.loads(out.read_text(encoding="utf-8"))
            for row in plain:
                row.update(
                    {name: json.dumps(row[name], separators=(",", ":")) for name in ("detail", "edges") if name in row}
                )
            assert plain == rows
            assert command(path, "--table", table, "--format", form) == out.read_text(encoding="utf-8").rstrip("\n")
        else:
            assert pq.read_table(out).to_pylist() == rows
    assert sorted(entry.name for entry in tmp_path.iterdir() if "part" in entry.name) == []


def test_a_parquet_file_with_a_name_of_another_locale(path: Path, tmp_path: Path) -> None:
    out = tmp_path / os.fsdecode(b"\xd2\xc6")
    command(path, "--format", "parquet", "--out", str(out))
    with out.open("rb") as file:
        assert pq.read_table(file).num_rows == 3


def test_an_output_without_rows_is_valid(path: Path, tmp_path: Path) -> None:
    out = tmp_path / "rows"
    nothing = ("--since", "2030-01-01", "--out", str(out), "--format")
    command(path, *nothing, "csv")
    assert out.read_text(encoding="utf-8") == "id,utc_ms,at_ms,run,kind,number,text,detail\n"
    command(path, *nothing, "json")
    assert json.loads(out.read_text(encoding="utf-8")) == []
    command(path, *nothing, "parquet")
    assert pq.read_table(out).column_names == list(TABLES["events"])
    command(path, *nothing, "text")
    assert out.read_text(encoding="utf-8") == "time  run  kind  number  text  detail\n"


# summary


def alarm(at_ms: int, number: int, before: AlarmState, after: AlarmState) -> RecordedRow:
    return "alarms", at_ms, (number, "k", before.value, after.value, None, f"alarm {number}", None)


def cycle(at_ms: int, side: str, cycle_ms: int, missed_cups: int) -> RecordedRow:
    return "cycles", at_ms, (side, 1, cycle_ms, 0, missed_cups, "none", "[]")


def row(at_ms: int) -> RecordedRow:
    return event(at_ms, "row", 1, detail='{"side":"left"}')


@pytest.fixture
def shift(tmp_path: Path) -> Path:
    """Return the path of a history with one run that spans midnight and a later run."""
    a = AlarmState
    path = tmp_path / "shift.sqlite"
    before = [
        ("runs", 0, ("transplanter", "0.1.0")),
        event(0, "state", 6),
        *(row(minute * MINUTE) for minute in (10, 11, 12, 13)),  # the cycle of the last one was interrupted
        cycle(10 * MINUTE, "left", 15_000, 100),  # first recorded cycle: the time of these misses is unknown
        cycle(11 * MINUTE, "left", 17_000, 104),
        cycle(12 * MINUTE, "right", 16_001, 0),
        event(20 * MINUTE, "tray", 1),
        alarm(30 * MINUTE, 903, a.NORMAL, a.UNACKNOWLEDGED),
        alarm(30 * MINUTE + 10 * S, 903, a.UNACKNOWLEDGED, a.ACKNOWLEDGED),
        alarm(31 * MINUTE, 903, a.ACKNOWLEDGED, a.LATCHED_ACKNOWLEDGED),
        alarm(32 * MINUTE, 903, a.LATCHED_ACKNOWLEDGED, a.UNACKNOWLEDGED),  # the cause has returned: a new alarm
        alarm(33 * MINUTE, 903, a.UNACKNOWLEDGED, a.RETURNED_UNACKNOWLEDGED),
        alarm(34 * MINUTE, 903, a.RETURNED_UNACKNOWLEDGED, a.NORMAL),
        alarm(40 * MINUTE, 990, a.NORMAL, a.UNACKNOWLEDGED),
        alarm(41 * MINUTE, 990, a.UNACKNOWLEDGED, a.SHELVED),
        alarm(50 * MINUTE, 990, a.SHELVED, a.UNACKNOWLEDGED),
        alarm(51 * MINUTE, 990, a.UNACKNOWLEDGED, a.NORMAL),
        alarm(110 * MINUTE, 941, a.NORMAL, a.LATCHED_UNACKNOWLEDGED),  # still set at the end of the run
        event(3 * HOUR, "tray", 2),
        row(3 * HOUR),
        cycle(3 * HOUR, "left", 16_000, 3),  # the counters were reset, and three cups have been missed since
        event(5 * HOUR, "state", 2),
    ]
    write(path, before, utc_ms("2026-05-01T22:00"))
    after = [
        ("runs", 0, ("transplanter", "0.1.1")),
        alarm(MINUTE, 900, a.NORMAL, a.UNACKNOWLEDGED),
        row(2 * MINUTE),
        cycle(2 * MINUTE, "left", 14_000, 5),
    ]
    write(path, after, utc_ms("2026-05-02T08:00"))
    return path


def total(number: int, count: int, active_ms: int, *, chattering: int = 0, standing: int = 0) -> dict[str, object]:
    """Return the totals of one alarm."""
    return {
        "number": number,
        "text": f"alarm {number}",
        "count": count,
        "active_ms": active_ms,
        "chattering": chattering,
        "standing": standing,
    }


def test_the_summary_counts_chattering_and_standing_alarms(tmp_path: Path) -> None:
    """An alarm that comes four times in 45 s chatters once, and again later; one that lasts 24 h is standing."""
    a = AlarmState
    path = tmp_path / "load.sqlite"
    rows: list[RecordedRow] = [("runs", 0, ("transplanter", "0.1.0"))]
    for at_ms in (0, 15 * S, 30 * S, 45 * S, 5 * MINUTE, 5 * MINUTE + 20 * S, 5 * MINUTE + 40 * S):
        rows.append(alarm(at_ms, 990, a.NORMAL, a.UNACKNOWLEDGED))
        rows.append(alarm(at_ms + S, 990, a.UNACKNOWLEDGED, a.NORMAL))
    rows += [
        alarm(HOUR, 903, a.NORMAL, a.UNACKNOWLEDGED),
        alarm(2 * HOUR, 941, a.NORMAL, a.UNACKNOWLEDGED),
        alarm(25 * HOUR, 903, a.UNACKNOWLEDGED, a.NORMAL),
        alarm(26 * HOUR - S, 941, a.UNACKNOWLEDGED, a.NORMAL),
    ]
    write(path, rows, utc_ms("2026-05-01T00:00"))
    (day,) = json.loads(command(path, "--summary", "--format", "json", "--until", "2026-05-02"))
    assert day["most_in_ten_minutes"] == 7
    assert day["alarms"] == [
        total(903, 1, 24 * HOUR, standing=1),
        total(941, 1, 24 * HOUR - S),
        total(990, 7, 7 * S, chattering=2),
    ]
    text = command(path, "--summary", "--until", "2026-05-02")
    assert "at most 7 in 10 minutes" in text
    assert "alarm 990, chattering 2 x" in text
    assert "alarm 903, standing 1 x" in text


def test_the_summary_counts_per_run_and_day(shift: Path) -> None:
    first, second, third = json.loads(command(shift, "--summary", "--format", "json"))
    assert first == {
        "run": 1,
        "day": "2026-05-01",
        "program": "transplanter",
        "version": "0.1.0",
        "recorded_ms": 2 * HOUR,
        "trays": 1,
        "rows": 4,
        "mean_cycle_ms": 16_000,
        "missed_cups": 4,
        "alarms_per_hour": 2.0,
        "alarms": [
            total(903, 2, 3 * MINUTE),
            total(941, 1, 190 * MINUTE),
            total(990, 1, 2 * MINUTE),
        ],
        "most_in_ten_minutes": 2,
    }
    fields = ("day", "recorded_ms", "trays", "rows", "missed_cups", "alarms_per_hour")
    assert [second[name] for name in fields] == ["2026-05-02", 3 * HOUR, 1, 1, 3, 0.0]
    assert [third[name] for name in fields] == ["2026-05-02", 2 * MINUTE, 0, 1, 2, None]
    assert third["alarms"] == [total(900, 1, MINUTE)]


def test_the_summary_as_text(shift: Path) -> None:
    assert command(shift, "--summary", "--until", "2026-05-02").splitlines() == [
        "2026-05-01  run 1, transplanter 0.1.0",
        "  recorded 2.00 h",
        "  trays 1, rows 4, mean cycle 16.00 s, missed cups 4",
        "  alarms 4, 2.00 per hour, at most 2 in 10 minutes",
        "    903     2 x      180.0 s  alarm 903",
        "    941     1 x    11400.0 s  alarm 941",
        "    990     1 x      120.0 s  alarm 990",
    ]


def test_the_summary_of_a_period_counts_only_that_period(shift: Path) -> None:
    (only,) = json.loads(
        command(shift, "--summary", "--format", "json", "--since", "2026-05-01T22:11", "--until", "2026-05-01T22:31")
    )
    assert (only["rows"], only["missed_cups"], only["trays"]) == (3, 4, 1), "counted from a cycle before the period"
    assert only["recorded_ms"] == 20 * MINUTE
    assert only["alarms"] == [total(903, 1, 3 * MINUTE)]
    assert only["alarms_per_hour"] == 3.0
    assert command(shift, "--summary", "--since", "2030-01-01") == ""


# invalid input


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ("--since", "yesterday"),
            "--since yesterday: must be local time such as 2026-05-01T07:30, or a time before now such as",
        ),
        (("--until", "2x"), "--until 2x: must be local time"),
        (("--since", "2026-13-01"), "--since 2026-13-01: must be"),
        (("--since", "-1h"), "--since -1h: must be"),
        (("--since", "1234567d"), "--since 1234567d: must be"),
        (("--last", "0"), "--last 0: must be 1 to 1000000000"),
        (("--last", str(2**63)), "must be 1 to 1000000000"),
        (("--format", "parquet"), "--format parquet: requires --out"),
        (("--summary", "--format", "csv"), "--format csv: must be text or json with --summary"),
        (("--summary", "--table", "alarms"), "--table alarms: cannot be combined with --summary"),
        (("--until", "2026-05-01", "--since", "2026-05-02"), "--since 2026-05-02 --until 2026-05-01: --until must be"),
        (("--until", "3h", "--since", "2h"), "--since 2h --until 3h: --until must be later than --since"),
        (("--out", "{folder}"), "{folder}: not a regular file"),
        (("--out", "/dev/null"), "/dev/null: not a regular file"),
        (("--out", "{folder}/no/rows.csv"), "rows.csv: No such file or directory; choose a writable file"),
        (("--format", "parquet", "--out", "{folder}/no/rows"), "choose a writable file"),
        (("--out", "{folder}/history.sqlite"), "history.sqlite: is part of the history; choose another file"),
        (("--out", "{folder}/../{name}/history.sqlite-wal"), "-wal: is part of the history; choose another file"),
    ],
)
def test_an_invalid_option_is_reported_in_one_line(arguments: tuple[str, ...], expected: str, path: Path) -> None:
    before = {entry.name for entry in path.parent.iterdir()}
    folder = {"folder": str(path.parent), "name": path.parent.name}
    given = [each.format(**folder) for each in arguments]
    if given[0] == "--since":
        given = [f"--since={given[1]}"]
    with pytest.raises(InputError) as refused:
        command(path, *given)
    assert expected.format(**folder) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert {entry.name for entry in path.parent.iterdir()} - {"history.sqlite-wal", "history.sqlite-shm"} == before


def empty(path: Path) -> None:
    path.touch()


def garbage(path: Path) -> None:
    path.write_bytes(b"no database at all " * 100)


def foreign(path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE notes (text)")


def newer(path: Path) -> None:
    write(path, [("runs", 0, ("p", "v"))], 0)
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 7")


def missing(path: Path) -> None:
    pass


def damaged(path: Path) -> None:
    write(path, [("runs", 0, ("p", "v")), *(event(n, "tray", n, "x" * 500) for n in range(100))], 0)
    with path.open("r+b") as file:
        file.seek(8_192)
        file.write(b"\xff" * 40_000)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (missing, "no such file; specify a history written by a controller"),
        (empty, "is not a history; specify a file written by a controller"),
        (garbage, "file is not a database; specify a file written by a controller"),
        (foreign, "is not a history; specify a file written by a controller"),
        (newer, "schema 7 is newer than schema 1 of this program"),
        (damaged, "malformed; specify a file written by a controller"),
    ],
)
def test_an_invalid_history_file_is_reported_in_one_line(make: object, expected: str, tmp_path: Path) -> None:
    path, out = tmp_path / "other.sqlite", tmp_path / "rows.csv"
    assert callable(make)
    make(path)
    out.write_text("as it was", encoding="utf-8")
    with pytest.raises(HistoryError) as refused:
        command(path, "--format", "csv", "--out", str(out))
    assert str(refused.value).startswith(f"{path}: ")
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)
    assert out.read_text(encoding="utf-8") == "as it was", "no partial output is written"
    assert not list(tmp_path.glob("*.part"))


def test_missing_pyarrow_is_reported_with_the_install_command(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    out = path.parent / "rows.parquet"
    assert main(["history", str(path), "--format", "parquet", "--out", str(out)]) == 2
    hint = f"history: pyarrow is not installed; run: {install_command('parquet')}\n"
    assert capsys.readouterr() == ("", hint)
    assert not out.exists()


def test_the_history_is_read_while_a_controller_writes(tmp_path: Path, morning_ms: int) -> None:
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4_000_000)
    file.append([HistoryRow("runs", morning_ms, 0, ("p", "v"))])
    for n in range(20):
        file.append([HistoryRow("events", morning_ms + n, n, ("tray", n, "", "{}"))])
        assert len(ids(path)) == n + 1
    file.close()
