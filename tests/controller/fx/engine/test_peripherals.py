"""Peripherals: the file, the analogue modules and the serial line."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

from controller.fx.engine.peripherals.analogue import AnalogueInputs, AnalogueSignal, CombinedAnalogue
from controller.fx.engine.peripherals.buffer_module import BufferModule
from controller.fx.engine.peripherals.peripherals import PeripheralError, load_peripherals
from controller.fx.engine.peripherals.serial_line import FxSerialLine, SerialAnswer

GOOD = """\
modules:
  - {position: 0, model: FX2N-4AD, inputs: [{at_ms: 0, channel: 1, value: 2.5}]}
  - {position: 1, model: FX0N-3A}
  - {position: 2, model: buffer, size: 50, initial: {30: 2030, 49: -1}}
serial:
  received: [{at_ms: 100, bytes: "02 41 03"}]
  answers: [{request: "05", delay_ms: 20, bytes: "06"}]
"""


def loaded(tmp_path: Path, text: str) -> list[str]:
    """Return the errors of a file; empty = none."""
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    try:
        load_peripherals(path)
    except PeripheralError as error:
        return str(error).replace(f"{tmp_path}/", "").splitlines()
    return []


def test_file(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(GOOD, encoding="utf-8")
    found = load_peripherals(path)
    assert [type(module) for module in found.modules.values()] == [AnalogueInputs, CombinedAnalogue, BufferModule]
    assert found.modules[2].words[49] == -1
    assert found.record() == {
        "modules": {
            "0": {"1": 8, "2": 8, "3": 8, "4": 8, "21": 1, "24": 5000, "30": 2010},
            "1": {},
            "2": {"30": 2030, "49": -1},
        },
        "serial": [],
    }
    assert load_peripherals(path).modules[2] is not found.modules[2]


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("position: 1", "position: 8", "p.yaml:3: modules[2].position: cannot be 8; write the position of the module"),
        ("position: 1", "position: 0", "p.yaml:1: file: two modules have the position 0"),
        ("FX0N-3A", "FX2N-4DA", "p.yaml:3: modules[2].model: cannot be 'FX2N-4DA'; write FX2N-4AD, FX0N-3A, or buffer"),
        ("channel: 1", "channel: 5", "p.yaml:2: modules[1].inputs[1].channel: cannot be 5"),
        ("value: 2.5", "value: 51", "p.yaml:2: modules[1].inputs[1].value: 51 is not a value of an analogue input"),
        ("size: 50", "size: 49", "p.yaml:4: modules[3]: word 49 is outside the buffer memory; increase size"),
        ("FX0N-3A", "FX0N-3A, size: 5", "p.yaml:3: modules[2]: size and initial belong to the model buffer"),
        ("30: 2030", "30: 40000", "p.yaml:4: modules[3].initial: '30': 40000 is not a word"),
        ("02 41 03", "02 4", "p.yaml:6: serial.received[1].bytes: '02 4' is not a sequence of bytes"),
        ("delay_ms: 20", "delay: 20", "p.yaml:7: serial.answers[1].delay: unknown key; did you mean delay_ms?"),
    ],
)
def test_error_has_line_key_and_remedy(tmp_path: Path, old: str, new: str, line: str) -> None:
    assert old in GOOD
    (found,) = loaded(tmp_path, GOOD.replace(old, new))
    assert found.startswith(line)
    assert "; " in found


def signal(*changes: tuple[int, float]) -> AnalogueSignal:
    return AnalogueSignal(tuple(at_ms for at_ms, _ in changes), tuple(value for _, value in changes))


def inputs(*signals: AnalogueSignal) -> AnalogueInputs:
    return AnalogueInputs([*signals, *[signal()] * (4 - len(signals))])


def test_4ad_converts_in_its_time_and_averages() -> None:
    """Two enabled channels take 30 ms; the average of 4 samples after a step from 0 to 5 V is 250 more every 30 ms."""
    module = inputs(signal((1, 5.0)))
    module.write(0, [0x3300, 4, 4], 0)
    assert [module.read(9, 1, at_ms) for at_ms in (0, 29, 30)] == [[0], [0], [1000]]
    assert [module.read(5, 1, at_ms)[0] for at_ms in (30, 60, 90, 120)] == [500, 666, 750, 1000]


def test_4ad_modes_status_and_limits() -> None:
    module = inputs(signal((0, 10.0)), signal((0, 4.0)), signal((0, -20.0)), signal((0, 5.0)))
    module.write(0, [0x3210, 1, 1, 1, 1], 0)
    assert module.read(9, 4, 0) == [2000, 0, -1000, 0]
    assert module.read(29, 2, 0) == [0, 2010]
    module = inputs(signal((0, 11.0)))
    module.write(1, [0], 0)
    assert module.read(9, 1, 0) == [2047]
    assert module.read(29, 1, 0) == [1 << 10 | 1 << 11]
    module.write(30, [5], 0)
    assert module.read(30, 1, 0) == [2010]


def test_4ad_offset_gain_reset_and_speed() -> None:
    module = inputs(signal((0, 2.5)))
    module.write(23, [1000, 3500], 0)
    module.write(22, [0b11], 0)
    assert module.read(9, 2, 0) == [600, 0]
    module.write(21, [2], 0)
    module.write(23, [0, 2500], 0)
    module.write(22, [0b11], 0)
    assert module.read(9, 1, 0) == [600]
    assert module.read(29, 1, 0) == [1 << 12]
    module.write(20, [1], 0)
    assert module.read(9, 1, 0) == [500]
    assert module.read(20, 2, 0) == [0, 1]
    slow, fast = inputs(signal((0, 0.0), (1, 5.0))), inputs(signal((0, 0.0), (1, 5.0)))
    fast.write(15, [1], 0)
    assert [module.read(9, 1, 24) for module in (slow, fast)] == [[0], [1000]]


def test_0n_3a_by_buffer_memory() -> None:
    module = CombinedAnalogue([signal((0, 5.0)), signal((0, 11.0))])
    for value in (0, 2):
        module.write(17, [value], 0)
    assert module.read(0, 1, 0) == [125]
    for value in (1, 3):
        module.write(17, [value], 0)
    assert module.read(0, 1, 0) == [255]
    module.write(16, [77], 0)
    for value in (4, 0):
        assert module.output == 0
        module.write(17, [value], 0)
    assert module.output == 77


def test_words_outside_the_buffer_memory() -> None:
    module = BufferModule(10, {})
    for first, count in ((-1, 1), (9, 2), (10, 1)):
        with pytest.raises(IndexError):
            module.read(first, count, 0)
        with pytest.raises(IndexError):
            module.write(first, [0] * count, 0)


def test_serial_line_delivers_bytes_in_their_time() -> None:
    line = FxSerialLine([(10, b"abc"), (11, b"d")], [SerialAnswer(b"?", 5, b"!")])
    byte_ms = Fraction(2)
    assert line.take(11, byte_ms) == []
    assert line.take(14, byte_ms) == [(Fraction(12), ord("a")), (Fraction(14), ord("b"))]
    assert line.take(100, byte_ms) == [(Fraction(16), ord("c")), (Fraction(18), ord("d"))]
    line.send(b"?", Fraction(201, 2))
    line.send(b"x", Fraction(300))
    assert line.take(107, byte_ms) == []
    assert line.take(108, byte_ms) == [(Fraction(215, 2), ord("!"))]
    assert line.sent == [(101, b"?"), (300, b"x")]
