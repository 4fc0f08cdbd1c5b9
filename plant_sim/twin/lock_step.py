"""Twin: controller and plant in one process, in lock step and in simulated time.

This module defines the order within a tick: run the scan, advance the plant to the next scan, advance the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from controller.common.modbus.io_map import IoMap
from controller.core.clock import SimulatedClock
from controller.core.expr import Expr, any_of
from controller.core.machine_code import MachineExecution
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc, PythonExecution
from controller.events.kinds import Event
from controller.events.production import ProductionLog
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.program.machine import Transplanter
from controller.program.operator.start_warning import warning_ms
from controller.program.states import State
from plant_sim.faults import Fault
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import check_fit, default_io_map, default_parameters, program_of, set_points_of
from plant_sim.twin.compiled_run import CompiledRun
from plant_sim.twin.conditions import Interpreter, check_advances
from plant_sim.twin.debug.run_recorder import RunRecorder
from plant_sim.twin.kernel import CHANGE, CONDITION
from plant_sim.twin.readings import Readings
from plant_sim.twin.watchers import Trigger, Watched

SCAN_MS = 10
INPUT_MS = 100
"""Time in which a button takes effect, ms."""
CLEAR_MS = 3_200
"""Duration of the X24 press for clearing, ms; 3 to 10 s are required."""


class NotReachedError(AssertionError):
    """Condition not met within its time limit; the message contains the state of the machine."""


class TwinSnapshot(NamedTuple):
    """State of a twin at the end of a tick.

    Attributes:
        controller: Running controller and its parts.
        states: States of these parts, of the plant, its I/O module and the clock.
        events: Events so far.
        retained: Contents of the retentive store.
        releases: Times at which pressed buttons are released, ms.
        watchers: Monitors, periodic actions, and triggers with their states.
    """

    controller: tuple[Any, ...]
    states: tuple[Any, ...]
    events: tuple[Event, ...]
    retained: dict[str, int] | None
    releases: dict[str, int]
    watchers: tuple[Any, ...]


class Twin(Watched, Readings):
    """Machine program and simulated plant in simulated time.

    Attributes:
        parameters: Parameters of the simulated machine.
        plant: The simulated machine.
        module: Remote I/O module of the plant.
        machine: The program and its tags.
        runtime: PLC runtime with its field link; replaced at `power_on`.
        events: Events of the controller, in order.
        releases: Times at which pressed buttons are released, ms.
        recorder: Recorder of the run; None = none.
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
        step_by_step: bool = False,
        machine: Transplanter | None = None,
        misfit: bool = False,
    ) -> None:
        """Power up a machine in its initial position, with the controller in Stopped.

        Args:
            seed: Seed of the plant's random numbers.
            trays: Full trays in the magazine.
            io_map: I/O map; None = the default map.
            parameters: Machine parameters; None = the defaults.
            set_points: Initial values of set-points, by name of `SetPoints`.
            faults: Faults of the plant.
            step_by_step: True to execute the program and every tick in Python; the results are the same.
            machine: Program and its tags, for the same I/O map; None = the program of the I/O map.
            misfit: True to permit constants that do not fit the machine, in order to show what they do.

        Raises:
            FaultError: A fault is not possible in this plant.
            MisfitError: The constants of the program do not fit the machine.
        """
        Watched.__init__(self)
        self.io_map = io_map or default_io_map()
        self.parameters = parameters or default_parameters()
        self.plant = Plant(self.io_map, self.parameters, seed=seed, trays=trays, faults=faults)
        self.module = IoModule(self.plant, self.io_map)
        self.machine: Transplanter = machine or program_of(self.io_map)
        Readings.__init__(self)
        self.clock = SimulatedClock()
        self.events: list[Event] = []
        self.store = MemoryStore()
        self._step_by_step = step_by_step
        self._set_points = set_points_of(self.parameters) | dict(set_points or {})
        if not misfit:
            check_fit(self.machine, self.parameters, self._set_points)
        self.runtime: Runtime
        self.releases: dict[str, int] = {}
        self._compiled: CompiledRun | None = None
        self.recorder: RunRecorder | None = None
        self.power_on()

    def power_on(self) -> None:
        """Start the controller with its retentive memory."""
        program = self.machine.program
        execution = PythonExecution(program) if self._step_by_step else MachineExecution(program)
        plc = Plc(program, execution=execution)
        for name, value in self._set_points.items():
            plc.write(getattr(self.machine.tags.sp, name), value)
        if (retained := self.store.load()) is not None:
            plc.restore_retained(retained)
        self._link = InProcessLink(self.module)
        self._link.open()
        self._writer = DirectRetentiveWriter(self.store)
        self.runtime = Runtime(self.machine, plc, self._link, self._writer)
        self._log = ProductionLog(self.machine, self.events.append)
        self.runtime.observers.append(self._log)
        if isinstance(execution, MachineExecution):
            self._compiled = CompiledRun(self.runtime, self.module, execution, scan_ms=SCAN_MS)
            self._on_watchers_changed()

    def snapshot(self) -> TwinSnapshot:
        """Return the complete state of the machine and its controller, with the registered monitors.

        The state of a monitor itself is not included.
        """
        controller = (self.runtime, self._log, self._link, self._writer, self._compiled)
        return TwinSnapshot(
            controller,
            tuple(part.save() for part in (*controller[:4], self.plant, self.module, self.clock)),
            (*self.events,),
            self.store.values,
            dict(self.releases),
            self._save_watchers(),
        )

    def restore(self, snapshot: TwinSnapshot) -> None:
        """Restore a state of this twin; the same snapshot can be restored several times."""
        compiled = self._compiled
        self.runtime, self._log, self._link, self._writer, self._compiled = snapshot.controller
        parts = (*snapshot.controller[:4], self.plant, self.module, self.clock)
        for part, state in zip(parts, snapshot.states, strict=True):
            part.restore(state)
        self.events[:] = snapshot.events
        self.store.values = snapshot.retained
        self.releases = dict(snapshot.releases)
        if self._restore_watchers(snapshot.watchers) or self._compiled is not compiled:
            self._on_watchers_changed()

    def drop_observers(self) -> None:
        """Call no observers of others, such as those of a server, so that scans can run in machine code."""
        self.runtime.observers[:] = [self._log]

    def power_cycle(self, off_ms: int = 1_000) -> None:
        """Kill the controller between two scans, and restart it after `off_ms` of plant time."""
        if self.recorder is not None:
            self.recorder.switch_off(off_ms)
        self.module.advance(off_ms)
        self.clock.advance(off_ms)
        self.power_on()
        if self.recorder is not None:
            self.recorder.switch_on()

    def scan(self) -> None:
        """Run one scan, then advance the plant to the next scan."""
        if self.recorder is None:
            self._scan()
        else:
            with self.runtime.gate:
                self.recorder.begin(self.now_ms + SCAN_MS)
                self._scan()
                self.recorder.end()

    def _scan(self) -> None:
        now_ms = self.clock.now_ms()
        if self.releases:
            self._release_buttons(now_ms)
        self.runtime.tick(now_ms)
        self._watch_scan(now_ms, self._begun(self._triggers_hold()))
        self._advance_plant()

    def run_for(self, ms: int) -> None:
        """Run for a time, rounded down to complete scans."""
        self._run(self.now_ms + ms - ms % SCAN_MS, None)

    def run_until(self, condition: Expr | Callable[[], bool], *, within_ms: int, what: str = "condition") -> int:
        """Run until a condition is met after a scan.

        Args:
            condition: Condition over the devices of the program and the state of the plant; or a function, which is
                called after every scan, so that the twin cannot run in machine code.
            within_ms: Time limit, ms, rounded up to complete scans.
            what: Description of the condition for the error.

        Returns:
            Elapsed simulated time, ms.

        Raises:
            NotReachedError: The condition was not met within the time limit.
        """
        since_ms = self.now_ms
        if self.runs_until(condition, for_ms=within_ms):
            return self.now_ms - since_ms
        raise NotReachedError(f"{what} not reached within {within_ms} ms; {self.situation()}")

    def runs_until(self, condition: Expr | Callable[[], bool], *, for_ms: int) -> bool:
        """Run for a time, or until a condition is met after a scan; return True if it is met.

        Args:
            condition: As for `run_until`.
            for_ms: Time, ms, rounded up to complete scans.

        Raises:
            ValueError: The condition contains `Advances`.
        """
        if not callable(condition):
            check_advances(condition, allowed=0)
        return self._run(self.now_ms - -for_ms // SCAN_MS * SCAN_MS, condition)

    def run_until_state(self, *states: State, within_ms: int) -> int:
        """Run until the machine is in one of the PackML states; return the elapsed time, ms."""
        word = self.machine.tags.machine.state
        condition = any_of(*(word.equals(state) for state in states))
        return self.run_until(condition, within_ms=within_ms, what=" or ".join(state.name for state in states))

    def _run(self, until_ms: int, condition: Expr | Callable[[], bool] | None) -> bool:
        """Run until a time; return True as soon as the condition is met after a scan."""
        while self.now_ms < until_ms:
            if not callable(condition) and self._run_recorded(until_ms, condition):
                return True
            if self.now_ms >= until_ms:
                break
            self.scan()
            if self._is_met(condition):
                return True
        return False

    def _run_recorded(self, until_ms: int, condition: Expr | None) -> bool:
        """Run in machine code as far as possible, and let the recorder look in between."""
        recorder = self.recorder
        if recorder is None:
            return self._run_compiled(until_ms, condition)
        while self.now_ms < until_ms:
            with self.runtime.gate:
                since_ms, stop_ms = self.now_ms, recorder.begin(until_ms)
                met = self._run_compiled(stop_ms, condition)
                recorder.end()
            if met or self.now_ms < stop_ms or self.now_ms == since_ms:
                return met
        return False

    def _run_compiled(self, until_ms: int, condition: Expr | None) -> bool:
        """Run in machine code as far as possible; return True if the condition is met after a scan."""
        run = self._compiled
        if run is None or self._watches_every_scan:
            return False
        report = True
        while self.now_ms < until_ms and run.serves(self.runtime) and self.runtime.observers == [self._log]:
            if self.releases:
                self._release_buttons(self.now_ms)
            stop_ms = self._last_tick_ms(until_ms)
            if stop_ms <= self.now_ms:
                return False
            # watchers may change anything, so that the tick is completed in Python
            observe = None if self._has_watchers else self.runtime.notify_observers
            now_ms, reason = run.ticks(stop_ms, condition, now_ms=self.now_ms, report=report, observe=observe)
            report = False
            self.clock.advance(now_ms - self.now_ms)
            if reason == CHANGE:
                self.runtime.notify_observers(now_ms)
                self._watch_scan(now_ms, run.begun())
                happenings = self.plant.happenings
                self._advance_plant()
                report = self.plant.happenings != happenings
            if reason == CONDITION or (reason == CHANGE and self._is_met(condition)):
                return True
        return False

    def _last_tick_ms(self, until_ms: int) -> int:
        """Return the end of the last tick that contains no release of a button, periodic action or fault, ms."""
        stop_ms = min((until_ms, *self.releases.values(), *self._next_action_ms(self.now_ms)))
        fault_ms = self.plant.faults.next_ms
        if fault_ms is not None:
            stop_ms = min(stop_ms, self.now_ms + fault_ms - self.plant.time_ms)
        return stop_ms - (stop_ms - self.now_ms) % SCAN_MS

    def _watch_scan(self, now_ms: int, begun: Iterable[Trigger]) -> None:
        """Call the watchers after a scan."""
        if self.recorder is None:
            self._call_watchers(now_ms, begun)
        else:
            self.recorder.watch(lambda: self._call_watchers(now_ms, begun))

    def _advance_plant(self) -> None:
        """Advance the plant to the next scan."""
        self.module.advance(SCAN_MS)
        self.clock.advance(SCAN_MS)

    def _on_watchers_changed(self) -> None:
        """Adapt the devices that interrupt a run in machine code to the observers and monitors."""
        if self._compiled is not None:
            self._compiled.watch(lambda: [*self._log.devices, *self._watched_devices], self._triggers)

    def _is_met(self, condition: Expr | Callable[[], bool] | None) -> bool:
        if condition is None or callable(condition):
            return condition is not None and condition()
        run = self._executed
        return run.holds(condition) if run is not None else self._interpreter.holds(condition)

    def _triggers_hold(self) -> list[bool]:
        run = self._executed if self._triggers else None
        if run is not None:
            return run.triggers_hold()
        return [self._interpreter.holds(trigger.condition, trigger.cells) for trigger in self._triggers]

    @property
    def _executed(self) -> CompiledRun | None:
        """Compiled run, if the controller executes its machine code."""
        return self._compiled if self._compiled is not None and self._compiled.executes(self.runtime) else None

    @property
    def _interpreter(self) -> Interpreter:
        return Interpreter(self.plc.memory, self.plant.state)

    def press(self, button: str, for_ms: int = 100) -> None:
        """Press a push button; it is released automatically after `for_ms`."""
        setattr(self.plant.box, button, True)
        self.releases[button] = self.now_ms + for_ms

    def command(self, name: str) -> None:
        """Issue a command from the command table for one scan."""
        self.plc.press(self.machine.tags.commands[name])

    def confirm_constants(self) -> None:
        """Press X25, release it and clear, if the program waits for this because a machine constant differs."""
        self.scan()
        if self.plc.read(self.machine.tags.machine.constants_open):
            self.run_for(INPUT_MS)
            self.press("emergency_stop", for_ms=INPUT_MS)
            self.run_until_state(State.ABORTED, within_ms=INPUT_MS)
            self.run_for(INPUT_MS)
            self.press("stop", for_ms=CLEAR_MS)
            self.run_for(CLEAR_MS + INPUT_MS)

    def home(self, within_ms: int = 40_000) -> None:
        """Press X0 in Stopped and wait for Idle, after machine constants have been confirmed if necessary."""
        self.confirm_constants()
        self.press("start")
        self.run_until_state(State.IDLE, within_ms=within_ms)

    def start(self) -> None:
        """Press X0 in Idle and wait for Execute."""
        self.run_for(200)
        self.press("start")
        self.run_until_state(State.EXECUTE, within_ms=1_000 + warning_ms(self.machine.tags))

    def _release_buttons(self, now_ms: int) -> None:
        for button, until_ms in list(self.releases.items()):
            if now_ms >= until_ms:
                setattr(self.plant.box, button, False)
                del self.releases[button]
