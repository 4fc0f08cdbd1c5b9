"""What one Modbus client of the controller may see and do.

Reading gives the memory as it stood at END of the last scan. A write goes only to commands, set-points and the own
registers made for it, takes effect with the next scan, and is audited; anything else is refused (exception 02, or 03
for a value that cannot be) and changes nothing. Y and X are nobody's to write.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from pymodbus.constants import ExcCodes

from controller.core.devices import is_32_bit_counter
from controller.core.expr import Word
from controller.hmi import own_registers as own
from controller.hmi.alarm_list import AlarmList, AlarmRefusalError
from controller.hmi.fx3u import Span, Table, bit_spans, coil_address, register_address, register_spans
from controller.hmi.snapshot import Snapshot, Snapshots
from controller.io.forcing import ForcingError
from controller.io.pace import PaceError
from controller.io.runtime import Runtime
from controller.modbus.requests import Device, RefusedError
from controller.program.commands import Command
from controller.program.tags import SetPointError

JOG_RELEASE: Final = "jog_release"
MINUTE_MS: Final = 60_000
_TAKES_EFFECT: Final = 3
"""Scans after which an order has been carried out or refused, seen in the snapshot."""

Audit = Callable[[str, str, str, str, str], None]
"""Takes peer, name, what was written, value, and "done" or why not."""


@dataclass
class Desk:
    """What all clients share.

    Attributes:
        runtime: The PLC on its link.
        alarms: The operator's alarm list.
        snapshots: The memory after each scan.
        facts: Sources of the R area.
        audit: Told of every write.
        identity: Vendor, product and revision.
        refused_writes: Writes refused since the start.
        jogger: Who holds an output; the last to press.
        forcer: Who keeps inputs forced; the last to force one.
    """

    runtime: Runtime
    alarms: AlarmList
    snapshots: Snapshots
    facts: own.Facts
    audit: Audit
    identity: dict[int, str]
    refused_writes: int = 0
    jogger: HmiDevice | None = None
    forcer: HmiDevice | None = None
    commands: dict[int, Command] = field(init=False)
    set_points: dict[int, tuple[str, Word]] = field(init=False)
    spans: dict[Table, tuple[Span, ...]] = field(init=False)
    _own: tuple[Snapshot, list[int]] | None = field(init=False, default=None)

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
            "holding": register_spans(own.OWN_WORDS),
        }

    def snapshot(self) -> Snapshot:
        """Return the last scan's memory.

        Raises:
            RefusedError: There has been no scan yet.
        """
        if self.snapshots.latest is None:
            raise RefusedError(ExcCodes.DEVICE_BUSY)
        return self.snapshots.latest

    def own_words(self, snapshot: Snapshot) -> list[int]:
        """Return the R area, made once a scan."""
        if self._own is None or self._own[0] is not snapshot:
            self._own = (snapshot, own.own_words(self.facts, snapshot.at_ms))
        return self._own[1]

    def renew_own_words(self) -> None:
        """Make the R area anew for the next reading: no scan follows a pause."""
        self._own = None

    def find(self, table: Table, first: int, count: int) -> Span:
        """Return the span in which the addresses lie.

        Raises:
            RefusedError: Some address is no device.
        """
        for span in self.spans[table]:
            if span.first <= first and first + count <= span.end:
                return span
        raise RefusedError(ExcCodes.ILLEGAL_ADDRESS)


class HmiDevice(Device):
    """The controller as one client sees it."""

    def __init__(self, desk: Desk, peer: str) -> None:
        """Serve a client.

        Args:
            desk: What all clients share.
            peer: Its address, for the audit.
        """
        self._desk = desk
        self._peer = peer
        self._name = ""
        self._jog: Command | None = None
        self._jog_since = 0
        self._taken_over = 0

    def heard(self) -> None:
        """Renew what lasts only as long as its client is heard."""
        runtime = self._desk.runtime
        runtime.heard()
        if self._jog is not None:
            if self._still_jogs(self._jog):
                runtime.order(self._jog.name)
            else:
                self._note(self._jog.name, "0", "ended")
                self._jog = None
        if self._desk.forcer is self:
            runtime.forcing.renew()

    def end(self) -> None:
        """Let go what this client holds."""
        if self._jog is not None:
            self._release()
        if self._desk.forcer is self:
            self._desk.forcer = None
            forcing = self._desk.runtime.forcing
            if forcing.levels:
                forcing.let_go()
                self._note("force", "", "ended with the connection")

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return bits of the last scan."""
        return self._read_bits("coil", first, count)

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return bits of the last scan, X too."""
        return self._read_bits("discrete", first, count)

    def read_holding(self, first: int, count: int) -> list[int]:
        """Return words of the last scan."""
        desk = self._desk
        snapshot = desk.snapshot()
        span = desk.find("holding", first, count)
        start = first - span.first
        if span.kind == "R":
            return desk.own_words(snapshot)[start : start + count]
        if span.kind == "CN":
            return _counter_words(snapshot.words["CN"])[start : start + count]
        begin = span.number + start
        return [word & 0xFFFF for word in snapshot.words[span.kind][begin : begin + count]]

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return words of the last scan."""
        return self.read_holding(first, count)

    def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Give commands: True is a press; for a jog, False lets go."""
        commands = self._desk.commands
        addresses = range(first, first + len(levels))
        if any(address not in commands for address in addresses):
            raise self._refused(f"coil {first}", str([int(level) for level in levels]), ExcCodes.ILLEGAL_ADDRESS)
        for address, level in zip(addresses, levels, strict=True):
            self._command(commands[address], level)

    def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Change set-points, or carry out what an own register is for."""
        base = register_address("R", 0)
        blocks: dict[tuple[int, int], Callable[[Sequence[int]], None]] = {
            (base + own.R_ALARM_ACTION, own.ALARM_ACTION_WORDS): self._act_on_alarm,
            (base + own.R_NAME, own.NAME_WORDS): self._take_name,
            (base + own.R_PACE, 1): self._set_pace,
            (base + own.R_FORCE, own.FORCE_WORDS): self._force,
        }
        what, value = f"register {first}", str(list(values))
        try:
            carry_out = blocks.get((first, len(values)))
            if carry_out is not None:
                carry_out(values)
            else:
                self._change_set_points(first, values)
        except (AlarmRefusalError, PaceError, ForcingError, SetPointError) as error:
            raise self._refused(what, value, ExcCodes.ILLEGAL_VALUE, str(error)) from error

    def identity(self) -> dict[int, str]:
        """Return vendor, product and revision."""
        return self._desk.identity

    def _read_bits(self, table: Table, first: int, count: int) -> list[bool]:
        snapshot = self._desk.snapshot()
        span = self._desk.find(table, first, count)
        begin = span.number + first - span.first
        return snapshot.bits[span.kind][begin : begin + count]

    def _command(self, command: Command, level: bool) -> None:
        if command.group == "jog" and command.name != JOG_RELEASE:
            self._hold(command, level)
        elif level:
            self._desk.runtime.order(command.name)
            self._note(command.name, "1")

    def _hold(self, command: Command, level: bool) -> None:
        if not level:
            if self._jog is command:
                self._release()
            return
        if self._jog is not command:
            snapshot = self._desk.snapshot()
            self._jog, self._jog_since = command, snapshot.scans
            self._taken_over = snapshot.words["D"][self._desk.runtime.machine.tags.machine.jog.number]
            self._note(command.name, "1")
        self._desk.jogger = self
        self._desk.runtime.order(command.name)

    def _release(self) -> None:
        if self._jog is None:
            return
        if self._desk.jogger is self:
            self._desk.runtime.order(JOG_RELEASE)
            self._desk.jogger = None
        self._note(self._jog.name, "0")
        self._jog = None

    def _still_jogs(self, jog: Command) -> bool:
        """Whether this client's output is still held: not when it was refused, let go, or another client pressed.

        An order of the output taken over may come in the same scan as the press and win there, once.
        """
        if self._desk.jogger is not self:
            return False
        snapshot = self._desk.snapshot()
        if snapshot.scans < self._jog_since + _TAKES_EFFECT:
            return True
        tags = self._desk.runtime.machine.tags
        names = list(tags.commands.jog.values())
        held = snapshot.words["D"][tags.machine.jog.number]
        return held != 0 and held in (1 + names.index(jog.bit), self._taken_over)

    def _change_set_points(self, first: int, values: Sequence[int]) -> None:
        desk = self._desk
        addresses = range(first, first + len(values))
        if any(address not in desk.set_points for address in addresses):
            raise self._refused(f"register {first}", str(list(values)), ExcCodes.ILLEGAL_ADDRESS)
        changes = {desk.set_points[address][0]: str(value) for address, value in zip(addresses, values, strict=True)}
        desk.runtime.set_points(changes)
        for name, value in changes.items():
            self._note(f"set {name}", value)

    def _act_on_alarm(self, values: Sequence[int]) -> None:
        action, number, minutes = values
        alarms, by = self._desk.alarms, self._name or self._peer
        if action == own.ACKNOWLEDGE:
            alarms.acknowledge(number or None, by=by)
            if not number:
                self._desk.runtime.order("acknowledge")
            self._note("acknowledge", str(number or "all"))
        elif action == own.SHELVE:
            alarms.shelve(number, minutes * MINUTE_MS, by=by)
            self._note("shelve", f"{number} for {minutes} min")
        elif action == own.UNSHELVE:
            alarms.unshelve(number, by=by)
            self._note("unshelve", str(number))
        else:
            raise self._refused("alarm action", str(list(values)), ExcCodes.ILLEGAL_VALUE, "no such action")

    def _take_name(self, values: Sequence[int]) -> None:
        text = b"".join(value.to_bytes(2) for value in values).rstrip(b"\0")
        if not all(0x20 <= byte < 0x7F for byte in text):
            raise self._refused("name", "", ExcCodes.ILLEGAL_VALUE, "not ASCII")
        self._name = text.decode("ascii").strip()

    def _set_pace(self, values: Sequence[int]) -> None:
        pace = self._desk.facts.pace
        if pace is None:
            raise self._refused("pace", str(values[0]), ExcCodes.ILLEGAL_ADDRESS, "time is real here")
        pace.set(values[0])
        self._desk.renew_own_words()
        self._note("pace", str(values[0]))

    def _force(self, values: Sequence[int]) -> None:
        number, level = values
        if level > own.LET_GO:
            raise self._refused("force", str(list(values)), ExcCodes.ILLEGAL_VALUE, "give 0, 1, or 2 to let go")
        self._desk.runtime.forcing.force(number, None if level == own.LET_GO else bool(level))
        if level != own.LET_GO:
            self._desk.forcer = self
        self._note(f"force X{number:o}", "let go" if level == own.LET_GO else str(level))

    def _note(self, what: str, value: str, result: str = "done") -> None:
        self._desk.audit(self._peer, self._name, what, value, result)

    def _refused(self, what: str, value: str, code: ExcCodes, why: str = "nobody may write there") -> RefusedError:
        self._desk.refused_writes += 1
        self._note(what, value, f"refused: {why}")
        return RefusedError(code)


def _counter_words(values: Sequence[int]) -> list[int]:
    """Return current values as registers: one each, two (low first) from C200 on."""
    words = []
    for number, value in enumerate(values):
        words.append(value & 0xFFFF)
        if is_32_bit_counter(number):
            words.append(value >> 16 & 0xFFFF)
    return words
