"""Points of an I/O map: logical states and terminal levels."""

import pytest

from controller.common.modbus.io_map import ModbusTable, Point, Polarity


@pytest.mark.parametrize(
    ("polarity", "level_when_active"),
    [
        (Polarity.NORMALLY_OPEN, True),
        (Polarity.NORMALLY_CLOSED, False),
        (Polarity.ACTIVE_HIGH, True),
        (Polarity.ACTIVE_LOW, False),
    ],
)
def test_level_and_active_are_inverse_functions(polarity: Polarity, level_when_active: bool) -> None:
    point = Point("stop", "X24", "X", 20, "", polarity, True, ModbusTable.DISCRETE_INPUT, 20, False, True, False, 1)
    assert point.level(True) is level_when_active
    assert point.level(False) is not level_when_active
    assert point.inverted is not level_when_active
    for state in (False, True):
        assert point.active(point.level(state)) is state
        assert point.level(point.active(state)) is state
