"""Field I/O over Modbus TCP: one FC02 and one FC15 per scan if the I/O map permits it, and FC16 for output registers.

The synchronous pymodbus client is used without retries (`retries=0`) and without automatic
reconnection, so that a missing response is detected within the scan.
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
from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadDiscreteInputsRequest, WriteMultipleCoilsRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
)

from controller.common.modbus.output_owner import REPORT_OFFSET, REPORT_WORDS, OwnerReport
from controller.io.link import LinkError, OutputsTakenError
from controller.iomap.loader import IoMap, OutputRegister, Point

# Every failure below raises a LinkError; the log messages of pymodbus would repeat it in every scan.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Run:
    """Points with consecutive Modbus offsets, transferred in one request.

    Attributes:
        first_offset: Modbus offset of the first point.
        numbers: X, Y or D number of each point, in ascending order of offsets.
    """

    first_offset: int
    numbers: tuple[int, ...]


def group_into_runs(points: Iterable[Point | OutputRegister]) -> tuple[Run, ...]:
    """Group points into the smallest number of requests that contain no offset outside the map."""
    numbers_by_offset = {point.offset: point.number for point in points}
    runs: list[tuple[int, list[int]]] = []
    for offset in sorted(numbers_by_offset):
        if not runs or offset != runs[-1][0] + len(runs[-1][1]):
            runs.append((offset, []))
        runs[-1][1].append(numbers_by_offset[offset])
    return tuple(Run(first_offset, tuple(numbers)) for first_offset, numbers in runs)


class ModbusTcpLink:
    """`FieldLink` to a Modbus TCP server: a remote I/O module or the simulated plant.

    An image is transferred in one request if the offsets in the I/O map are consecutive, otherwise in
    one request per run of consecutive offsets, because strict modules reject a request for an
    undeclared offset with an exception response.

    Attributes:
        lends: True for a module that lends its outputs to one client at a time and reports the owner. Its refusal of a
            write with exception 06 raises `OutputsTakenError`.
        outputs: Y numbers of the wired outputs.
    """

    def __init__(self, host: str, port: int, io_map: IoMap, *, unit: int = 1, timeout_s: float = 0.05) -> None:
        """Create a closed link; `open` connects it.

        Args:
            host: Name or address of the server.
            port: TCP port, usually 502; 5020 for the simulated plant.
            io_map: I/O map with the Modbus offsets of the points.
            unit: Modbus unit identifier.
            timeout_s: Timeout of the connection and of each answer, s; an answer in several segments
                may take twice as long.
        """
        self.lends = False
        self.outputs = tuple(point.number for point in io_map.outputs)
        self._address = f"{host}:{port}"
        self._unit = unit
        self._timeout_ms = round(timeout_s * 1_000)
        self._input_runs = group_into_runs(io_map.inputs)
        self._output_runs = group_into_runs(io_map.outputs)
        self._register_runs = group_into_runs(io_map.registers)
        self._registers = [register.number for register in io_map.registers]
        self._input_count = io_map.input_count
        self._output_count = io_map.output_count
        self._client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)

    def open(self) -> None:
        """Connect.

        Raises:
            LinkError: The server is not reachable within the timeout.
        """
        if not self._client.connect():  # type: ignore[no-untyped-call]
            raise LinkError(
                f"no field I/O at {self._address}: not reachable within {self._timeout_ms} ms; "
                "check the address and that the I/O module or plant server is running"
            )
        if self._client.socket is not None:
            # Without TCP_NODELAY the kernel may delay a small frame by 40 ms, four scans.
            self._client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Returns:
            Levels by X number; numbers that are not in the map are False.

        Raises:
            LinkError: The link is closed, or the answer is late, malformed or an exception response.
        """
        return self._image("inputs", ReadDiscreteInputsRequest, self._input_runs, self._input_count)

    def read_outputs(self) -> list[bool]:
        """Read back the raw Y image.

        Returns:
            Levels by Y number; numbers that are not in the map are False.

        Raises:
            LinkError: The link is closed, or the answer is late, malformed or an exception response.
        """
        return self._image("outputs", ReadCoilsRequest, self._output_runs, self._output_count)

    def read_owner(self) -> OwnerReport:
        """Read who owns the outputs.

        Raises:
            LinkError: The link is closed, the answer is late, malformed or an exception response, or the module does
                not report the owner.
        """
        operation = "read of the owner of the outputs"
        request = ReadInputRegistersRequest(address=REPORT_OFFSET, count=REPORT_WORDS, dev_id=self._unit)
        words = self._exchange(operation, request).registers
        report = OwnerReport.decode(words) if len(words) == REPORT_WORDS else None
        if report is None:
            raise self._failed(operation, "answer contains no report")
        return report

    def read_setting(self, address: int) -> int:
        """Read one holding register.

        Raises:
            LinkError: The link is closed, or the answer is late, malformed or an exception response.
        """
        operation = f"read of register {address:#06x}"
        reply = self._exchange(operation, ReadHoldingRegistersRequest(address=address, count=1, dev_id=self._unit))
        if len(reply.registers) != 1:
            raise self._failed(operation, f"answer contains {len(reply.registers)} registers")
        return reply.registers[0]

    def write_setting(self, address: int, value: int) -> None:
        """Write one holding register.

        Raises:
            LinkError: The link is closed, or the answer is late, malformed or an exception response.
        """
        request = WriteMultipleRegistersRequest(address=address, registers=[value], dev_id=self._unit)
        self._exchange(f"write of register {address:#06x}", request)

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image, in ascending order of offsets.

        Args:
            image: Levels by Y number; numbers that are not in the map are ignored.

        Raises:
            OutputsTakenError: The outputs belong to another master.
            LinkError: The link is closed, or the answer is late, malformed or an exception response.
            ValueError: The image has the wrong length.
        """
        if len(image) != self._output_count:
            raise ValueError(f"Y image has {len(image)} levels; the I/O map requires {self._output_count}")
        for run in self._output_runs:
            levels = [image[number] for number in run.numbers]
            operation = f"write of {len(levels)} outputs from offset {run.first_offset}"
            reply = self._exchange(
                operation,
                WriteMultipleCoilsRequest(address=run.first_offset, bits=levels, dev_id=self._unit),
            )
            if (reply.address, reply.count) != (run.first_offset, len(levels)):
                raise self._failed(operation, f"answer confirms {reply.count} from {reply.address}")

    def write_registers(self, values: Sequence[int]) -> None:
        """Write the output registers, in ascending order of offsets.

        Args:
            values: Values by the order of `IoMap.registers`, 0 to 32767.

        Raises:
            OutputsTakenError: The outputs belong to another master.
            LinkError: The link is closed, or the answer is late, malformed or an exception response.
            ValueError: The number of values is wrong.
        """
        value_of = dict(zip(self._registers, values, strict=True))
        for run in self._register_runs:
            count = len(run.numbers)
            operation = f"write of {count} registers from offset {run.first_offset}"
            words = [value_of[number] for number in run.numbers]
            request = WriteMultipleRegistersRequest(address=run.first_offset, registers=words, dev_id=self._unit)
            reply = self._exchange(operation, request)
            if (reply.address, reply.count) != (run.first_offset, count):
                raise self._failed(operation, f"answer confirms {reply.count} from {reply.address}")

    def close(self) -> None:
        """Close the connection; no effect on a closed link."""
        self._client.close()  # type: ignore[no-untyped-call]

    def _image(
        self,
        kind: str,
        request: type[ReadDiscreteInputsRequest | ReadCoilsRequest],
        runs: Iterable[Run],
        points: int,
    ) -> list[bool]:
        """Read the runs of one kind of points; return their levels by number."""
        image = [False] * points
        for run in runs:
            count = len(run.numbers)
            operation = f"read of {count} {kind} from offset {run.first_offset}"
            read = request(address=run.first_offset, count=count, dev_id=self._unit)
            for number, level in zip(run.numbers, self._bits(operation, read, count), strict=False):
                image[number] = level
        return image

    def _bits(self, operation: str, request: ModbusPDU, count: int) -> Sequence[bool]:
        """Return the bits of an answer, which is padded to complete bytes."""
        bits = self._exchange(operation, request).bits
        if not count <= len(bits) < count + 8:
            raise self._failed(operation, f"answer contains {len(bits)} bits")
        return bits

    def _exchange(self, operation: str, request: ModbusPDU) -> ModbusPDU:
        """Send a request and return its answer; close the link and raise LinkError if there is no valid answer."""
        if not self._client.connected:  # pymodbus would silently reconnect
            raise self._failed(operation, "the link is not open")
        try:
            reply = self._client.execute(False, request)
        except ConnectionException as error:
            raise self._failed(operation, "connection lost") from error
        except ModbusException as error:
            raise self._failed(operation, f"no valid answer within {self._timeout_ms} ms") from error
        except OSError as error:
            raise self._failed(operation, str(error)) from error
        if isinstance(reply, ExceptionResponse):
            if self.lends and reply.exception_code == ExcCodes.DEVICE_BUSY:
                owner = self.read_owner().owner or "another master"
                raise OutputsTakenError(f"field I/O at {self._address}: {operation}: the outputs belong to {owner}")
            raise self._failed(operation, f"refused with exception {_exception_name(reply)}")
        if reply.function_code != request.function_code:
            raise self._failed(operation, f"answer to another function ({reply.function_code})")
        return reply

    def _failed(self, operation: str, reason: str) -> LinkError:
        """Close the connection and return the error; a late answer must not be read as the next one."""
        self.close()
        return LinkError(f"field I/O at {self._address}: {operation}: {reason}")


def _exception_name(reply: ExceptionResponse) -> str:
    code = reply.exception_code
    name = ExcCodes(code).name.lower().replace("_", " ") if code in set(ExcCodes) else "unknown"
    return f"{code:02d} ({name})"
