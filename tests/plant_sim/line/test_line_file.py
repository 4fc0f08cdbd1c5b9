"""Line files and ground files: the included lines, and one-line errors with file, line, key and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from plant_sim.line.errors import LineError
from plant_sim.line.file import find_line, lines, load_ground, load_line

PEPPER = find_line("pepper").read_text(encoding="utf-8")
GROUND = """\
acceleration: 0.3 m/s2
segments:
  - {speed: "1.5 km/h, paper", over: 20 m}
  - {ramp_to: 0.5 m/s, over: 1 min}
  - {hill: 8 %, over: 30 m}
  - {stand: "10 s, assumed"}
slip: {mean: "5 %, assumed", sd: 2 %, patch: 1 m}
hill: {speed_loss: 1.5, slip_gain: 0.5}
"""


def test_the_included_lines_are_valid() -> None:
    assert list(lines()) == ["cabbage", "combined", "pepper"]
    for path in lines().values():
        line = load_line(path)
        assert line.path == path
        assert line.assumed


def test_values_are_converted_and_assumed_ones_are_listed() -> None:
    line = load_line(find_line("pepper"))
    assert line.values.spacing == 0.4
    assert line.values.nozzle is not None
    assert (line.values.nozzle.fall, line.values.nozzle.depth) == (0.2, 0.06)
    assert line.values.ground.segments[0].speed == pytest.approx(0.3)
    assert line.assumed[0] == "spacing 40 cm"
    assert "ground.segments[1].speed 1.08 km/h" in line.assumed
    assert "arms.cups_to_planting 6" in line.assumed


def test_a_ground_file_states_speeds_hills_and_stops(tmp_path: Path) -> None:
    (tmp_path / "ground.yaml").write_text(GROUND, encoding="utf-8")
    ground = load_ground(tmp_path / "ground.yaml")
    speed, ramp, hill, stand = ground.values.segments
    assert speed.speed == pytest.approx(1.5 / 3.6)
    assert speed.over is not None
    assert (speed.over.for_m, speed.over.for_s) == (20.0, None)
    assert ramp.over is not None
    assert (ramp.ramp_to, ramp.over.for_m, ramp.over.for_s) == (0.5, None, 60.0)
    assert (hill.hill, stand.stand) == (0.08, 10.0)
    assert ground.assumed == ("segments[4].stand 10 s", "slip.mean 5 %")


@pytest.mark.parametrize(
    ("old", "new", "line", "expected"),
    [
        ("40 cm, assumed", "40", 3, "spacing: '40': the unit is missing; write for example 40 cm"),
        ("40 cm, assumed", "4 kg", 3, "spacing: '4 kg': kg is a unit of another quantity; use m or cm or mm or um"),
        ("40 cm, assumed", "40 m", 3, "spacing: 40 m is out of range; must be 0.1 to 2 m"),
        ("spacing:", "spacng:", 3, "spacng: unknown key; did you mean spacing?"),
        ("kind: ground_wheel", "kind: horse", 5, "drive.kind: cannot be 'horse'; write ground_wheel or own_motor"),
        ("kind: ground_wheel", "kind: own_motor", 4, "drive: own_motor requires lag"),
        ("kind: ground_wheel", "kind: ground_wheel\n  lag: 1 s", 4, "drive: lag does not apply to ground_wheel"),
        ("over: 100 m", "over: 100", 10, "ground.segments[1].over: '100': must be a length or a time above 0"),
        ("over: 100 m", "over: 0 m", 10, "ground.segments[1].over: '0 m': must be a length or a time above 0"),
        (", over: 100 m", "", 10, "ground.segments[1]: speed requires over"),
        ("over: 100 m", "stand: 1 s", 10, "ground.segments[1]: must contain exactly one of speed, ramp_to, hill"),
        ('speed: "1.08 km/h, assumed"', "hill: 5 %", 7, "ground: the first segment must have a speed or ramp_to"),
        ("nozzle:", "planter: {}\nnozzle:", 2, "file: must contain either nozzle or planter"),
        ("arms:", "conveyor: {rate: 90/min}\narms:", 2, "file: must contain either conveyor or arms"),
        ("nozzle:", "chute: {transit: 1 s, window: 9 %}\nnozzle:", 2, "file: chute is required between arms and"),
        ("tilted: 5 %, assumed", "tilted: 99 %", 14, "nozzle: tilted and lodged add up to more than 100 %"),
        ("fall: 0.2 s, assumed", "fall: true", 15, "nozzle.fall: must be a number with its unit, such as 0.2 s"),
        ("6, assumed", "six", 13, "arms.cups_to_planting: cannot be 'six'; write the number of cups from the last"),
        ("  fall: 0.2 s, assumed\n", "", 14, "nozzle.fall: is missing"),
    ],
)  # fmt: skip
def test_an_invalid_line_is_rejected_in_one_line(tmp_path: Path, old: str, new: str, line: int, expected: str) -> None:
    assert PEPPER.count(old) == 1
    path = tmp_path / "line.yaml"
    path.write_text(PEPPER.replace(old, new), encoding="utf-8")
    with pytest.raises(LineError) as caught:
        load_line(path)
    assert str(caught.value).startswith(f"{path}:{line}: {expected}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("mean: \"5 %, assumed\"", "mean: 95 %", "7: slip.mean: 95 % is out of range; must be 0 to 0.9"),
        ("slip: {", "slipp: {", "7: slipp: unknown key; did you mean slip?"),
        ("segments:", "segments: []\nold:", "2: segments: cannot be an empty list; write a list such as"),
        ("hill: 8 %", "hill: 80 %", "5: segments[3].hill: 80 % is out of range; must be -0.5 to 0.5"),
    ],
)  # fmt: skip
def test_an_invalid_ground_is_rejected_in_one_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert GROUND.count(old) == 1
    path = tmp_path / "ground.yaml"
    path.write_text(GROUND.replace(old, new), encoding="utf-8")
    with pytest.raises(LineError) as caught:
        load_ground(path)
    text = str(caught.value).removeprefix(f"{path}:")
    assert expected.partition(": ")[2] in text
    assert "\n" not in text


def test_an_unknown_line_is_suggested() -> None:
    with pytest.raises(LineError, match=r"peper: unknown line; did you mean pepper\?"):
        find_line("peper")
