"""The recorder: one row a scan of everything the machine is and does, kept cheaply and written in groups."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
import pyarrow as pa

from controller.io_map import IoMap
from plant_sim.kernel import MACHINE
from plant_sim.parameters import Machine
from plant_sim.plant import Plant
from plant_sim.scope.columns import columns_of, numbers_of
from plant_sim.scope.store import TIME, Writer, described

Value = bool | int | float | str

SAMPLE_MS = 10
ROWS_A_GROUP = 6_000
LIVE_ROWS_A_GROUP = 500
"""Where somebody waits in real time: a group then takes about as long as a scan, not as several."""

_TEXT = pa.dictionary(pa.int32(), pa.string())
_MOVE = pa.struct([("tray", pa.int32()), ("column", pa.int8()), ("cell", pa.int8()), ("place", pa.string())])
_KINDS: dict[type, pa.DataType] = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: _TEXT}


class _Tag(NamedTuple):
    """An extra column: what to ask at every sample, and the answers not yet written."""

    read: Callable[[], Value]
    values: list[Value]


class Recorder:
    """Records a plant to a Parquet file; use it as a context, so that the file is completed whatever happens.

    A row holds the plant at one instant: `TIME`, every number of the machine by its dotted name (see
    `columns_of`), ``x.`` and ``y.`` with the logical state of every wire, the extra tags, the ``faults``
    in force, and ``seedlings``: those that moved since the row before.
    """

    def __init__(
        self,
        plant: Plant,
        path: Path,
        *,
        io_map: IoMap,
        machine: Machine,
        seed: int,
        tags: Mapping[str, Callable[[], Value]] | None = None,
        outputs: Callable[[], Sequence[bool]] | None = None,
        sample_ms: int = SAMPLE_MS,
        rows_a_group: int = ROWS_A_GROUP,
    ) -> None:
        """Begin a recording; nothing is sampled yet.

        Args:
            plant: What is recorded; one recorder at a time.
            path: Where the recording is to lie; there must be nothing.
            io_map: The wires.
            machine: The parameters of the plant.
            seed: Its seed.
            tags: More columns by name; each is asked at every sample and always answers in the same type.
            outputs: The raw Y image in force; that of the plant's last step by default.
            sample_ms: Least time between two samples, ms of plant time.
            rows_a_group: How many rows are kept in memory and written together.

        Raises:
            RecordingError: the file cannot be had.
            ValueError: somebody records the plant already.
        """
        if plant.seedlings.moves is not None:
            raise ValueError("the plant is recorded already; close that recorder first")
        self._plant = plant
        self._outputs = outputs or (lambda: plant.y)
        self._sample_ms = sample_ms
        self._rows_a_group = rows_a_group
        self._inputs, self._output_wires = io_map.inputs, io_map.outputs
        self._numbers = columns_of(MACHINE)
        self._about = {
            "sample_ms": sample_ms,
            "seed": seed,
            "parameters": asdict(machine),
            "make": numbers_of(plant.make),
            "versions": _versions(),
        }
        self._tags = {name: _Tag(read, []) for name, read in (*(tags or {}).items(), ("faults", self._faults))}
        self._times_ms: list[int] = []
        self._frames: list[bytes] = []
        self._x: list[bytes] = []
        self._y: list[bytes] = []
        self._moves: list[dict[str, int | str]] = []
        self._moves_before: list[int] = []  # of every row: how many moves belong to the rows before it
        self._due_ms = plant.time_ms
        self._schema: pa.Schema | None = None  # known with the first rows
        self._writer: Writer | None = Writer(path)
        plant.seedlings.moves = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def sample(self) -> None:
        """Keep this instant, unless the last sample is too near; does nothing once closed.

        Raises:
            RecordingError: a group of rows is due and the disk refuses it.
        """
        plant = self._plant
        now_ms = plant.time_ms
        if now_ms < self._due_ms or self._writer is None:
            return
        self._due_ms = now_ms - now_ms % self._sample_ms + self._sample_ms
        self._times_ms.append(now_ms)
        self._frames.append(plant.state.tobytes())  # a copy of the bytes; one by fields takes 700 times as long
        self._x.append(bytes(plant.x))
        self._y.append(bytes(self._outputs()))
        for read, values in self._tags.values():
            values.append(read())
        self._moves_before.append(len(self._moves))
        if plant.seedlings.moves:
            self._take_moves()
        if len(self._times_ms) >= self._rows_a_group:
            self._write(self._writer)

    def close(self) -> None:
        """Write what is left and give the file its name; a recording without samples leaves no file.

        Raises:
            RecordingError: the disk refuses.
        """
        writer, self._writer = self._writer, None
        if writer is None:
            return
        self._plant.seedlings.moves = None
        if self._times_ms:
            self._write(writer)
        writer.finish()

    def _take_moves(self) -> None:
        moves = self._plant.seedlings.moves or []
        self._moves += [
            {"tray": plant.tray, "column": plant.column, "cell": plant.along, "place": place.name.lower()}
            for plant, place in moves
        ]
        moves.clear()

    def _faults(self) -> str:
        active = self._plant.faults.active
        return "; ".join(str(fault).partition("@")[0] for fault in active) if active else ""

    def _write(self, writer: Writer) -> None:
        """Turn the rows kept so far into columns, hand them over and forget them."""
        columns = self._columns()
        if self._schema is None:
            self._schema = described(pa.schema([field for field, _ in columns]), self._about)
        writer.write(pa.Table.from_arrays([array for _, array in columns], schema=self._schema))
        for kept in (self._times_ms, self._frames, self._x, self._y, self._moves, self._moves_before):
            kept.clear()
        for tag in self._tags.values():
            tag.values.clear()

    def _columns(self) -> list[tuple[pa.Field, pa.Array]]:
        columns = [(pa.field(TIME, pa.int64(), nullable=False), pa.array(self._times_ms, pa.int64()))]
        frames = np.frombuffer(b"".join(self._frames), MACHINE)
        for number in self._numbers:
            array = pa.array(number.of(frames))
            note = {"unit": number.unit} if number.unit else None
            columns.append((pa.field(number.name, array.type, metadata=note), array))
        for device, wires, images in (("x", self._inputs, self._x), ("y", self._output_wires, self._y)):
            levels = np.frombuffer(b"".join(images), np.bool_).reshape(len(images), -1)
            for point in wires:
                note = {"terminal": point.address}
                field = pa.field(f"{device}.{point.tag}", pa.bool_(), metadata=note)
                columns.append((field, pa.array(levels[:, point.number] != point.inverted)))
        for name, tag in self._tags.items():
            kind = _KINDS[type(tag.values[0])]
            columns.append((pa.field(name, kind), _column(tag.values, kind)))
        ends = pa.array([*self._moves_before, len(self._moves)], pa.int32())
        moves = pa.ListArray.from_arrays(ends, pa.array(self._moves, _MOVE))
        return [*columns, (pa.field("seedlings", moves.type), moves)]


def _column(values: list[Value], kind: pa.DataType) -> pa.Array:
    if kind != _TEXT:
        return pa.array(values, kind)
    codes = {text: code for code, text in enumerate(dict.fromkeys(values))}
    texts = pa.array(list(codes), pa.string())
    return pa.DictionaryArray.from_arrays(pa.array([codes[text] for text in values], pa.int32()), texts)


def _versions() -> dict[str, str]:
    packages = ("seedling-transplanter", "numpy", "numba", "pyarrow")
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
