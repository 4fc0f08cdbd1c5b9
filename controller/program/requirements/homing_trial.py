"""Homing of the machine in the travel model, from a situation at rest until the machine no longer moves."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from controller.core.expr import Bit, Word
from controller.core.machine_code import MachineExecution
from controller.core.program import Program
from controller.core.scan import Plc
from controller.program.inputs import Inputs
from controller.program.machine import Transplanter
from controller.program.places import REST_MS
from controller.program.requirements.travel_model import TRAY_MS, TravelModel
from controller.program.requirements.travel_times import DELIVERED, TravelTimes
from controller.program.states import Mode, State
from controller.program.tags import IN_PLACE, SIDES, Side

SCAN_MS: Final = 40
"""Scan time, ms: half of the time through the band of the switch of a row, so that no switch is missed. With 80 ms, a
few of the starts end in an alarm of the belt that does not occur with 40, 20 or 10 ms."""
STARTS_AT_MS: Final = 100_000
RESTS_MS: Final = REST_MS + 200
"""Time at rest before homing, ms: the arms count as at rest, and the timers show it."""
_ENDS: Final = frozenset({State.IDLE, State.HELD, State.STOPPED, State.ABORTED})


@dataclass(frozen=True, slots=True)
class HomingStart:
    """Machine at rest before homing.

    Attributes:
        values: Values of devices that differ from their initial values, including the positions of the model.
        powered_up: True if the power has been lost: devices that are not retentive have their initial values.
        mode: Operating mode.
        stuck: Forced states of switches, by X number.
    """

    values: Mapping[Bit | Word, int]
    powered_up: bool = False
    mode: Mode = Mode.CONTINUOUS
    stuck: Mapping[int, bool] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Ending:
    """End of one homing.

    Attributes:
        state: State of the machine; None if homing has not ended within the time limit.
        ms: Duration, ms.
        alarms: Annunciators that are set.
        asks: Arms whose load is asked about.
        asks_tray: True if the tray is asked about.
    """

    state: State | None
    ms: int
    alarms: tuple[int, ...]
    asks: tuple[Side, ...]
    asks_tray: bool

    @property
    def explained(self) -> bool:
        """True if homing has ended in Idle, or in Held with an alarm or a question."""
        held = self.state is State.HELD and bool(self.alarms or self.asks or self.asks_tray)
        return held or self.state is State.IDLE


class HomingTrial:
    """Machine in the travel model.

    Attributes:
        machine: Program of the machine.
        model: Travel model.
    """

    def __init__(
        self, machine: Transplanter, times: TravelTimes = DELIVERED, *, scan_ms: int = SCAN_MS, limit_ms: int
    ) -> None:
        """Prepare trials of a machine.

        Args:
            machine: Program of the machine.
            times: Travel times of the machine.
            scan_ms: Scan time, ms.
            limit_ms: Time after which a homing is abandoned, ms.
        """
        self.machine = machine
        self.model = TravelModel(machine.io_map, times, active_at_rest=_needed_inputs(machine))
        self._scan_ms, self._limit_ms = scan_ms, limit_ms
        program: Program = replace(machine.program, blocks=(*machine.program.blocks, self.model.block))
        self._execution = MachineExecution(program)
        self._plc = Plc(program, input_filter_ms=0, execution=self._execution)
        self._plc.write(self.model.scan_ms, scan_ms)
        levels = self.model.levels
        self._sense = self._execution.copier(levels[0], Bit("X", 0), len(levels))
        self._initial = self._execution.save()
        self._now_ms = STARTS_AT_MS
        self._retained = frozenset((*machine.program.retentive, *machine.program.constants)) | self.model.inputs

    def save(self) -> Any:
        """Return the situation of the machine."""
        return self._now_ms, self._execution.save()

    def restore(self, saved: Any) -> None:
        """Restore a situation returned by `save`."""
        self._now_ms, memory = saved
        self._execution.restore(memory)

    def begin(self, situation: HomingStart) -> None:
        """Put the machine at rest in Stopped into a situation."""
        self._now_ms = STARTS_AT_MS
        model, memory = self.model, self._execution.memory
        values = {**situation.values, self.machine.tags.machine.mode: int(situation.mode)}
        for number, on in situation.stuck.items():
            values[(model.stuck_on if on else model.stuck_off)[number]] = 1
        self._execution.restore(self._initial)
        self._write(values, model.inputs)
        self._execution.run(0, first=False)
        self._sense()
        levels = memory.X[: len(model.levels)]
        self._execution.restore(self._initial)
        memory.X[: len(levels)] = levels
        self._write(values, self._retained)
        self._execution.run(self._now_ms - self._scan_ms, first=True)
        if self._plc.read(self.machine.tags.machine.constants_open):
            self._confirm_constants()
        if not situation.powered_up:
            self._scans(RESTS_MS // self._scan_ms)
            self._write(values, values.keys())

    def home(self) -> Ending:
        """Command reset and home, wait for the start warning, and execute scans until the machine no longer moves."""
        memory, control = self._execution.memory, self.machine.tags.machine
        state, waits = control.state.number, control.home_waits.number
        self._plc.press(self.machine.tags.commands.reset)
        self._scan()
        while memory.M[waits] and memory.D[state] != State.RESETTING:
            self._scan()
        began_ms = self._now_ms - self._scan_ms
        while memory.D[state] not in _ENDS and self._now_ms - began_ms <= self._limit_ms:
            self._scan()
        ended = State(memory.D[state]) if memory.D[state] in _ENDS else None
        tags = self.machine.tags
        return Ending(
            ended,
            self._now_ms - began_ms,
            tuple(number for number in self._plc.annunciators() if self.machine.alarms.of(number).stops_work),
            tuple(side for side in SIDES if self._plc.read(tags.arms[side].ask)),
            bool(self._plc.read(tags.tray.ask)),
        )

    def answers(self) -> Iterator[tuple[Bit, ...]]:
        """Yield the commands of every possible reply of the operator to the questions that are open.

        An arm may hold seedlings or not, or the operator discards them. Of a tray under the sensor the operator says
        that it is the same if the phase was stored, full, or not usable; without a tray the only true answer is none.
        If both arms ask, their answers differ from reply to reply.
        """
        tags, read = self.machine.tags, self._plc.read
        commands = tags.commands
        per_arm = {
            side: (commands.loaded_yes[side], commands.loaded_no[side], commands.discard[side]) for side in SIDES
        }
        asking = [side for side in SIDES if read(tags.arms[side].ask)]
        trays: list[Bit] = []
        if read(tags.tray.ask):
            seen, known = read(self.model.tray) < TRAY_MS, read(tags.tray.phase) == IN_PLACE
            trays = [commands.tray_none, *([commands.tray_full] * seen), *([commands.tray_same] * (seen and known))]
        for reply in range(max(3 * bool(asking), len(trays))):
            arms = [per_arm[side][(reply + n) % 3] for n, side in enumerate(asking)]
            yield (*arms, *(trays[reply % len(trays) :][:1] if trays else ()))

    def answer(self, commands: Collection[Bit]) -> None:
        """Give commands, and execute three scans, in which they and repaired switches take effect."""
        for command in commands:
            self._plc.press(command)
        self._scans(3)

    def repair(self) -> None:
        """Let all switches follow their devices again."""
        for bit in (*self.model.stuck_on, *self.model.stuck_off):
            self._plc.write(bit, 0)

    def _confirm_constants(self) -> None:
        """Press X25, release it and clear, two scans each."""
        stop = self.model.stuck_on[self.machine.io_map["emergency_stop"].number]
        for pressed in (0, 1, 0):
            self._plc.write(stop, pressed)
            self._scans(2)
        self._plc.press(self.machine.tags.commands.clear)
        self._scans(2)

    def _write(self, values: Mapping[Bit | Word, int], devices: Collection[Bit | Word]) -> None:
        for device, value in values.items():
            if device in devices:
                self._plc.write(device, value)

    def _scans(self, count: int) -> None:
        for _ in range(count):
            self._scan()

    def _scan(self) -> None:
        self._sense()
        self._execution.run(self._now_ms, first=False)
        self._now_ms += self._scan_ms


def _needed_inputs(machine: Transplanter) -> frozenset[int]:
    """Return the X numbers of the inputs whose inactive state is the cause of an alarm, such as air pressure."""
    inputs = Inputs(machine.io_map)
    causes = {alarm.cause for alarm in machine.alarms}
    return frozenset(point.number for point in machine.io_map.inputs if inputs.optional_off(point.tag) in causes)
