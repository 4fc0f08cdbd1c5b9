"""Random faults of a serial line: no wrong bit is taken as good."""

from __future__ import annotations

import random
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.io.link import LinkError
from tests.controller.io.field.field_rig import INPUT_TAGS, IO_MAP, OUTPUT_TAGS, FieldRig, device, file_of, wires
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import SerialModules, crc
from tests.sampling import first_of

EXCHANGES = 150
KINDS = ("cut", "garbage", "flipped", "wrong unit", "wrong function", "late", "silent", "exception", "noise before")


class FaultyLine:
    """Alteration of the answers of a line.

    Attributes:
        faults: Number of faults by kind.
    """

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.faults: Counter[str] = Counter()
        self.share = 0.0
        self._held: list[bytes] = []

    def alter(self, frame: bytes) -> list[bytes]:
        held, self._held = self._held, []
        if self.random.random() >= self.share:
            return [*held, frame]
        kind = self.random.choice(KINDS)
        self.faults[kind] += 1
        opposite = bytes(byte ^ 0xFF for byte in frame[3:-2])
        match kind:
            case "cut":
                return [*held, frame[: self.random.randrange(1, len(frame))]]
            case "garbage":
                return [*held, self.random.randbytes(self.random.randrange(1, 20))]
            case "flipped":
                bit = self.random.randrange(8 * len(frame))
                return [*held, (int.from_bytes(frame) ^ 1 << bit).to_bytes(len(frame))]
            case "wrong unit":
                return [*held, checked(bytes([frame[0] ^ 0x10]) + frame[1:3] + opposite)]
            case "wrong function":
                return [*held, checked(frame[:1] + bytes([frame[1] ^ 1]) + frame[2:3] + opposite)]
            case "late":
                self._held = [checked(frame[:3] + opposite)]
                return held
            case "silent":
                return held
            case "exception":
                return [*held, checked(frame[:1] + bytes([frame[1] | 0x80, 4]))]
            case _:
                return [*held, self.random.randbytes(self.random.randrange(1, 4)) + frame]


def checked(body: bytes) -> bytes:
    return body + crc(body)


@pytest.mark.parametrize("seed", first_of(range(1, 11)))
def test_an_accepted_image_is_that_of_the_device(seed: int, tmp_path: Path) -> None:
    """Two units on a line, inputs that change at random; late answers have the opposite bits and a valid checksum."""
    faulty = FaultyLine(seed)
    boxes = {1: Box(), 2: Box()}
    with ExitStack() as stack:
        line = stack.enter_context(SerialModules(str(tmp_path / "tty"), dict(boxes)))
        line.alter = faulty.alter
        path = file_of(
            tmp_path,
            device("sensors", "inputs-only", "line: bus", wires(INPUT_TAGS), "unit: 1", timeout_ms=20),
            device("valves", "coils", "line: bus", wires(OUTPUT_TAGS), "unit: 2", timeout_ms=20),
            lines=f"lines:\n  - {{name: bus, device: {line.path}, baud: 115200, frame: 8N1}}\n",
        )
        link = FieldRig(path, []).link
        stack.callback(link.close)
        faulty.share = 0.3
        accepted = [0, 0]
        for _ in range(EXCHANGES):
            boxes[1].inputs = [faulty.random.random() < 0.5 for _ in boxes[1].inputs]
            wanted = [faulty.random.random() < 0.5 for _ in range(IO_MAP.output_count)]
            try:
                link.open()
                image = link.read_inputs()
                assert [image[point.number] for point in IO_MAP.inputs] == boxes[1].inputs[: len(INPUT_TAGS)]
                accepted[0] += 1
                link.write_outputs(wanted)
                assert boxes[2].outputs[: len(OUTPUT_TAGS)] == [wanted[point.number] for point in IO_MAP.outputs]
                accepted[1] += 1
            except LinkError:
                continue
    assert {*faulty.faults} == {*KINDS}
    assert min(accepted) > EXCHANGES / 10
