"""Stimulus files: parsing, error messages, and the simulated run."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.fx.language.il import read_il
from controller.fx.stimulus.running import run
from controller.fx.stimulus.stimulus import Stimulus, StimulusError, WatchedDevice, changes, load_stimulus

GOOD = """\
scan_ms: 10
scans: 3
initial: {d0: -5, M500: 1, CN200: -70000}
inputs:
  - {at_ms: 15, set: {X010: 1, Z0: 3}}
  - {at_ms: 0, set: {TN0: 4}}
watch: [Y0, T0, TN0, D0, y000]
"""


def load(tmp_path: Path, text: str, *others: str) -> Stimulus:
    path = tmp_path / "s.yaml"
    path.write_text(text, encoding="utf-8")
    return load_stimulus(path, others)


def errors(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(StimulusError) as caught:
        load(tmp_path, text)
    return [line.removeprefix(f"{tmp_path}/") for line in str(caught.value).splitlines()]


def test_parsed_file(tmp_path: Path) -> None:
    assert load(tmp_path, GOOD) == Stimulus(
        scan_ms=10,
        scans=3,
        initial={WatchedDevice("D", 0): -5, WatchedDevice("M", 500): 1, WatchedDevice("CN", 200): -70000},
        inputs=((0, {WatchedDevice("TN", 0): 4}), (15, {WatchedDevice("X", 8): 1, WatchedDevice("Z", 0): 3})),
        watch=(WatchedDevice("Y", 0), WatchedDevice("T", 0), WatchedDevice("TN", 0), WatchedDevice("D", 0)),
        input_filter_ms=0,
    )


def test_required_and_optional_keys(tmp_path: Path) -> None:
    text = "scan_ms: 1\nscans: 1\nwatch: [X0]\ninput_filter_ms: 20\nabout: this\n"
    assert load(tmp_path, text, "about") == Stimulus(1, 1, {}, (), (WatchedDevice("X", 0),), 20)
    assert errors(tmp_path, text) == [
        "s.yaml:5: about: unknown key; use one of scan_ms, scans, initial, inputs, pulses, watch, input_filter_ms, "
        "expect"
    ]


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "scan_ms: 10",
            "scan_ms: 0",
            "1: scan_ms: cannot be 0; write the scan period in ms, 1 to 60000",
        ),
        (
            "scan_ms: 10",
            "scan_ms: true",
            "1: scan_ms: cannot be true; write the scan period in ms, 1 to 60000",
        ),
        ("scans: 3", "scan: 3", "2: scan: unknown key; did you mean scans?"),
        ("watch: [Y0", "watch: [Y8", "7: watch[1]: Y8 has a digit 8 or 9, but Y is octal; Y7 is followed by Y10"),
        (
            "watch: [Y0",
            "watch: [K4M0",
            "7: watch[1]: 'K4M0' is not a single device; write one such as X0, D100, T0 or TN0",
        ),
        (
            "watch: [Y0",
            "watch: [D0Z0",
            "7: watch[1]: 'D0Z0' is not a single device; write one such as X0, D100, T0 or TN0",
        ),
        (
            "watch: [Y0, T0, TN0, D0, y000]",
            "watch: Y0",
            "7: watch: cannot be 'Y0'; write the devices to record as [Y0, T0, TN0, D0]",
        ),
        (
            "watch: [Y0, T0, TN0, D0, y000]",
            "watch: []",
            "7: watch: cannot be an empty list; write the devices to record as [Y0, T0, TN0, D0]",
        ),
        ("d0: -5", "D0: 32768", "3: initial.D0: 32768 is out of range; write a number from -32768 to 32767"),
        ("M500: 1", "M500: 2", "3: initial.M500: 2 is out of range; write a number from 0 to 1"),
        ("M500: 1", "M500: true", "3: initial.M500: true is not a whole number; write one from 0 to 1"),
        ("d0: -5", "D0: 1.5", "3: initial.D0: '1.5' is not a whole number; write one from -32768 to 32767"),
        (
            "d0: -5",
            "D0: 010",
            "3: initial.D0: '010' is not a whole number; write one from -32768 to 32767, without zeros in front",
        ),
        (
            "M500: 1",
            "M3072: 1",
            "3: initial.M3072: M3072 does not exist on an FX2N; it has M0 to M3071 and M8000 to M8255, "
            "or use --cpu fx3u",
        ),
        ("CN200: -70000", "CN199: -1", "3: initial.CN199: -1 is out of range; write a number from 0 to 32767"),
        (
            "TN0: 4",
            "TN256: 4",
            "6: inputs[2].set.TN256: T256 does not exist on an FX2N; it has T0 to T255, or use --cpu fx3u",
        ),
        (
            "{at_ms: 0, set: {TN0: 4}}",
            "{at_ms: 0, set: [TN0]}",
            "6: inputs[2].set: cannot be a list; write devices and values as {X0: 1, D0: 5}",
        ),
        (
            "{at_ms: 0, set: {TN0: 4}}",
            "{at_ms: 0}",
            "6: inputs[2].set: is missing; write devices and values as {X0: 1, D0: 5}",
        ),
        ("{at_ms: 0, set: {TN0: 4}}", "5", "6: inputs[2]: cannot be 5; write - {at_ms: 0, set: {X0: 1}}"),
        ("at_ms: 0", "at: 0", "6: inputs[2].at: unknown key; use one of at_ms, set"),
        (
            "at_ms: 15",
            "at_ms: 21",
            "5: inputs[1].at_ms: 21 is outside the run; write 0 to 20 (the last scan), or run more scans",
        ),
        (
            "at_ms: 15",
            "at_ms: -1",
            "5: inputs[1].at_ms: -1 is outside the run; write 0 to 20 (the last scan), or run more scans",
        ),
        ("X010: 1", "X010: 1, X010: 0", "5: inputs[1].set: key 'X010' is already defined on line 5; delete one"),
        ("scans: 3", "scans: 3\nscans: 4", "3: file: key 'scans' is already defined on line 2; delete one"),
    ],
)
def test_error_has_line_key_and_remedy(tmp_path: Path, old: str, new: str, line: str) -> None:
    assert old in GOOD
    assert f"s.yaml:{line}" in errors(tmp_path, GOOD.replace(old, new))


def test_all_errors_are_reported_in_file_order(tmp_path: Path) -> None:
    text = "watch: [Q0]\ninitial: {M0: 7}\nscan_ms: x\n"
    assert errors(tmp_path, text) == [
        "s.yaml:1: scans: is missing; write the number of scans to run, 1 to 1000000",
        "s.yaml:1: watch[1]: Q0 is not an operand; write one such as X0, D100Z0, K5, H1F, K4M0, P0 or N0",
        "s.yaml:2: initial.M0: 7 is out of range; write a number from 0 to 1",
        "s.yaml:3: scan_ms: cannot be 'x'; write the scan period in ms, 1 to 60000",
    ]


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "initial: 5\nscan_ms: 1\nscans: 1\nwatch: [X0]"])
def test_invalid_stimulus_is_reported_in_one_line(tmp_path: Path, text: str) -> None:
    assert len(errors(tmp_path, text)) == 1


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(StimulusError, match="cannot be read"):
        load_stimulus(tmp_path / "none.yaml")


def test_changes_since_the_previous_scan_and_later_ones_win(tmp_path: Path) -> None:
    x0, x1 = WatchedDevice("X", 0), WatchedDevice("X", 1)
    stimulus = Stimulus(10, 3, {}, ((0, {x0: 1}), (1, {x0: 0, x1: 0}), (10, {x1: 1}), (11, {x1: 0})), (x0,))
    assert [values for _, values in changes(stimulus)] == [values for _, values in stimulus.inputs]


def test_every_kind_of_device_is_set_and_watched() -> None:
    names = ("X", "Y", "M", "S", "T", "C", "D", "V", "Z", "TN", "CN")
    places = [WatchedDevice(kind, 200) if kind == "CN" else WatchedDevice(kind, 2) for kind in names]
    values = dict(zip(places, (1, 1, 1, 1, 1, 1, -3, -4, -5, 6, -70000), strict=True))
    off = dict.fromkeys(places, 0)
    stimulus = Stimulus(10, 2, values, ((10, off),), tuple(places))
    first, second = run(read_il("LD M8000\nOUT M8047\nEND"), stimulus)
    assert first == {"ms": 0} | {str(place): value for place, value in values.items()}
    assert second == {"ms": 10} | {str(place): 0 for place in places}


def test_contact_and_current_value_are_distinct() -> None:
    ladder = read_il("LD X0\nOUT T0 K2\nLD X0\nOUT C0 K9\nEND")
    watch = tuple(WatchedDevice(kind, 0) for kind in ("T", "TN", "C", "CN"))
    stimulus = Stimulus(100, 4, {WatchedDevice("X", 0): 1}, ((200, {WatchedDevice("TN", 0): 0}),), watch)
    assert run(ladder, stimulus) == [
        {"ms": 0, "T0": 0, "TN0": 0, "C0": 0, "CN0": 1},
        {"ms": 100, "T0": 0, "TN0": 1, "C0": 0, "CN0": 1},
        {"ms": 200, "T0": 0, "TN0": 0, "C0": 0, "CN0": 1},
        {"ms": 300, "T0": 0, "TN0": 1, "C0": 0, "CN0": 1},
    ]


def test_input_filter_is_off_by_default() -> None:
    ladder, x0 = read_il("LD X0\nOUT Y0\nEND"), WatchedDevice("X", 0)
    for filter_ms, image in ((0, [0, 1, 1, 1]), (20, [0, 0, 0, 1])):
        stimulus = Stimulus(10, 4, {}, ((5, {x0: 1}),), (WatchedDevice("Y", 0), x0), filter_ms)
        scans = run(ladder, stimulus)
        assert [scan["Y0"] for scan in scans] == [scan["X0"] for scan in scans] == image
