"""Access to the devices of the machine's program: reads of all devices, writes of a whitelist.

Reads return the memory at END of the last scan. Only commands, set-points and the writable status registers accept
writes. The next scan takes a write whole, and the write returns at the end of this scan; a write that no scan takes is
withdrawn. What a scan does not take takes effect at once: the speed of simulated time, forced inputs, which are needed
while no scan takes place, and the name of the operator. Every write is recorded in the audit log. Every other write is
refused and changes nothing. X and Y are read-only.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from controller.common.mitsubishi.devices import Device
from controller.core.expr import Word
from controller.events.alarm_list import AlarmList, AlarmRefusalError
from controller.hmi.access import status_registers as status
from controller.hmi.serving.devices import (
    BIT_KINDS,
    AccessRefusal,
    AccessRefusedError,
    check_bits,
    check_value,
    check_words,
    taken,
    word_index,
    words_of_counters,
)
from controller.hmi.serving.snapshot import RELEASE, HeldSnapshot, Snapshot, Snapshots
from controller.io.forcing import ForcingError
from controller.io.pace import PaceError
from controller.io.runtime import Runtime
from controller.program.operator.commands import Command
from controller.program.set_points import SetPointError

JOG_RELEASE: Final = "jog_release"
MINUTE_MS: Final = 60_000
_TAKES_EFFECT: Final = 3
"""Number of scans until the snapshot shows whether an order was executed or refused."""
AUDITED_REFUSALS_PER_MINUTE: Final = 600
"""Rate above which refused writes are counted but not audited, so that a faulty client cannot fill the audit log."""

Audit = Callable[[str, str, str, str, str], None]
"""Callback for each write: peer, operator name, target, value, and "done" or the reason for the refusal."""


@dataclass
class MachineAccess:
    """State shared by the sessions of all communication partners, of all protocols.

    Attributes:
        runtime: PLC on its field link.
        alarms: The operator's alarm list.
        snapshots: Copies of the memory, one per scan.
        source: Sources of the values in the R area.
        audit_to: Callback for every write; None = no audit log.
        refused_writes: Number of refused writes since the start.
        refused_unaudited: Number of refused writes that were counted but not audited.
        jogger: Session that jogs an output: the last one that pressed a jog button.
        forcer: Session that forces inputs: the last one that forced an input.
        commands: Commands by the number of their M bit.
        set_points: Names and words of the writable set-points by the number of their D register.
    """

    runtime: Runtime
    alarms: AlarmList
    snapshots: Snapshots
    source: status.StatusSource
    audit_to: Audit | None = None
    refused_writes: int = 0
    refused_unaudited: int = 0
    jogger: MachineSession | None = None
    forcer: MachineSession | None = None
    commands: dict[int, Command] = field(init=False)
    set_points: dict[int, tuple[str, Word]] = field(init=False)
    _audited_refusals: int = field(init=False, default=0)
    _status_cache: tuple[Snapshot, list[int]] | None = field(init=False, default=None)
    _counter_cache: tuple[Snapshot, list[int]] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        tags = self.runtime.machine.tags
        self.commands = {command.bit.number: command for command in tags.commands}
        words = {name: getattr(tags.sp, name) for name in tags.sp.names()}
        self.set_points = {word.number: (name, word) for name, word in words.items() if word not in tags.sp.constants}

    def session(self, peer: str) -> MachineSession:
        """Return the access of a new communication partner."""
        return MachineSession(self, peer)

    def status_words(self, snapshot: Snapshot) -> list[int]:
        """Return the R area, computed once per scan."""
        if self._status_cache is None or self._status_cache[0] is not snapshot:
            self._status_cache = (snapshot, status.status_words(self.source, snapshot.at_ms))
        return self._status_cache[1]

    def invalidate_status_words(self) -> None:
        """Discard the cached R area; while simulated time is paused, no scan refreshes it."""
        self._status_cache = None

    def counter_words(self, snapshot: Snapshot) -> list[int]:
        """Return the words of all counters, computed once per scan."""
        if self._counter_cache is None or self._counter_cache[0] is not snapshot:
            self._counter_cache = (snapshot, words_of_counters(snapshot.words["CN"]))
        return self._counter_cache[1]

    def audit(self, peer: str, who: str, what: str, value: str, result: str) -> None:
        """Record a write; refusals above a rate are counted only."""
        if self.audit_to is None:
            return
        if result.startswith("refused"):
            self._audited_refusals += 1
            if self._audited_refusals > AUDITED_REFUSALS_PER_MINUTE:
                self.refused_unaudited += 1
                return
        self.audit_to(peer, who, what, value, result)

    def start_minute(self) -> None:
        """Start a new interval of the limit of audited refusals; called once a minute."""
        self._audited_refusals = 0


class MachineSession:
    """Devices of the machine's program as one communication partner may read and write them."""

    is_running = True
    """The program of the machine is always in RUN."""

    def __init__(self, state: MachineAccess, peer: str) -> None:
        """Initialise the session of a partner.

        Args:
            state: State shared by all partners.
            peer: Address of the partner, for the audit log.
        """
        self._state = state
        self._peer = peer
        self._name = ""
        self.snapshot = HeldSnapshot(state.snapshots)
        self._jog: Command | None = None
        self._jog_scan = 0
        self._previous_jog = 0

    @property
    def has_name(self) -> bool:
        """True if the partner has told the name of its operator."""
        return bool(self._name)

    def on_request(self) -> None:
        """Renew the jog and the forced inputs of this partner, which expire if it sends no requests."""
        runtime = self._state.runtime
        with runtime.gate:
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
        """Release the jog and the forced inputs of this partner."""
        if self._jog is not None:
            self._note(self._jog.name, "0")
        for command in self._end_jog():
            self._state.runtime.order(command)
        if self._state.forcer is self:
            self._state.forcer = None
            forcing = self._state.runtime.forcing
            if forcing.levels:
                with self._state.runtime.gate:
                    forcing.release_all()
                self._note("force", "", "ended with the connection")
        self._name = ""  # the next partner on a serial line is another one
        self.snapshot.request(RELEASE)

    def read_bits(self, first: Device, count: int) -> list[bool]:
        """Return consecutive bits of the last scan, or of the one that is held."""
        check_bits(first, count)
        return self.snapshot.read().bits[first.kind][first.number : first.number + count]

    def read_words(self, first: Device, count: int) -> list[int]:
        """Return consecutive words of the last scan, or of the one that is held, unsigned; R is never held."""
        check_words(first, count, status.STATUS_WORDS)
        start = first.number
        if first.kind == "R":
            return self._state.status_words(self.snapshot.latest())[start : start + count]
        snapshot = self.snapshot.read()
        if first.kind == "CN":
            start = word_index(start)
            return self._state.counter_words(snapshot)[start : start + count]
        return [word & 0xFFFF for word in snapshot.words[first.kind][start : start + count]]

    async def write_bits(self, levels: Sequence[tuple[Device, bool]]) -> None:
        """Issue the commands of the bits set to True, all in one scan; False ends a jog."""
        commands = self._state.commands
        if any(device.kind != "M" or device.number not in commands for device, _ in levels):
            values = str([int(level) for _, level in levels])
            raise self.refused(str(levels[0][0]), values, _refusal_of([device for device, _ in levels]))
        self.snapshot.latest()  # a jog needs the last scan: all commands of a request are refused together
        orders: list[str] = []
        changes: list[tuple[str, str]] = []
        for device, level in levels:
            self._add_command(commands[device.number], level, orders, changes)
        if orders:
            await self._taken(orders, changes)

    async def write_words(self, values: Sequence[tuple[Device, int]]) -> None:
        """Change set-points, or execute the request of a writable status register."""
        first = values[0][0]
        numbers = [value for _, value in values]
        try:
            action = self._block(values)
            if action is not None:
                await action(numbers)
            else:
                await self._change_set_points(values)
        except (AlarmRefusalError, PaceError, ForcingError, SetPointError) as error:
            raise self.refused(str(first), str(numbers), AccessRefusal.BAD_VALUE, str(error)) from error

    async def set_running(self, *, running: bool) -> None:
        """Refuse to stop or start the program; the machine has commands for this."""
        raise self.refused(
            "RUN" if running else "STOP", "", AccessRefusal.NOT_SUPPORTED, "remote RUN/STOP is not supported"
        )

    def refused(self, what: str, value: str, refusal: AccessRefusal, why: str = "") -> AccessRefusedError:
        """Record a refused write and return its error."""
        self._state.refused_writes += 1
        self._note(what, value, f"refused: {why or refusal.value}")
        return AccessRefusedError(refusal)

    def _block(self, values: Sequence[tuple[Device, int]]) -> Callable[[Sequence[int]], Awaitable[None]] | None:
        """Return the function of a block of writable status registers; None for other devices."""
        first = values[0][0]
        if [device for device, _ in values] != [Device("R", first.number + index) for index in range(len(values))]:
            return None
        blocks: dict[tuple[int, int], Callable[[Sequence[int]], Awaitable[None]]] = {
            (status.R_ALARM_ACTION, status.ALARM_ACTION_WORDS): self._act_on_alarm,
            (status.R_NAME, status.NAME_WORDS): self._set_name,
            (status.R_PACE, 1): self._set_pace,
            (status.R_FORCE, status.FORCE_WORDS): self._force,
        }
        return blocks.get((first.number, len(values)))

    def _add_command(self, command: Command, level: bool, orders: list[str], changes: list[tuple[str, str]]) -> None:
        """Append the command bits to set, and the changes to record in the audit log."""
        if command.group != "jog" or command.name == JOG_RELEASE:
            if level:
                orders.append(command.name)
                changes.append((command.name, "1"))
        elif level:
            if self._jog is not command:
                self._begin_jog(command)
                changes.append((command.name, "1"))
            self._state.jogger = self
            orders.append(command.name)
        elif self._jog is command:
            changes.append((command.name, "0"))
            orders += self._end_jog()

    def _begin_jog(self, command: Command) -> None:
        snapshot = self.snapshot.latest()
        self._jog, self._jog_scan = command, snapshot.scans
        self._previous_jog = snapshot.words["D"][self._state.runtime.machine.tags.machine.jog.number]

    def _end_jog(self) -> list[str]:
        """Forget the jog of this partner and return the command that releases it, unless another partner jogs."""
        self._jog = None
        if self._state.jogger is not self:
            return []
        self._state.jogger = None
        return [JOG_RELEASE]

    def _jog_is_active(self, jog: Command) -> bool:
        """Return True unless the jog of this partner has been refused, released or taken over.

        A jog command of the previous session may arrive in the same scan as the press and then take precedence.
        """
        if self._state.jogger is not self:
            return False
        snapshot = self.snapshot.latest()  # never the one that is held: the jog must end
        if snapshot.scans < self._jog_scan + _TAKES_EFFECT:
            return True
        tags = self._state.runtime.machine.tags
        names = list(tags.commands.jog.values())
        jogged = snapshot.words["D"][tags.machine.jog.number]
        return jogged != 0 and jogged in (1 + names.index(jog.bit), self._previous_jog)

    async def _change_set_points(self, values: Sequence[tuple[Device, int]]) -> None:
        state = self._state
        if any(device.kind != "D" or device.number not in state.set_points for device, _ in values):
            numbers = str([value for _, value in values])
            raise self.refused(str(values[0][0]), numbers, _refusal_of([device for device, _ in values]))
        changes = {state.set_points[device.number][0]: str(value) for device, value in values}
        written = [(f"set {name}", value) for name, value in changes.items()]
        await self._taken([], written, state.runtime.machine.tags.sp.changes(changes))

    async def _act_on_alarm(self, values: Sequence[int]) -> None:
        action, number, minutes = values
        alarms, by = self._state.alarms, self._name or self._peer
        actions: dict[int, tuple[Callable[[], None], tuple[str, str]]] = {
            status.ACKNOWLEDGE: (
                lambda: alarms.acknowledge(number or None, by=by),
                ("acknowledge", str(number or "all")),
            ),
            status.SHELVE: (
                lambda: alarms.shelve(number, minutes * MINUTE_MS, by=by),
                ("shelve", f"{number} for {minutes} min"),
            ),
            status.UNSHELVE: (lambda: alarms.unshelve(number, by=by), ("unshelve", str(number))),
        }
        if action not in actions:
            raise self.refused("alarm action", str(list(values)), AccessRefusal.BAD_VALUE, "no such action")
        act, change = actions[action]
        orders = ["acknowledge"] if action == status.ACKNOWLEDGE and not number else []
        await self._taken(orders, [change], act=act)

    async def _set_name(self, values: Sequence[int]) -> None:
        text = b"".join(value.to_bytes(2) for value in values).rstrip(b"\0")
        if not all(0x20 <= byte < 0x7F for byte in text):
            raise self.refused("name", "", AccessRefusal.BAD_VALUE, "not ASCII")
        self._name = text.decode("ascii").strip()

    async def _set_pace(self, values: Sequence[int]) -> None:
        pace = self._state.source.pace
        if pace is None:
            raise self.refused(
                "pace", str(values[0]), AccessRefusal.NOT_WRITABLE, "not a simulation: the speed cannot be changed"
            )
        pace.set(values[0])
        self._state.invalidate_status_words()
        self._note("pace", str(values[0]))

    async def _force(self, values: Sequence[int]) -> None:
        number, level = values
        if level > status.RELEASE_FORCE:
            raise self.refused(
                "force", str(list(values)), AccessRefusal.BAD_VALUE, "must be 0 or 1, or 2 to end forcing"
            )
        runtime = self._state.runtime
        with runtime.gate:
            runtime.forcing.force(number, None if level == status.RELEASE_FORCE else bool(level))
        self._state.invalidate_status_words()
        if level != status.RELEASE_FORCE:
            self._state.forcer = self
        self._note(f"force X{number:o}", "released" if level == status.RELEASE_FORCE else str(level))

    async def _taken(
        self,
        orders: Sequence[str],
        changes: Sequence[tuple[str, str]],
        words: Sequence[tuple[Word, int]] = (),
        act: Callable[[], None] = lambda: None,
    ) -> None:
        """Have a scan take a write, wait for its end and record the changes.

        Args:
            orders: Commands to issue.
            changes: Changes to record in the audit log.
            words: Set-points to write.
            act: Function called first, in the same scan; if it raises, nothing is changed.
        """
        runtime = self._state.runtime
        bits = [(runtime.machine.tags.commands[order], 1) for order in orders]
        try:
            await taken(runtime.submit([*bits, *words], act))
        except AccessRefusedError as error:
            if orders:
                self._end_jog()  # a jog that was not pressed must not be renewed
            raise self.refused(*(changes or [(orders[0], "1")])[0], error.refusal) from error
        for change in changes:
            self._note(*change)

    def _note(self, what: str, value: str, result: str = "done") -> None:
        self._state.audit(self._peer, self._name, what, value, result)


def _refusal_of(devices: Sequence[Device]) -> AccessRefusal:
    """Return the reason for which a write of devices is refused: one does not exist, or is not writable."""
    try:
        for device in devices:
            if device.kind in BIT_KINDS:
                check_bits(device, 1)
            else:
                check_value(device, status.STATUS_WORDS)
    except AccessRefusedError as error:
        return error.refusal
    return AccessRefusal.NOT_WRITABLE
