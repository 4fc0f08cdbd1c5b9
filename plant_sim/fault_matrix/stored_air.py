"""Cases of the third table: slides and lifts whose air is gone, partly leaked or trapped by a jam."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Final, NamedTuple

from controller.iomap.loader import load_io_map
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.common.parameter_file import Value
from plant_sim.devices.pneumatic import Cylinder
from plant_sim.fault_matrix.run import START_MS, TRAY_LIMIT_MS, MatrixSetup
from plant_sim.faults import Fault
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.machine.stored_air import leak_down, set_air
from plant_sim.twin.lock_step import NotReachedError, Twin, TwinSnapshot
from plant_sim.twin.monitors import collect_violations
from plant_sim.twin.recovery import clear, home_again, press_emergency_stop

DRIVES: Final = ("slide", "lift")
LEAKED_SHARE: Final = 0.3
"""Pressure of partly leaked chambers, relative to the main line. Assumed."""
LEAK_MS: Final = 60_000
"""Time in which they leak, ms. Assumed; it is long compared with the motion of a sinking arm."""
SINK_MS: Final = 3_000
"""Time in which a vented arm sinks, ms."""
JAM_LIMIT_MS: Final = 60_000
"""Time limit for a jam to be noticed, ms: the device may have to wait for cups or for a tray first."""
BRIEF_MS: Final = 500
"""Duration of a brief jam, ms: the coil of the device is still on when it is freed."""
FREED_MS: Final = 1_000
"""Time after a jam until homing, ms; every motion of the freed device has ended by then."""
SAMPLE_MS: Final = 50
"""Distance of the instants at which motion is looked for, ms."""

REMEDIES: Final[Mapping[str, Mapping[str, Value]]] = {
    "none": {},
    "meter-in": {
        "slide.meter_in_conductance_m3_s_pa": 0.4e-9,
        "lift.meter_in_conductance_m3_s_pa": 2.5e-9,
    },
    "meter-in, lift regulators": {
        "slide.meter_in_conductance_m3_s_pa": 0.4e-9,
        "lift.meter_in_conductance_m3_s_pa": 2.5e-9,
        "lift.damper_n_s_m": 900.0,
    },
}
"""Parameters of the machine by remedy. Computed by search, see docs/stored-air.md: with 0.5e-9 and 3e-9, every remedied
case is still good, with 0.6e-9 and 4e-9 a switch is no longer believed."""


class AirCase(NamedTuple):
    """Case of the third table.

    Attributes:
        condition: Name in `CONDITIONS`.
        side: The arm.
        drive: Jammed device; empty if none is.
        at_ms: Time after entering Execute, ms.
    """

    condition: str
    side: Side
    drive: str
    at_ms: int


@dataclass
class AirOutcome:
    """Outcome of a case of the third table.

    Attributes:
        case: The case.
        slide_m_s: Highest speed of a slide, m/s.
        lift_m_s: Highest speed of a lift, m/s.
        jump_m: Travel of the freed device before homing, m.
        lost: Seedlings lost.
        trips: Monitor violations, by kind.
        reason: Reason for an incomplete trial; empty if there is none.
        too_fast: Devices that have exceeded their rating.
    """

    case: AirCase
    slide_m_s: float = 0.0
    lift_m_s: float = 0.0
    jump_m: float = 0.0
    lost: int = 0
    trips: dict[str, str] = field(default_factory=dict)
    reason: str = ""
    too_fast: tuple[str, ...] = ()

    @property
    def is_good(self) -> bool:
        """True if nothing was too fast, no seedling was lost, and work was completed without another stop."""
        return not (self.too_fast or self.lost or self.trips or self.reason)


class AirTrial(NamedTuple):
    """Trial without a fault, from which the cases continue.

    Attributes:
        twin: The twin, which is reused by the cases.
        begins: State on entering Execute.
        moves_ms: Times after entering Execute at which a slide or lift of each arm is in motion, ms.
        in_cups: Seedlings in the cups at the end.
    """

    twin: Twin
    begins: TwinSnapshot
    moves_ms: Mapping[Side, tuple[int, ...]]
    in_cups: int


def machine_with(setting: MatrixSetup, remedy: str) -> Machine:
    """Return the machine of the trial with a remedy, by its name in `REMEDIES`."""
    return load_machine(setting.machine).with_values(REMEDIES[remedy])


@cache
def air_trial(setting: MatrixSetup, remedy: str) -> AirTrial:
    """Run a trial without a fault.

    Raises:
        NotReachedError: It does not complete.
    """
    io_map, machine = load_io_map(setting.io_map), machine_with(setting, remedy)
    twin = Twin(
        seed=setting.seed,
        trays=setting.trays,
        io_map=io_map,
        parameters=machine,
        set_points={"trays_target": setting.trays},
    )
    twin.plant.seedlings.make_typical()  # so that every loss is caused by the air
    twin.home()
    twin.start()
    begins, begins_ms = twin.snapshot(), twin.now_ms
    moves_ms: dict[Side, list[int]] = {side: [] for side in SIDES}
    while twin.state is not State.COMPLETE:
        if twin.now_ms - begins_ms > setting.trays * TRAY_LIMIT_MS:
            raise NotReachedError(f"the trial without a fault does not complete; {twin.situation()}")
        for side in SIDES:
            if any(device.speed_m_s for device in _devices(twin, side)):
                moves_ms[side].append(twin.now_ms - begins_ms)
        twin.run_for(SAMPLE_MS)
    counts = twin.plant.counts()
    return AirTrial(twin, begins, {side: tuple(times) for side, times in moves_ms.items()}, counts.in_cups)


def air_cases(setting: MatrixSetup, remedy: str, *, moments: int) -> list[AirCase]:
    """Return the cases: moments spread evenly over the motion of each arm, in every condition."""
    moves_ms = air_trial(setting, remedy).moves_ms
    return [
        AirCase(condition, side, drive, moves_ms[side][(2 * number + 1) * len(moves_ms[side]) // (2 * moments)])
        for condition, kind in CONDITIONS.items()
        for side in SIDES
        for drive in (DRIVES if kind.jams else ("",))
        for number in range(moments)
    ]


def run_air_case(case: AirCase, setting: MatrixSetup, remedy: str) -> AirOutcome:
    """Run a case: the condition, recovery by the operator, and the rest of the trial.

    Args:
        case: The case.
        setting: Machine and trial.
        remedy: Name in `REMEDIES`.
    """
    trial = air_trial(setting, remedy)
    twin, outcome = trial.twin, AirOutcome(case)
    twin.restore(trial.begins)
    twin.unwatch()
    twin.run_for(case.at_ms)
    outcome.trips = collect_violations(twin)
    devices = {drive: [getattr(twin.plant.arms[side], drive) for side in SIDES] for drive in DRIVES}
    for device in (*devices["slide"], *devices["lift"]):
        device.fastest_m_s = 0.0
    try:
        CONDITIONS[case.condition].strike(twin, outcome)
        if twin.state is State.COMPLETE:  # the jammed device was no longer needed
            home_again(twin)
        elif twin.state in {State.STOPPED, State.HELD}:
            home_again(twin)
            twin.start()
        twin.run_until_state(State.COMPLETE, State.HELD, State.IDLE, within_ms=setting.trays * TRAY_LIMIT_MS)
        if twin.state is State.HELD:
            outcome.reason = f"Held: {', '.join(twin.alarms())}"
    except NotReachedError as error:
        outcome.reason = str(error)
    outcome.slide_m_s, outcome.lift_m_s = (max(device.fastest_m_s for device in devices[drive]) for drive in DRIVES)
    rating = twin.parameters.rating
    limits = {"slide": (outcome.slide_m_s, rating.slide_m_s), "lift": (outcome.lift_m_s, rating.lift_m_s)}
    outcome.too_fast = tuple(drive for drive, (speed_m_s, limit_m_s) in limits.items() if speed_m_s > limit_m_s)
    if not outcome.reason:
        outcome.lost = trial.in_cups - twin.plant.counts().in_cups
    return outcome


@dataclass(frozen=True, slots=True)
class AirCondition:
    """Condition of the air.

    Attributes:
        meaning: Description for the page.
        strike: Bring the machine into the condition and let it rest, ready to be homed unless it still works.
        jams: True if a device is jammed.
        is_remedied: True if the outcome is good with every remedy.
    """

    meaning: str
    strike: Callable[[Twin, AirOutcome], None]
    jams: bool = False
    is_remedied: bool = True


def _vented(twin: Twin, _outcome: AirOutcome) -> None:
    press_emergency_stop(twin)
    set_air(twin.plant, 0.0)
    twin.run_for(SINK_MS)
    clear(twin)


def _leaked(twin: Twin, _outcome: AirOutcome) -> None:
    press_emergency_stop(twin)
    leak_down(twin.plant, LEAKED_SHARE, LEAK_MS)
    twin.run_for(LEAK_MS)
    clear(twin)


def _freed(twin: Twin, outcome: AirOutcome, *, vents: bool = False) -> None:
    """Jam a device until the machine is Held, and free it while all coils are off."""
    fault = _jam(twin, outcome.case)
    twin.run_until_state(State.HELD, State.COMPLETE, within_ms=JAM_LIMIT_MS)
    twin.run_for(START_MS)
    device = _device(twin, outcome.case)
    if vents:
        device.set_air(0.0)
    before_m = device.position_m
    twin.plant.faults.clear(fault.name)
    twin.run_for(FREED_MS)
    outcome.jump_m = abs(device.position_m - before_m)


def _vented_and_freed(twin: Twin, outcome: AirOutcome) -> None:
    _freed(twin, outcome, vents=True)


def _briefly(twin: Twin, outcome: AirOutcome) -> None:
    """Jam a device and free it while its coil is on; it may never be homed."""
    fault = _jam(twin, outcome.case)
    twin.run_for(BRIEF_MS)
    twin.plant.faults.clear(fault.name)


CONDITIONS: Final[Mapping[str, AirCondition]] = {
    "vented": AirCondition("emergency stop; all chambers are vented", _vented),
    "leaked": AirCondition("emergency stop; all chambers leak to 30 % of the main pressure within 60 s", _leaked),
    "freed": AirCondition("jammed until Held, then freed under pressure", _freed, True, is_remedied=False),
    "vented, freed": AirCondition(
        "jammed until Held, its chambers vented by hand, then freed", _vented_and_freed, True
    ),
    "freed early": AirCondition("jammed for 0.5 s; its coil is still on", _briefly, True, is_remedied=False),
}
"""Conditions by name."""


def _jam(twin: Twin, case: AirCase) -> Fault:
    fault = Fault("jammed", f"{case.side}.{case.drive}", twin.plant.time_ms)
    twin.plant.faults.add(fault)
    return fault


def _device(twin: Twin, case: AirCase) -> Cylinder:
    device: Cylinder = getattr(twin.plant.arms[case.side], case.drive)
    return device


def _devices(twin: Twin, side: Side) -> tuple[Cylinder, Cylinder]:
    arm = twin.plant.arms[side]
    return arm.slide, arm.lift
