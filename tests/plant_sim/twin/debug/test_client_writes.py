"""Writes of Modbus clients into a recorded twin: recorded with the scan that took them, and replayed."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from pymodbus.client import ModbusTcpClient

from controller.core.devices import device_name
from controller.debug.commands import Debugger
from controller.debug.timeline import RunTimeline
from controller.events.alarm_list import AlarmList
from controller.hmi.access.server import HmiServer
from controller.hmi.access.status_registers import R_FORCE
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.modbus.fx3u_map import coil_address, register_address
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.controller.common.modbus_rig import PATIENT_S
from tests.plant_sim.twin.debug.test_recorded_run import image

STOP = 0o24


class ServedTwin:
    """Recorded twin with a Modbus server; `fingerprints` has that of the state after each scan."""

    def __init__(self) -> None:
        self.twin = Twin(seed=5)
        self.recorder = TwinRecorder(self.twin)
        machine = self.twin.machine
        alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, lambda _change: None)
        self.twin.runtime.observers.append(alarms)
        self.twin.runtime.forcing.allowed = True
        self.server = HmiServer(self.twin.runtime, alarms, HmiOptions(port=0))
        self.fingerprints = [self.fingerprint()]

    def fingerprint(self) -> int:
        """Return a hash of what the last scan has adopted; the flags of a request may be set at any time after it."""
        runtime = self.twin.runtime
        _, message_ms, _, request_ms = runtime.panel.save()
        levels, _, renewed_ms, allowed = runtime.forcing.save()
        return hash(repr((image(self.twin), message_ms, request_ms, levels, renewed_ms, allowed)))

    def scan(self) -> None:
        self.twin.run_for(SCAN_MS)
        self.fingerprints.append(self.fingerprint())

    def scan_during(self, work: Callable[[ModbusTcpClient], None], *, always: bool) -> RunTimeline:
        """Scan while a client works, in every moment or only for its writes; return the recorded run."""
        self.scan()
        with (
            self.server,
            ThreadPoolExecutor(1) as pool,
            ModbusTcpClient("127.0.0.1", port=self.server.port, timeout=PATIENT_S) as client,
        ):
            done = pool.submit(work, client)
            while not done.done():
                if always or self.twin.runtime.writes.are_waiting:
                    self.scan()
            done.result()
        self.scan()
        return self.recorder.close()

    def command(self, client: ModbusTcpClient, name: str) -> None:
        bit = self.twin.machine.tags.commands[name]
        assert not client.write_coil(coil_address("M", bit.number), True).isError()

    def set_point(self, client: ModbusTcpClient, name: str, value: int) -> None:
        word = getattr(self.twin.machine.tags.sp, name)
        assert not client.write_register(register_address("D", word.number), value).isError()


def test_each_write_is_an_event_of_the_scan_that_took_it() -> None:
    served = ServedTwin()
    settle, commands = served.twin.machine.tags.sp.settle, served.twin.machine.tags.commands

    def work(client: ModbusTcpClient) -> None:
        served.set_point(client, "settle", 31)
        served.command(client, "mode_manual")
        served.set_point(client, "settle", 32)

    line = served.scan_during(work, always=False)
    assert line.last == 5
    told = Debugger(line).execute("events")
    name = device_name("D", settle.number)
    assert [event for event in told if event.startswith("scan")] == [
        f"scan 2: {name}=31",
        f"scan 3: {device_name('M', commands['mode_manual'].number)}=1",
        f"scan 4: {name}=32",
    ]
    for scan, value in ((3, 31), (4, 32), (2, 31), (5, 32)):
        line.seek(scan)
        assert served.twin.plc.read(settle) == value
        assert served.fingerprint() == served.fingerprints[scan], scan
    line.seek(1)
    assert served.twin.plc.read(settle) not in (31, 32)


def test_every_scan_beside_a_busy_client_can_be_returned_to() -> None:
    served = ServedTwin()

    def work(client: ModbusTcpClient) -> None:
        served.command(client, "mode_manual")
        assert not client.write_registers(register_address("R", R_FORCE), [STOP, 0]).isError()
        for value in range(25):
            served.set_point(client, "settle", 20 + value)
            served.command(client, "reset" if value % 2 else "clear")
            client.read_holding_registers(register_address("D", 512), count=10)

    line = served.scan_during(work, always=True)
    assert line.last == len(served.fingerprints) - 1
    for scan in (*range(line.last, 0, -97), *range(1, line.last)):
        line.seek(scan)
        assert served.fingerprint() == served.fingerprints[scan], scan
    branched = line.branch(line.last // 2, [])
    branched.extend(line.last)
    branched.seek(line.last)
    assert served.fingerprint() == served.fingerprints[-1]
