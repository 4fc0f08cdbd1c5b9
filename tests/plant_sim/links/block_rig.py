"""Modbus server rig whose I/O map has 18 consecutive outputs, from offset 0, and no lamp."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from tests.controller.common import modbus_rig
from tests.controller.common.modbus_rig import write_coils_pdu
from tests.wiring import unwired

IO_MAP = unwired("lamp_amber")
ALL_OFF = write_coils_pdu(0, "0" * 18)


def make_module(io_map: IoMap = IO_MAP) -> IoModule:
    return modbus_rig.make_module(io_map)


class Rig(modbus_rig.Rig):
    """Running server of this map, in lock step by default, and its clients."""

    def __init__(self, server: PlantServer | None = None) -> None:
        super().__init__(server or PlantServer(make_module(), port=0, lock_step_ms=10))
