"""The twin: controller and plant in one process, in lock step and simulated time.

One tick order, written here: scan, then the plant up to the next scan, then the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache

from controller.core.clock import SimulatedClock
from controller.core.retain import MemoryStore
from controller.core.scan import Plc
from controller.hmi.production import AlarmEvent, CycleEvent, Event, ProductionLog
from controller.io.keeper import DirectKeeper
from controller.io.runtime import Runtime
from controller.io_map import DEFAULT_IO_MAP, IoMap, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.states import State
from plant_sim.bench.commissioning import set_points_of
from plant_sim.faults import Fault
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule
from plant_sim.parameters import Machine, load_machine
from plant_sim.plant import Plant

SCAN_MS = 10


class NotReachedError(AssertionError):
    """A condition did not come true within its time; the message tells the machine's situation."""


class Twin:
    """One machine: real program, real plant, simulated time.

    Attributes:
        parameters: Parameters of the simulated machine.
        plant: The simulated machine.
        module: Its remote I/O.
        machine: The program and its tags.
        runtime: The PLC on its link; replaced at `power_on`.
        events: Everything the controller reported, in order.
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
        """Switch a machine on; it stands as its builder left it, and the controller is in Stopped.

        Args:
            seed: Seed of everything random in the plant.
            trays: Full trays in the magazine.
            io_map: Wires; None = the map of the repository.
            parameters: Machine parameters; None = those of the repository.
            set_points: First values of set-points, by name of `SetPoints`.
            faults: What breaks in the plant, and when.

        Raises:
            FaultError: the plant cannot be broken so.
        """
        self.io_map = io_map or _default_io_map()
        self.parameters = parameters or _default_parameters()
        self.plant = Plant(self.io_map, self.parameters, seed=seed, trays=trays, faults=faults)
        self.module = IoModule(self.plant, self.io_map)
        self.machine: Transplanter = _machine(self.io_map)
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
        """Start the controller with what its retentive memory kept."""
        plc = Plc(self.machine.program)
        for name, value in self._set_points.items():
            plc.write(getattr(self.machine.tags.sp, name), value)
        kept = self.store.load()
        if kept is not None:
            plc.restore(kept)
        link = InProcessLink(self.module)
        link.open()
        self.runtime = Runtime(self.machine, plc, link, DirectKeeper(self.store))
        self.runtime.observers.append(ProductionLog(self.machine, self.events.append))

    def power_cycle(self, off_ms: int = 1_000) -> None:
        """Kill the controller between two scans, let the plant's watchdog act, start it again."""
        self.module.advance(off_ms)
        self.clock.advance(off_ms)
        self.power_on()

    def watch(self, monitor: Callable[[Twin], None]) -> None:
        """Call a safety monitor after every scan."""
        self._monitors.append(monitor)

    def scan(self) -> None:
        """One scan, then the plant up to the next one."""
        now_ms = self.clock.now_ms()
        if self._releases:
            self._let_go(now_ms)
        self.runtime.tick(now_ms)
        for monitor in self._monitors:
            monitor(self)
        self.module.advance(SCAN_MS)
        self.clock.advance(SCAN_MS)

    def run_for(self, ms: int) -> None:
        """Run for a time, a whole number of scans."""
        for _ in range(ms // SCAN_MS):
            self.scan()

    def run_until(self, condition: Callable[[], bool], *, within_ms: int, what: str = "condition") -> int:
        """Run until a condition holds after a scan.

        Returns:
            Simulated time it took, ms.

        Raises:
            NotReachedError: It did not come true within the time.
        """
        since_ms = self.now_ms
        while self.now_ms - since_ms < within_ms:
            self.scan()
            if condition():
                return self.now_ms - since_ms
        raise NotReachedError(f"{what} not reached within {within_ms} ms; {self.situation()}")

    def run_until_state(self, state: State, *, within_ms: int) -> int:
        """Run until the machine is in a PackML state; return the time it took, ms."""
        return self.run_until(lambda: self.state == state, within_ms=within_ms, what=state.name)

    def press(self, button: str, for_ms: int = 100) -> None:
        """Press a button of the operator box; it is let go by itself after the time."""
        setattr(self.plant.box, button, True)
        self._releases[button] = self.now_ms + for_ms

    def command(self, name: str) -> None:
        """Give an order of the command table; it lives one scan."""
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
        """Return 'sequence: step' of every step that is on."""
        return [bit.name for sequence in self.machine.program.sequences() for bit, _ in sequence if self.plc.read(bit)]

    def in_step(self, sequence: str, step: str) -> bool:
        """Tell whether a step is on."""
        return any(each.name == sequence and self.plc.read(each[step]) for each in self.machine.program.sequences())

    def outputs(self) -> set[str]:
        """Return the tags of the outputs that are on (logical state)."""
        released = self.runtime.released
        return {point.tag for point in self.io_map.outputs if point.active(released[point.number])}

    def alarms(self) -> list[str]:
        """Return the keys of the annunciators that are set, with the side's name in front where there is one."""
        found = [self.machine.alarms.of(number) for number in self.plc.annunciators()]
        return [f"{alarm.side}: {alarm.key}" if alarm.side else alarm.key for alarm in found]

    def cycles(self) -> list[CycleEvent]:
        """Return the cycles completed so far."""
        return [event for event in self.events if isinstance(event, CycleEvent)]

    def alarm_events(self) -> list[AlarmEvent]:
        """Return every coming and going of an alarm so far."""
        return [event for event in self.events if isinstance(event, AlarmEvent)]

    def situation(self) -> str:
        """Return one line for error messages: time, state, steps, outputs, alarms."""
        return (
            f"at {self.now_ms} ms {self.state.name}, steps {self.active_steps()}, "
            f"outputs {sorted(self.outputs())}, alarms {self.alarms()}"
        )

    def _let_go(self, now_ms: int) -> None:
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
