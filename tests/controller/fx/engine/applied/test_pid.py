"""PID: a closed loop against its definition, alarms, limits, and the treatment of the output register."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.fx.engine.applied.pid import AUTO_TUNING_ERROR
from controller.fx.engine.cpu import OperationError
from tests.controller.fx.engine.applied.fx_applied_rig import Rig

REVERSE, INPUT_ALARM, OUTPUT_ALARM, LIMITED = 1, 2, 4, 32


def pid(**parameters: int) -> tuple[Rig, Callable[[bool], None]]:
    """Return a rig with SV D0, PV D1, MV D2 and the parameters from D10, by offset."""
    rig = Rig({"D10": 100, "D13": 100})
    rig.set({f"D{10 + int(name[1:])}": value for name, value in parameters.items()})
    return rig, rig.level("PID D0 D1 D10 D2")


def scan(rig: Rig, level: Callable[[bool], None], now_ms: int, **state: int) -> int:
    rig.set(state)
    rig.cpu.now_ms = now_ms
    level(True)
    return rig.memory.D[2]


def test_closed_loop_reaches_the_set_value() -> None:
    """A first-order process of gain 1 and time constant 5 s is controlled to 500 without a remaining deviation."""
    rig, level = pid(S1=REVERSE, S2=30, S3=150, S4=40, S5=20, S6=20)
    value = 0.0
    for now_ms in range(0, 60_000, 10):
        value += (scan(rig, level, now_ms, D0=500, D1=round(value)) - value) * 10 / 5_000
    assert abs(value - 500) < 1


def test_reference_of_the_equations_with_all_terms() -> None:
    """Twenty samples of an arbitrary input against the equations of the manual, written out with lists."""
    rig, level = pid(S1=0, S2=25, S3=130, S4=7, S5=40, S6=9)
    inputs = [round(100 + 40 * ((n * 7) % 5) - 13 * (n % 3)) for n in range(20)]
    measured, error, derivative, output = [100.0, 100.0], [100.0 - 90], [0.0], 0.0
    assert scan(rig, level, 0, D0=90, D1=100) == 0
    for n, value in enumerate(inputs, 1):
        measured.append(value + 0.25 * (measured[-1] - value))
        error.append(measured[-1] - 90)
        second = measured[-1] - 2 * measured[-2] + measured[-3]
        derivative.append(90 / (100 + 0.4 * 90) * second + 0.4 * 90 / (100 + 0.4 * 90) * derivative[-1])
        output += 1.3 * (error[-1] - error[-2] + 100 / 700 * error[-1] + derivative[-1])
        assert scan(rig, level, 100 * n, D1=value) == int(output)


def test_alarms_of_input_and_output() -> None:
    rig, level = pid(S1=INPUT_ALARM | OUTPUT_ALARM, S20=10, S21=20, S22=10, S23=30)
    scan(rig, level, 0)
    seen = []
    for n, value in enumerate((10, 21, 22, 1, -31), 1):
        scan(rig, level, 100 * n, D1=value)
        seen.append(rig.memory.D[34])
    assert seen == [0, 0b0101, 0, 0b0010, 0b1010]


def test_limits_and_an_output_written_by_the_program() -> None:
    rig, level = pid(S1=LIMITED, S22=30, S23=-5)
    scan(rig, level, 0)
    assert [scan(rig, level, 100, D1=50), scan(rig, level, 200, D1=0), scan(rig, level, 300, D1=0)] == [
        30,
        -5,
        -5,
    ]
    assert scan(rig, level, 400, D2=20, D1=3) == 23


def test_a_late_sampling_is_not_repeated() -> None:
    rig, level = pid(S4=1)
    scan(rig, level, 0)
    assert scan(rig, level, 350, D1=10) == 20
    assert [scan(rig, level, ms) for ms in (400, 449, 450)] == [20, 20, 30]


def test_it_begins_again_after_its_drive_was_off() -> None:
    rig, level = pid()
    scan(rig, level, 0)
    assert scan(rig, level, 100, D1=10) == 10
    level(False)
    assert scan(rig, level, 1_000, D1=500) == 10
    assert scan(rig, level, 1_100, D1=501) == 11


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("S0", 0, 6730),
        ("S2", 100, 6732),
        ("S3", 0, 6733),
        ("S4", -1, 6734),
        ("S5", 101, 6735),
        ("S6", -1, 6736),
        ("S1", 16, AUTO_TUNING_ERROR),
    ],
)
def test_invalid_parameters(name: str, value: int, code: int) -> None:
    _, level = pid(**{name: value})
    with pytest.raises(OperationError) as caught:
        level(True)
    assert caught.value.code == code
