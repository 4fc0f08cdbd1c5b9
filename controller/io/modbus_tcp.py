"""Field I/O of one Modbus TCP device with all points at the offsets of the I/O map."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from controller.io.field.field_file import one_device
from controller.io.field.link import DevicesLink


class ModbusTcpLink(DevicesLink):
    """`FieldLink` to one Modbus TCP server: a remote I/O module or the simulated plant.

    An image is transferred in one request if the offsets in the I/O map are consecutive, otherwise in one request per
    run of consecutive offsets.
    """

    def __init__(self, host: str, port: int, io_map: IoMap, *, unit: int = 1, timeout_s: float = 0.05) -> None:
        """Create a closed link; `open` connects it.

        Args:
            host: Name or address of the server.
            port: TCP port, usually 502; 5020 for the simulated plant.
            io_map: I/O map with the Modbus offsets of the points.
            unit: Modbus unit identifier.
            timeout_s: Timeout of the connection and of each answer, s.
        """
        super().__init__(one_device(io_map, host, port, unit=unit, timeout_ms=round(timeout_s * 1_000)), io_map)
