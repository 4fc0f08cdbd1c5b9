"""Modbus session of one client: read and write access to the controller.

Reads return the memory at END of the last scan. Only commands, set-points and the writable status registers accept
writes. A write takes effect in the next scan and is recorded in the audit log. Every other write is refused (exception
02, or 03 for an invalid value) and changes nothing. X and Y are read-only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from pymodbus.constants import ExcCodes

from controller.common.modbus.requests import ModbusDevice, RequestRefusedError
from controller.core.devices import is_32_bit_counter
from controller.core.expr import Word
from controller.events.alarm_list import AlarmList, AlarmRefusalError
from controller.hmi.modbus import status_registers as status
from controller.hmi.modbus.fx3u_map import Span, Table, bit_spans, coil_address, register_address, register_spans
from controller.hmi.modbus.snapshot import Snapshot, Snapshots
from controller.io.forcing import ForcingError
from controller.io.pace import PaceError
from controller.io.runtime import Runtime
from controller.program.operator.commands import Command
from controller.program.set_points import SetPointError

JOG_RELEASE: Final = "jog_release"
MINUTE_MS: Final = 60_000
_TAKES_EFFECT: Final = 3
"""Number of scans until the snapshot shows whether an order was executed or refused."""

Audit = Callable[[str, str, str, str, str], None]
"""Callback for each write: peer, operator name, target, value, and "done" or the reason for the refusal."""


@dataclass
class HmiState:
    """State shared by all client sessions.

    Attributes:
        runtime: PLC on its field link.
        alarms: The operator's alarm list.
        snapshots: Copies of the memory, one per scan.
        source: Sources of the values in the R area.
        audit: Callback for every write.
        identity: Vendor, product and revision.
        refused_writes: Number of refused writes since the start.
        jogger: Session that jogs an output: the last one that pressed a jog button.
        forcer: Session that forces inputs: the last one that forced an input.
        commands: Commands by coil address.
        set_points: Names and words of the writable set-points by register address.
        spans: Address spans by table.
    """

    runtime: Runtime
    alarms: AlarmList
    snapshots: Snapshots
    source: status.StatusSource
    audit: Audit
    identity: dict[int, str]
    refused_writes: int = 0
    jogger: HmiSession | None = None
    forcer: HmiSession | None = None
    commands: dict[int, Command] = field(init=False)
    set_points: dict[int, tuple[str, Word]] = field(init=False)
    spans: dict[Table, tuple[Span, ...]] = field(init=False)
    _status_cache: tuple[Snapshot, list[int]] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        tags = self.runtime.machine.tags
        self.commands = {coil_address("M", command.bit.number): command for command in tags.commands}
        words = {name: getattr(tags.sp, name) for name in tags.sp.names()}
        self.set_points = {
            register_address("D", word.number): (name, word)
            for name, word in words.items()
            if word not in tags.sp.at_start
        }
        self.spans = {
            "coil": bit_spans("coil"),
            "discrete": bit_spans("discrete"),
            "holding": register_spans(status.STATUS_WORDS),
        }

    def snapshot(self) -> Snapshot:
        """Return the memory of the last scan.

        Raises:
            RequestRefusedError: No scan has been completed yet.
        """
        if self.snapshots.latest is None:
            raise RequestRefusedError(ExcCodes.DEVICE_BUSY)
        return self.snapshots.latest

    def status_words(self, snapshot: Snapshot) -> list[int]:
        """Return the R area, computed once per scan."""
        if self._status_cache is None or self._status_cache[0] is not snapshot:
            self._status_cache = (snapshot, status.status_words(self.source, snapshot.at_ms))
        return self._status_cache[1]

    def invalidate_status_words(self) -> None:
        """Discard the cached R area; while simulated time is paused, no scan refreshes it."""
        self._status_cache = None

    def find(self, table: Table, first: int, count: int) -> Span:
        """Return the span that contains all addresses.

        Raises:
            RequestRefusedError: At least one address does not belong to a device.
        """
        for span in self.spans[table]:
            if span.first <= first and first + count <= span.end:
                return span
        raise RequestRefusedError(ExcCodes.ILLEGAL_ADDRESS)


class HmiSession(ModbusDevice):
    """Modbus device presented to one client."""

    def __init__(self, state: HmiState, peer: str) -> None:
        """Initialise the session of a client.

        Args:
            state: State shared by all clients.
            peer: Address of the client, for the audit log.
        """
        self._state = state
        self._peer = peer
        self._name = ""
        self._jog: Command | None = None
        self._jog_scan = 0
        self._previous_jog = 0

    def on_request(self) -> None:
        """Renew the jog and the forced inputs of this client, which expire if it sends no requests."""
        runtime = self._state.runtime
        runtime.panel.read()
        if self._jog is not None:
            if self._jog_is_active(self._jog):
                runtime.order(self._jog.name)
            else:
                self._note(self._jog.name, "0", "ended")
                self._jog = None
        if self._state.forcer is self:
            runtime.forcing.renew()

    def on_disconnect(self) -> None:
        """Release the jog and the forced inputs of this client."""
        if self._jog is not None:
            self._end_jog()
        if self._state.forcer is self:
            self._state.forcer = None
            forcing = self._state.runtime.forcing
            if forcing.levels:
                forcing.release_all()
                self._note("force", "", "ended with the connection")

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return coils of the last scan."""
        return self._read_bits("coil", first, count)

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return discrete inputs of the last scan, including X."""
        return self._read_bits("discrete", first, count)

    def read_holding(self, first: int, count: int) -> list[int]:
        """Return holding registers of the last scan."""
        state = self._state
        snapshot = state.snapshot()
        span = state.find("holding", first, count)
        start = first - span.first
        if span.kind == "R":
            return state.status_words(snapshot)[start : start + count]
        if span.kind == "CN":
            return _counter_words(snapshot.words["CN"])[start : start + count]
        begin = span.number + start
        return [word & 0xFFFF for word in snapshot.words[span.kind][begin : begin + count]]

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return input registers of the last scan; identical to the holding registers."""
        return self.read_holding(first, count)

    def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Issue the commands of the coils set to True; False ends a jog."""
        commands = self._state.commands
        addresses = range(first, first + len(levels))
        if any(address not in commands for address in addresses):
            raise self._refused(f"coil {first}", str([int(level) for level in levels]), ExcCodes.ILLEGAL_ADDRESS)
        for address, level in zip(addresses, levels, strict=True):
            self._command(commands[address], level)

    def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Change set-points, or execute the request of a writable status register."""
        base = register_address("R", 0)
        blocks: dict[tuple[int, int], Callable[[Sequence[int]], None]] = {
            (base + status.R_ALARM_ACTION, status.ALARM_ACTION_WORDS): self._act_on_alarm,
            (base + status.R_NAME, status.NAME_WORDS): self._set_name,
            (base + status.R_PACE, 1): self._set_pace,
            (base + status.R_FORCE, status.FORCE_WORDS): self._force,
        }
        what, value = f"register {first}", str(list(values))
        try:
            action = blocks.get((first, len(values)))
            if action is not None:
                action(values)
            else:
                self._change_set_points(first, values)
        except (AlarmRefusalError, PaceError, ForcingError, SetPointError) as error:
            raise self._refused(what, value, ExcCodes.ILLEGAL_VALUE, str(error)) from error

    def identity(self) -> dict[int, str]:
        """Return the vendor, the product and the revision."""
        return self._state.identity

    def _read_bits(self, table: Table, first: int, count: int) -> list[bool]:
        snapshot = self._state.snapshot()
        span = self._state.find(table, first, count)
        begin = span.number + first - span.first
        return snapshot.bits[span.kind][begin : begin + count]

    def _command(self, command: Command, level: bool) -> None:
        if command.group == "jog" and command.name != JOG_RELEASE:
            self._set_jog(command, level)
        elif level:
            self._state.runtime.order(command.name)
            self._note(command.name, "1")

    def _set_jog(self, command: Command, level: bool) -> None:
        if not level:
            if self._jog is command:
                self._end_jog()
            return
        if self._jog is not command:
            snapshot = self._state.snapshot()
            self._jog, self._jog_scan = command, snapshot.scans
            self._previous_jog = snapshot.words["D"][self._state.runtime.machine.tags.machine.jog.number]
            self._note(command.name, "1")
        self._state.jogger = self
        self._state.runtime.order(command.name)

    def _end_jog(self) -> None:
        if self._jog is None:
            return
        if self._state.jogger is self:
            self._state.runtime.order(JOG_RELEASE)
            self._state.jogger = None
        self._note(self._jog.name, "0")
        self._jog = None

    def _jog_is_active(self, jog: Command) -> bool:
        """Return True unless the jog of this client has been refused, released or taken over.

        A jog command of the previous session may arrive in the same scan as the press and then take precedence.
        """
        if self._state.jogger is not self:
            return False
        snapshot = self._state.snapshot()
        if snapshot.scans < self._jog_scan + _TAKES_EFFECT:
            return True
        tags = self._state.runtime.machine.tags
        names = list(tags.commands.jog.values())
        jogged = snapshot.words["D"][tags.machine.jog.number]
        return jogged != 0 and jogged in (1 + names.index(jog.bit), self._previous_jog)

    def _change_set_points(self, first: int, values: Sequence[int]) -> None:
        state = self._state
        addresses = range(first, first + len(values))
        if any(address not in state.set_points for address in addresses):
            raise self._refused(f"register {first}", str(list(values)), ExcCodes.ILLEGAL_ADDRESS)
        changes = {state.set_points[address][0]: str(value) for address, value in zip(addresses, values, strict=True)}
        state.runtime.set_points(changes)
        for name, value in changes.items():
            self._note(f"set {name}", value)

    def _act_on_alarm(self, values: Sequence[int]) -> None:
        action, number, minutes = values
        alarms, by = self._state.alarms, self._name or self._peer
        if action == status.ACKNOWLEDGE:
            alarms.acknowledge(number or None, by=by)
            if not number:
                self._state.runtime.order("acknowledge")
            self._note("acknowledge", str(number or "all"))
        elif action == status.SHELVE:
            alarms.shelve(number, minutes * MINUTE_MS, by=by)
            self._note("shelve", f"{number} for {minutes} min")
        elif action == status.UNSHELVE:
            alarms.unshelve(number, by=by)
            self._note("unshelve", str(number))
        else:
            raise self._refused("alarm action", str(list(values)), ExcCodes.ILLEGAL_VALUE, "no such action")

    def _set_name(self, values: Sequence[int]) -> None:
        text = b"".join(value.to_bytes(2) for value in values).rstrip(b"\0")
        if not all(0x20 <= byte < 0x7F for byte in text):
            raise self._refused("name", "", ExcCodes.ILLEGAL_VALUE, "not ASCII")
        self._name = text.decode("ascii").strip()

    def _set_pace(self, values: Sequence[int]) -> None:
        pace = self._state.source.pace
        if pace is None:
            raise self._refused(
                "pace", str(values[0]), ExcCodes.ILLEGAL_ADDRESS, "not a simulation: the speed cannot be changed"
            )
        pace.set(values[0])
        self._state.invalidate_status_words()
        self._note("pace", str(values[0]))

    def _force(self, values: Sequence[int]) -> None:
        number, level = values
        if level > status.RELEASE_FORCE:
            raise self._refused(
                "force", str(list(values)), ExcCodes.ILLEGAL_VALUE, "must be 0 or 1, or 2 to end forcing"
            )
        self._state.runtime.forcing.force(number, None if level == status.RELEASE_FORCE else bool(level))
        if level != status.RELEASE_FORCE:
            self._state.forcer = self
        self._note(f"force X{number:o}", "released" if level == status.RELEASE_FORCE else str(level))

    def _note(self, what: str, value: str, result: str = "done") -> None:
        self._state.audit(self._peer, self._name, what, value, result)

    def _refused(self, what: str, value: str, code: ExcCodes, why: str = "not writable") -> RequestRefusedError:
        self._state.refused_writes += 1
        self._note(what, value, f"refused: {why}")
        return RequestRefusedError(code)


def _counter_words(values: Sequence[int]) -> list[int]:
    """Return counter values as registers: one per counter, two (low word first) for C200 and above."""
    words = []
    for number, value in enumerate(values):
        words.append(value & 0xFFFF)
        if is_32_bit_counter(number):
            words.append(value >> 16 & 0xFFFF)
    return words
