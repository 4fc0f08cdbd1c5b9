"""Recovery of a twin by an operator: clear, repair, answer questions correctly, home and restart."""

from __future__ import annotations

from controller.program.operator.start_warning import warning_ms
from controller.program.states import State
from controller.program.tags import FORGOTTEN, IN_PLACE, SIDES
from plant_sim.crop.seedling import COLUMNS, Location
from plant_sim.devices.pneumatic import Cylinder
from plant_sim.faults import Fault
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.twin.conditions import Quantity
from plant_sim.twin.lock_step import CLEAR_MS, SCAN_MS, NotReachedError, Twin

HOMING_LIMIT_MS = 40_000
AIR_LIMIT_MS = 600_000
"""Maximum wait for air pressure, ms; the compressor fills an empty receiver in less time."""
AIR_SHARE = 0.95
"""Fraction of the regulated pressure at which the air supply counts as restored."""
MANIFOLD = Quantity("air.network.manifold.pressure_pa")
"""Regulated pressure, absolute, Pa."""
MARK_M = 0.005
"""Distance of a tray from its mark up to which the operator calls it in place, m; at 6 mm the fingers miss stems."""
OVERRUN_M = 0.1
"""Distance past the beam up to which the operator moves a tray back, m; beyond it, the tray is conveyed out."""
MOST_PUSHES = 100
"""Number of backward moves of 50 ms within which the operator frees the beam."""
AIR = ("supply", "compressor")
"""Fault targets that affect the air of every cylinder."""


# buttons


def press_emergency_stop(twin: Twin, for_ms: int = 500) -> None:
    """Press and latch the emergency stop, and wait."""
    twin.plant.box.emergency_stop = True
    twin.run_for(for_ms)


def clear(twin: Twin) -> None:
    """Release the emergency stop, press X24 for more than 3 s and release it.

    Raises:
        NotReachedError: The machine stays in Aborted.
    """
    twin.plant.box.emergency_stop = False
    twin.run_for(100)
    twin.press("stop", for_ms=CLEAR_MS)
    twin.run_until_state(State.STOPPED, within_ms=CLEAR_MS + 100)
    twin.run_for(300)


def begin_homing(twin: Twin) -> None:
    """Press X0 in Stopped, Held or Complete, after machine constants have been confirmed if necessary.

    Raises:
        NotReachedError: Homing does not start.
    """
    twin.confirm_constants()  # executes a scan: a button already pressed at power-up is ignored
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50 + warning_ms(twin.machine.tags))


def home_again(twin: Twin) -> set[str]:
    """Home the machine with X0 until it is Idle, answering every question at rest correctly; return the questions.

    Raises:
        NotReachedError: Homing ends in an alarm or does not end.
    """
    asked: set[str] = set()
    twin.scan()  # after a power cycle, the first scan asks
    for _ in range(3):
        asked |= answer_truly(twin)  # the buttons do not home while a question is shown
        begin_homing(twin)
        twin.run_until_state(State.IDLE, State.HELD, within_ms=HOMING_LIMIT_MS)
        if twin.state is State.IDLE:
            return asked
        asked |= answer_truly(twin)
    raise NotReachedError(f"homing does not end in Idle; {twin.situation()}")


# questions


def questions(twin: Twin) -> set[str]:
    """Return the open questions to the operator: 'left loaded', 'right loaded', 'tray'."""
    tags = twin.machine.tags
    asking = {f"{side} loaded": tags.arms[side].ask for side in SIDES} | {"tray": tags.tray.ask}
    return {name for name, bit in asking.items() if twin.plc.read(bit)}


def answer_truly(twin: Twin) -> set[str]:
    """Answer every open question according to the plant's actual state; return the questions.

    A tray that has overrun its mark is first moved back behind the beam manually; the answer is then "none".
    """
    asked = questions(twin)
    if not asked:
        return asked
    for side in SIDES:
        if f"{side} loaded" in asked:
            twin.command(f"{side}_loaded_{'yes' if twin.plant.arms[side].grip.held else 'no'}")
    if "tray" in asked:
        if _tray_in_place(twin) is None:
            _push_back(twin)
        twin.command(f"tray_{true_tray(twin)}")
    twin.run_for(200)
    return asked


def true_tray(twin: Twin) -> str:
    """Return the correct answer to the tray question: full, same or none.

    A part-filled tray counts as full after a loss of memory: the claws then close on its empty rows as well.
    """
    number = _tray_in_place(twin)
    if number is None:
        return "none"
    columns = (twin.plant.seedlings.column(number, column) for column in range(COLUMNS))
    if all(plant.location is Location.STANDING for column in columns for plant in column):
        return "full"
    return {IN_PLACE: "same", FORGOTTEN: "full"}.get(twin.plc.read(twin.machine.tags.tray.phase), "none")


def _push_back(twin: Twin) -> None:
    """Move the trays backward manually until the front edge of none is just past the beam."""
    for _ in range(MOST_PUSHES):
        if not any(0.0 <= front_m < OVERRUN_M for front_m in twin.plant.conveyor.front_m.values()):
            break
        operate_manually(twin, "tray_run", for_ms=50)
    twin.run_for(200)  # the belt stops within this time


def _tray_in_place(twin: Twin) -> int | None:
    """Return the number of the tray from which the arms can pick, or None: it must be in the beam, and at its mark."""
    conveyor = twin.plant.conveyor
    number = conveyor.placed_tray
    in_place = number in conveyor.in_beam and abs(conveyor.offset_m(number)) <= MARK_M
    return number if in_place else None


# manual actions


def operate_manually(twin: Twin, *outputs: str, for_ms: int) -> None:
    """Operate valves by their manual overrides, or the drive manually, while the controller keeps scanning."""
    image = overrides(twin, *outputs)
    for _ in range(for_ms // 50):
        twin.scan()
        twin.plant.step(50 - SCAN_MS, image)
        twin.clock.advance(50 - SCAN_MS)


def overrides(twin: Twin, *outputs: str) -> list[bool]:
    """Return the Y image with only these outputs on."""
    image = twin.io_map.safe_outputs()
    for tag in outputs:
        image[twin.io_map[tag].number] = twin.io_map[tag].level(True)
    return image


def repair(twin: Twin, fault: Fault) -> None:
    """Repair a fault as a maintenance technician would, and wait for the air pressure.

    The chambers of the affected slide or lift are set to their normal pressure at rest, as if it had been stroked
    with its manual overrides; otherwise its next stroke would be uncontrolled. After a failure of the air supply, this
    applies to all slides and lifts.

    Raises:
        FaultError: The fault is unknown.
        NotReachedError: The pressure is not restored.
    """
    twin.plant.faults.clear(fault.name)
    if not twin.plant.box.emergency_stop:
        least_pa = AIR_SHARE * twin.parameters.supply.pressure_pa
        twin.run_until(~(ATMOSPHERE_PA + least_pa > MANIFOLD), within_ms=AIR_LIMIT_MS, what="pressure")
    for device in affected_cylinders(twin, fault):
        device.place(device.position_m)


def affected_cylinders(twin: Twin, fault: Fault) -> list[Cylinder]:
    """Return the slides and lifts whose air a fault affects."""
    arms = twin.plant.arms.items()
    drives: dict[str, Cylinder] = {f"{side}.slide": arm.slide for side, arm in arms}
    drives |= {f"{side}.lift": arm.lift for side, arm in arms}
    if fault.target in AIR:
        return list(drives.values())
    return [device for name, device in drives.items() if f"{fault.target}.".startswith(f"{name}.")]
