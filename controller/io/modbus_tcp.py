"""The field I/O over Modbus TCP: one FC02 and one FC15 a scan where the map allows it.

pymodbus' synchronous client is given no second chances (`retries=0`) and never reconnects by
itself: a scan must know within its own time that the field did not answer.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pymodbus.client import ModbusTcpClient
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import ReadDiscreteInputsRequest, WriteMultipleCoilsRequest

from controller.io.link import LinkError
from controller.io_map import IoMap, Point

# Every failure below becomes one LinkError; pymodbus' own lines would only repeat it each scan.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Run:
    """Points with neighbouring Modbus offsets, moved in one transfer.

    Attributes:
        first_offset: Modbus offset of the first point.
        numbers: X or Y number of each point, by rising offset.
    """

    first_offset: int
    numbers: tuple[int, ...]


def group_into_runs(points: Iterable[Point]) -> tuple[Run, ...]:
    """Group points into the fewest transfers that touch no offset outside the map."""
    numbers_by_offset = {point.offset: point.number for point in points}
    runs: list[tuple[int, list[int]]] = []
    for offset in sorted(numbers_by_offset):
        if not runs or offset != runs[-1][0] + len(runs[-1][1]):
            runs.append((offset, []))
        runs[-1][1].append(numbers_by_offset[offset])
    return tuple(Run(first_offset, tuple(numbers)) for first_offset, numbers in runs)


class ModbusTcpLink:
    """A `FieldLink` to a Modbus TCP server: a remote I/O module, or the simulated plant.

    The image is moved in one transfer when the offsets in the I/O map leave no gap, else in one
    transfer per gapless run, because strict modules answer an undeclared offset with an exception.
    """

    def __init__(self, host: str, port: int, io_map: IoMap, *, unit: int = 1, timeout_s: float = 0.05) -> None:
        """Prepare the link; nothing is sent before `open`.

        Args:
            host: Name or address of the server.
            port: TCP port, usually 502; the simulated plant has 5020.
            io_map: Where every point lies.
            unit: Modbus unit identifier.
            timeout_s: Longest wait for a connection and for each answer, s; an answer that comes in
                pieces may take twice as long.
        """
        self._where = f"{host}:{port}"
        self._unit = unit
        self._timeout_ms = round(timeout_s * 1_000)
        self._input_runs = group_into_runs(io_map.inputs)
        self._output_runs = group_into_runs(io_map.outputs)
        self._input_count = io_map.input_count
        self._output_count = io_map.output_count
        self._client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)

    def open(self) -> None:
        """Connect.

        Raises:
            LinkError: nobody listens there, or not within the timeout.
        """
        if not self._client.connect():  # type: ignore[no-untyped-call]
            raise LinkError(
                f"no field I/O at {self._where}: not reachable within {self._timeout_ms} ms; "
                "check the address and that the I/O module or plant server is running"
            )
        if self._client.socket is not None:
            # Without this the kernel may hold a small frame back for 40 ms, four scans.
            self._client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Returns:
            Levels by X number; numbers that are not in the map read False.

        Raises:
            LinkError: closed, no answer in time, refused, or a wrong number of bits.
        """
        image = [False] * self._input_count
        for run in self._input_runs:
            count = len(run.numbers)
            what = f"read of {count} inputs from offset {run.first_offset}"
            request = ReadDiscreteInputsRequest(address=run.first_offset, count=count, dev_id=self._unit)
            bits = self._exchange(what, request).bits
            if not count <= len(bits) < count + 8:  # answers come in whole bytes
                raise self._failed(what, f"{len(bits)} bits came back")
            for number, level in zip(run.numbers, bits, strict=False):
                image[number] = level
        return image

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image, in rising order of offsets.

        Args:
            image: Levels by Y number; those of numbers that are not in the map go nowhere.

        Raises:
            LinkError: closed, no answer in time, or refused.
            ValueError: the image has the wrong length.
        """
        if len(image) != self._output_count:
            raise ValueError(f"Y image has {len(image)} levels, the map {self._output_count}")
        for run in self._output_runs:
            levels = [image[number] for number in run.numbers]
            what = f"write of {len(levels)} outputs from offset {run.first_offset}"
            reply = self._exchange(
                what,
                WriteMultipleCoilsRequest(address=run.first_offset, bits=levels, dev_id=self._unit),
            )
            if (reply.address, reply.count) != (run.first_offset, len(levels)):
                raise self._failed(what, f"answer names {reply.count} from {reply.address}")

    def close(self) -> None:
        """Close the connection; does nothing when closed."""
        self._client.close()  # type: ignore[no-untyped-call]

    def _exchange(self, what: str, request: ModbusPDU) -> ModbusPDU:
        """Send a request and return its answer, or close the link and say why there is none."""
        if not self._client.connected:  # pymodbus would silently connect again
            raise self._failed(what, "the link is not open")
        try:
            reply = self._client.execute(False, request)
        except ConnectionException as error:
            raise self._failed(what, "connection lost") from error
        except ModbusException as error:
            raise self._failed(what, f"no valid answer within {self._timeout_ms} ms") from error
        except OSError as error:
            raise self._failed(what, str(error)) from error
        if isinstance(reply, ExceptionResponse):
            raise self._failed(what, f"refused with exception {_exception_name(reply)}")
        if reply.function_code != request.function_code:
            raise self._failed(what, f"answer to another function ({reply.function_code})")
        return reply

    def _failed(self, what: str, reason: str) -> LinkError:
        """Close the connection and make the error: a late answer must never meet a new question."""
        self.close()
        return LinkError(f"field I/O at {self._where}: {what}: {reason}")


def _exception_name(reply: ExceptionResponse) -> str:
    code = reply.exception_code
    name = ExcCodes(code).name.lower().replace("_", " ") if code in set(ExcCodes) else "unknown"
    return f"{code:02d} ({name})"
