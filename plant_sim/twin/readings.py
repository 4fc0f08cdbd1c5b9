"""Readings of a twin: state, steps, outputs, alarms and cycles."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from controller.core.clock import SimulatedClock
from controller.core.expr import Bit
from controller.core.scan import Plc
from controller.core.sequence import Sequence
from controller.events.kinds import AlarmEvent, CycleEvent, Event
from controller.io.runtime import Runtime
from controller.program.machine import Transplanter
from controller.program.states import State
from plant_sim.machine.plant import Plant


class Readings:
    """Base class of a twin: readings of a machine program and its plant, which change nothing.

    Attributes:
        io_map: I/O map.
        plant: The simulated machine.
        machine: The program and its tags.
        runtime: PLC runtime with its field link.
        clock: Simulated time.
        events: Events of the controller, in order.
    """

    io_map: IoMap
    plant: Plant
    machine: Transplanter
    runtime: Runtime
    clock: SimulatedClock
    events: list[Event]

    def __init__(self) -> None:
        # the subclass has set the program
        self._sequences: dict[str, Sequence] = {each.name: each for each in self.machine.program.sequences()}
        self._steps = [(bit.name, bit.number) for each in self._sequences.values() for bit, _ in each]

    def __repr__(self) -> str:
        counts = self.plant.counts()
        alarms = ", ".join(self.alarms()) or "none"
        state = self.state.name if self.plc.read(self.machine.tags.machine.state) else "no scan yet"
        return (
            f"<Twin at {self.now_ms / 1000:.2f} s: {state}, {counts.in_cups} of {counts.total} seedlings in "
            f"cups, alarms {alarms}>"
        )

    @property
    def plc(self) -> Plc:
        """The PLC of the running controller."""
        return self.runtime.plc

    @property
    def now_ms(self) -> int:
        """Simulated time, ms."""
        return self.clock.now_ms()

    @property
    def state(self) -> State:
        """PackML state after the last scan."""
        return State(self.plc.read(self.machine.tags.machine.state))

    def active_steps(self) -> list[str]:
        """Return every active step as 'sequence: step'."""
        active = self.plc.memory.S
        return [name for name, number in self._steps if active[number]]

    def step_of(self, sequence: str, step: str) -> Bit:
        """Return the state that is on while a step is active."""
        return self._sequences[sequence][step]

    def in_step(self, sequence: str, step: str) -> bool:
        """Return True if a step is active."""
        return self.plc.memory.S[self.step_of(sequence, step).number]

    def outputs(self) -> set[str]:
        """Return the tags of the outputs that are on (logical state)."""
        released = self.runtime.released
        return {point.tag for point in self.io_map.outputs if point.active(released[point.number])}

    def alarms(self) -> list[str]:
        """Return the keys of the annunciators that are set, prefixed with the side, if any."""
        active = [self.machine.alarms.of(number) for number in self.plc.annunciators()]
        return [f"{alarm.side}: {alarm.key}" if alarm.side else alarm.key for alarm in active]

    def cycles(self) -> list[CycleEvent]:
        """Return the cycles completed so far."""
        return [event for event in self.events if isinstance(event, CycleEvent)]

    def alarm_events(self) -> list[AlarmEvent]:
        """Return the alarm events (active and cleared) so far."""
        return [event for event in self.events if isinstance(event, AlarmEvent)]

    def situation(self) -> str:
        """Return the time, state, active steps, outputs and alarms as one line for error messages."""
        at = f"at {self.now_ms} ms {self.state.name}, steps {self.active_steps()}"
        return f"{at}, outputs {sorted(self.outputs())}, alarms {self.alarms()}"
