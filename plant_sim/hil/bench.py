"""Bench: an I/O module whose controller is operated and judged in procedures."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from plant_sim.faults import FaultError, parse_fault
from plant_sim.hil.machine_view import FLICKER_CHANGES, SIDES, MachineView
from plant_sim.hil.procedure import CaseError, Condition, NotRunError, Procedure, Wait
from plant_sim.hil.reference import TrialQuantities
from plant_sim.hil.selection import BenchLimits
from plant_sim.hil.situations import SituationLog
from plant_sim.hil.trace import WireTrace
from plant_sim.hil.work import WorkMeter
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import Machine
from plant_sim.machine.stored_air import relieve

RELEASED_MS: Final = 1_500
"""Time without motion after which a machine without an active output rests, ms."""
HELD_MS: Final = 10_000
"""Time without motion and without a change of the outputs after which a machine with active outputs rests, ms."""


class Figure(NamedTuple):
    """Measured value with its unit.

    Attributes:
        value: Value.
        unit: Unit; empty for a number of items.
    """

    value: float
    unit: str = ""

    @property
    def text(self) -> str:
        """Value and unit."""
        return f"{self.value:g} {self.unit}".rstrip()


@dataclass(slots=True)
class Findings:
    """Findings of the case that runs.

    Attributes:
        violations: Violated rules by name, first violation only.
        figures: Measured values by name.
        mark_ms: Plant time of the event that the picture of the case shows, ms; None = the end of the case.
    """

    violations: dict[str, str] = field(default_factory=dict)
    figures: dict[str, Figure] = field(default_factory=dict)
    mark_ms: int | None = None


@dataclass(slots=True)
class ControllerSupply:
    """Power and link of a controller.

    Attributes:
        is_on: True while the controller has power.
        is_linked: True while its link to the I/O module is connected.
    """

    is_on: bool = True
    is_linked: bool = True


class Bench:
    """Operation and observation of the plant for the procedures.

    Attributes:
        module: I/O module.
        view: Outputs and motion.
        limits: Limits.
        trace: Levels of all wires over time.
        situations: Situations of the arms and the tray so far.
        findings: Findings of the case that runs.
        forbidden: Reason for which no actuator may be switched on; empty = permitted.
        work: Quantities of undisturbed work.
        reference: Quantities of the trial of the machine's own program; None = not compared.
        trial: Quantities of the last complete trial; None = none yet.
        supply: Power and link of the controller; None = the bench cannot interrupt them.
        is_interrupted: True while the bench interrupts them, so that the output watchdog trips.
        resting: Actuators that were on when the machine came to rest, and may stay on while `forbidden`.
    """

    def __init__(self, module: IoModule, machine: Machine, limits: BenchLimits | None = None) -> None:
        """Create the bench of a module; `play` starts a procedure.

        Args:
            module: I/O module of the plant.
            machine: Parameters of the plant.
            limits: Limits; None = the defaults.
        """
        self.module = module
        self.view = MachineView(module, feed_m=machine.slide.switch_band_m + machine.slide.switch_hysteresis_m)
        self.limits = limits or BenchLimits()
        self.trace = WireTrace(module)
        self.situations = SituationLog(self.view)
        self.findings = Findings()
        self.work = WorkMeter(self.view, pitch_m=machine.cups.pitch_m)
        self.reference: TrialQuantities | None = None
        self.trial: TrialQuantities | None = None
        self.supply: ControllerSupply | None = None
        self.is_interrupted = False
        self.forbidden = ""
        self.resting: frozenset[str] = frozenset()
        self._faults: list[str] = []
        self._procedure: Procedure | None = None
        self._wait: Wait | None = None
        self._ended: Callable[[], None] = lambda: None
        self._events_seen = 0
        self._stop_ms: int | None = None
        self._off_ms = self.limits.stop_ms
        module.observers.append(self.observe)

    @property
    def now_ms(self) -> int:
        """Plant time, ms."""
        return self.view.now_ms

    def play(self, procedure: Procedure, *, ended: Callable[[], None]) -> None:
        """Start a procedure; `ended` is called after its end."""
        self._procedure, self._ended = procedure, ended
        self._resume(None)

    def observe(self) -> None:
        """Take over the state of the plant, check the rules and resume the procedure; called after every advance."""
        self.view.update()
        self.trace.sample()
        self.situations.update()
        self.work.update()
        self._check_rules()
        while (wait := self._wait) is not None:
            if wait.condition():
                self._resume(True)
            elif self.now_ms >= wait.until_ms:
                self._resume(False)
            else:
                return

    def _resume(self, value: bool | None) -> None:
        procedure = self._procedure
        if procedure is None:
            return
        try:
            self._wait = next(procedure) if value is None else procedure.send(value)
        except StopIteration:
            self._procedure = self._wait = None
            self._ended()

    # --- actions of a procedure

    def until(self, condition: Condition, within_ms: int, what: str) -> Procedure:
        """Wait for a condition.

        Raises:
            CaseError: The condition was not met in time.
        """
        if not (yield Wait(condition, self.now_ms + within_ms)):
            silent = "; the controller no longer writes its outputs" if self.module.tripped else ""
            raise CaseError(f"{what}: not within {within_ms / 1000:g} s{silent}")

    def reached(self, condition: Condition, within_ms: int) -> Generator[Wait, bool, bool]:
        """Wait for a condition; return whether it was met in time."""
        return (yield Wait(condition, self.now_ms + within_ms))

    def pause(self, for_ms: int) -> Procedure:
        """Wait for a time, ms."""
        yield Wait(lambda: False, self.now_ms + for_ms)

    def hold(self, button: str, for_ms: int) -> Procedure:
        """Press a button for a time, then release it and wait 0.2 s."""
        self.end_work()
        setattr(self.module.plant.box, button, True)
        yield from self.pause(for_ms)
        setattr(self.module.plant.box, button, False)
        yield from self.pause(200)

    def release_buttons(self) -> None:
        """Release start and stop, which an interrupted procedure may have left pressed."""
        self.module.plant.box.start = self.module.plant.box.stop = False

    def press_emergency_stop(self) -> None:
        """Press the emergency stop, which latches; from now on the reaction is measured."""
        self.module.plant.box.emergency_stop = True
        self.expect_off()

    def expect_off(self, within_ms: int | None = None) -> None:
        """Require from now on that all actuators are off within a time, ms; None = that of the emergency stop."""
        self.end_work()
        self._stop_ms = self.findings.mark_ms = self.now_ms
        self._off_ms = self.limits.stop_ms if within_ms is None else within_ms
        self.forbidden = ""

    def release_emergency_stop(self) -> None:
        """Release the emergency stop; no actuator may switch on before the next press."""
        self.module.plant.box.emergency_stop = False
        self.forbid_start()

    def forbid_start(self) -> None:
        """Forbid that an actuator is switched on before start is pressed."""
        self._stop_ms = None
        self.forbid("before start was pressed")

    def forbid(self, reason: str, *, resting: frozenset[str] = frozenset()) -> None:
        """Forbid that an actuator is switched on; those of a machine at rest may stay on."""
        self.forbidden, self.resting = reason, resting

    def set_fault(self, text: str) -> None:
        """Start a fault of the plant.

        Raises:
            NotRunError: This machine cannot have the fault, or has it already.
        """
        self.end_work()
        try:
            fault = parse_fault(text)
            self.module.plant.faults.add(fault)
        except FaultError as error:
            raise NotRunError(str(error)) from error
        self._faults.append(fault.name)
        self.findings.mark_ms = self.now_ms

    def repair(self) -> None:
        """Clear the faults that cases have started; those of the options remain.

        The arm is supported and a jammed slide or lift relieved first, as the guide requires: the air behind it would
        drive it as soon as it is free, with all coils off.
        """
        plant = self.module.plant
        while self._faults:
            name = self._faults.pop()
            if name.startswith("jammed:") and name.endswith((".slide", ".lift")):
                relieve(plant, name.removeprefix("jammed:"))
            plant.faults.clear(name)

    def end_work(self) -> None:
        """End the span of undisturbed work, and judge it."""
        for name, text in self.work.end(self.reference):
            self.violate(name, text)

    # --- rules

    def violate(self, name: str, text: str) -> None:
        """Note the violation of a rule; the first one of each name is kept."""
        if name not in self.findings.violations:
            self.findings.violations[name] = f"{text}, at {self.now_ms / 1000:.3f} s"
            if self.findings.mark_ms is None:
                self.findings.mark_ms = self.now_ms

    def _check_rules(self) -> None:
        view = self.view
        for one, other in view.opposite_outputs():
            self.violate("opposite outputs", f"{one} and {other} are on together")
        if view.flickering:
            self.violate("flicker", f"{_listed(view.flickering)} switched {FLICKER_CHANGES} times in quick succession")
        if self.module.tripped and not self.is_interrupted:
            self.violate("output watchdog", f"no output written for {self.module.watchdog_ms} ms")
        events = self.module.plant.events
        for event in events[self._events_seen :]:
            self.violate(event.kind.value, event.text)
        self._events_seen = len(events)
        if not view.on:
            if self._stop_ms is not None and view.changed_ms >= self._stop_ms:
                self.findings.figures["outputs off after"] = Figure(view.changed_ms - self._stop_ms, "ms")
        elif self._stop_ms is not None and self.now_ms - self._stop_ms > self._off_ms:
            self.violate("emergency stop", f"{_listed(view.on)} on {self.now_ms - self._stop_ms} ms after the press")
        self.resting &= view.on
        if self.forbidden and view.on > self.resting:
            self.violate("unexpected start", f"{_listed(view.on - self.resting)} on {self.forbidden}")

    @property
    def is_home(self) -> bool:
        """True if both arms stand at feed and nothing happens any more.

        A program may drive a cylinder against its end for seconds, or keep a coil switched on at rest.
        """
        rests = self.view.quiet_for(HELD_MS if self.view.on else RELEASED_MS)
        return rests and all(map(self.view.at_feed, SIDES))


def _listed(tags: frozenset[str]) -> str:
    return ", ".join(sorted(tags))
