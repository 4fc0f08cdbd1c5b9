"""Twin: controller and plant in one process, in lock step and in simulated time.

This module defines the order within a tick: run the scan, advance the plant to the next scan, advance the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache

from controller.core.clock import SimulatedClock
from controller.core.machine_code import MachineExecution
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.events.production import AlarmEvent, CycleEvent, Event, ProductionLog
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, IoMap, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.states import State
from plant_sim.faults import Fault
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import set_points_of

SCAN_MS = 10


class NotReachedError(AssertionError):
    """Condition not met within its time limit; the message contains the state of the machine."""


class Twin:
    """Machine program and simulated plant in simulated time.

    Attributes:
        parameters: Parameters of the simulated machine.
        plant: The simulated machine.
        module: Remote I/O module of the plant.
        machine: The program and its tags.
        runtime: PLC runtime with its field link; replaced at `power_on`.
        events: Events of the controller, in order.
    """

    def __init__(
        self,
        *,
        seed: int = 1,
        trays: int = 2,
        io_map: IoMap | None = None,
        parameters: Machine | None = None,
        set_points: Mapping[str, int] | None = None,
        faults: Iterable[Fault] = (),
    ) -> None:
        """Power up a machine in its initial position, with the controller in Stopped.

        Args:
            seed: Seed of the plant's random numbers.
            trays: Full trays in the magazine.
            io_map: I/O map; None = the default map.
            parameters: Machine parameters; None = the defaults.
            set_points: Initial values of set-points, by name of `SetPoints`.
            faults: Faults of the plant.

        Raises:
            FaultError: A fault is not possible in this plant.
        """
        self.io_map = io_map or _default_io_map()
        self.parameters = parameters or _default_parameters()
        self.plant = Plant(self.io_map, self.parameters, seed=seed, trays=trays, faults=faults)
        self.module = IoModule(self.plant, self.io_map)
        self.machine: Transplanter = _machine(self.io_map)
        self._sequences = {sequence.name: sequence for sequence in self.machine.program.sequences()}
        self._steps = [(bit.name, bit.number) for sequence in self._sequences.values() for bit, _ in sequence]
        self.clock = SimulatedClock()
        self.events: list[Event] = []
        self.store = MemoryStore()
        self._set_points = set_points_of(self.parameters) | dict(set_points or {})
        self.runtime: Runtime
        self._releases: dict[str, int] = {}
        self._monitors: list[Callable[[Twin], None]] = []
        self.power_on()

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

    def power_on(self) -> None:
        """Start the controller with its retentive memory."""
        program = self.machine.program
        plc = Plc(program, execution=MachineExecution(program))
        for name, value in self._set_points.items():
            plc.write(getattr(self.machine.tags.sp, name), value)
        retained = self.store.load()
        if retained is not None:
            plc.restore(retained)
        link = InProcessLink(self.module)
        link.open()
        self.runtime = Runtime(self.machine, plc, link, DirectRetentiveWriter(self.store))
        self.runtime.observers.append(ProductionLog(self.machine, self.events.append))

    def power_cycle(self, off_ms: int = 1_000) -> None:
        """Kill the controller between two scans, and restart it after `off_ms` of plant time."""
        self.module.advance(off_ms)
        self.clock.advance(off_ms)
        self.power_on()

    def watch(self, monitor: Callable[[Twin], None]) -> None:
        """Register a safety monitor that is called after every scan."""
        self._monitors.append(monitor)

    def scan(self) -> None:
        """Run one scan, then advance the plant to the next scan."""
        now_ms = self.clock.now_ms()
        if self._releases:
            self._release_buttons(now_ms)
        self.runtime.tick(now_ms)
        for monitor in self._monitors:
            monitor(self)
        self.module.advance(SCAN_MS)
        self.clock.advance(SCAN_MS)

    def run_for(self, ms: int) -> None:
        """Run for a time, rounded down to complete scans."""
        for _ in range(ms // SCAN_MS):
            self.scan()

    def run_until(self, condition: Callable[[], bool], *, within_ms: int, what: str = "condition") -> int:
        """Run until a condition is met after a scan.

        Returns:
            Elapsed simulated time, ms.

        Raises:
            NotReachedError: The condition was not met within the time limit.
        """
        since_ms = self.now_ms
        while self.now_ms - since_ms < within_ms:
            self.scan()
            if condition():
                return self.now_ms - since_ms
        raise NotReachedError(f"{what} not reached within {within_ms} ms; {self.situation()}")

    def run_until_state(self, state: State, *, within_ms: int) -> int:
        """Run until the machine is in a PackML state; return the elapsed time, ms."""
        return self.run_until(lambda: self.state == state, within_ms=within_ms, what=state.name)

    def press(self, button: str, for_ms: int = 100) -> None:
        """Press a push button; it is released automatically after `for_ms`."""
        setattr(self.plant.box, button, True)
        self._releases[button] = self.now_ms + for_ms

    def command(self, name: str) -> None:
        """Issue a command from the command table for one scan."""
        self.plc.press(self.machine.tags.commands[name])

    def home(self, within_ms: int = 40_000) -> None:
        """Press X0 in Stopped and wait for Idle."""
        self.scan()
        self.press("start")
        self.run_until_state(State.IDLE, within_ms=within_ms)

    def start(self) -> None:
        """Press X0 in Idle and wait for Execute."""
        self.run_for(200)
        self.press("start")
        self.run_until_state(State.EXECUTE, within_ms=1_000)

    def active_steps(self) -> list[str]:
        """Return every active step as 'sequence: step'."""
        active = self.plc.memory.S
        return [name for name, number in self._steps if active[number]]

    def in_step(self, sequence: str, step: str) -> bool:
        """Return True if a step is active."""
        return self.plc.memory.S[self._sequences[sequence][step].number]

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
        return (
            f"at {self.now_ms} ms {self.state.name}, steps {self.active_steps()}, "
            f"outputs {sorted(self.outputs())}, alarms {self.alarms()}"
        )

    def _release_buttons(self, now_ms: int) -> None:
        for button, until_ms in list(self._releases.items()):
            if now_ms >= until_ms:
                setattr(self.plant.box, button, False)
                del self._releases[button]


@cache
def _default_io_map() -> IoMap:
    return load_io_map(DEFAULT_IO_MAP)


@cache
def _default_parameters() -> Machine:
    return load_machine()


@lru_cache(maxsize=8)
def _machine(io_map: IoMap) -> Transplanter:
    return build(io_map)
