"""An operator at a twin: clears, mends, answers what is asked by what is so, homes and starts again."""

from __future__ import annotations

from controller.program.states import State
from controller.program.tags import IN_PLACE, SIDES
from plant_sim.bench.twin import SCAN_MS, NotReachedError, Twin
from plant_sim.crop.seedling import COLUMNS, Place
from plant_sim.devices.pneumatic import Cylinder
from plant_sim.faults import Fault

CLEAR_MS = 3_200
"""X24 is to be held for 3 s."""
HOMING_LIMIT_MS = 40_000
AIR_LIMIT_MS = 600_000
"""Longest wait for the air: the compressor fills an empty receiver in less."""
AIR_SHARE = 0.95
"""From this share of the regulated pressure on the air counts as restored."""
AIR = ("supply", "compressor")
"""What every cylinder has its air from."""


# buttons


def press_emergency_stop(twin: Twin, for_ms: int = 500) -> None:
    """Press and latch the emergency stop, and wait."""
    twin.plant.box.emergency_stop = True
    twin.run_for(for_ms)


def clear(twin: Twin) -> None:
    """Release the emergency stop and hold X24 for more than 3 s.

    Raises:
        NotReachedError: the machine stays in Aborted.
    """
    twin.plant.box.emergency_stop = False
    twin.run_for(100)
    twin.press("stop", for_ms=CLEAR_MS)
    twin.run_until_state(State.STOPPED, within_ms=CLEAR_MS)
    twin.run_for(300)


def begin_homing(twin: Twin) -> None:
    """Press X0 in Stopped, Held or Complete.

    Raises:
        NotReachedError: the machine does not begin.
    """
    twin.scan()  # a button held while the power comes would count for nothing
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50)


def home_again(twin: Twin) -> set[str]:
    """Home with X0 until Idle, answering truly whatever is asked in Held; return all that was asked.

    Raises:
        NotReachedError: homing ends in an alarm, or not at all.
    """
    asked: set[str] = set()
    for _ in range(2):
        begin_homing(twin)
        twin.run_until(lambda: twin.state in {State.IDLE, State.HELD}, within_ms=HOMING_LIMIT_MS, what="Idle or Held")
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
    """Answer every open question by what is so; return the questions.

    A tray that stands wrong is first drawn back behind the beam by hand, and there is none then.
    """
    asked = questions(twin)
    for side in SIDES:
        if f"{side} loaded" in asked:
            twin.command(f"{side}_loaded_{'yes' if twin.plant.arms[side].grip.held else 'no'}")
    if "tray" in asked:
        if twin.plant.conveyor.beam.read() and twin.plant.conveyor.placed_tray is None:
            by_hand(twin, "tray_run", for_ms=400)
            twin.run_for(200)  # until it has come to rest
        twin.command(f"tray_{true_tray(twin)}")
    twin.run_for(200)
    return asked


def true_tray(twin: Twin) -> str:
    """Return which tray stands at the pick position, as the answer to the question: full, same or none."""
    number = twin.plant.conveyor.placed_tray
    if number is None:
        return "none"
    columns = (twin.plant.seedlings.column(number, column) for column in range(COLUMNS))
    if all(plant.place is Place.STANDING for column in columns for plant in column):
        return "full"
    return "same" if twin.plc.read(twin.machine.tags.tray.phase) == IN_PLACE else "none"


# hands


def by_hand(twin: Twin, *outputs: str, for_ms: int) -> None:
    """Work valves by their hand overrides, or the drive by hand, while the controller goes on scanning."""
    image = overrides(twin, *outputs)
    for _ in range(for_ms // 50):
        twin.scan()
        twin.plant.step(50 - SCAN_MS, image)
        twin.clock.advance(50 - SCAN_MS)


def overrides(twin: Twin, *outputs: str) -> list[bool]:
    """Return the Y image in which only these are on."""
    image = twin.io_map.safe_outputs()
    for tag in outputs:
        image[twin.io_map[tag].number] = twin.io_map[tag].level(True)
    return image


def mend(twin: Twin, fault: Fault) -> None:
    """Mend a fault as a fitter must, and wait for the air.

    Slide or lift that it has struck, or all of them where the air itself had failed, are stroked by their hand
    overrides until their chambers hold the air that they hold at rest, or the next stroke would be a leap.

    Raises:
        FaultError: there is no such fault.
        NotReachedError: the pressure does not come back.
    """
    twin.plant.faults.mend(fault.name)
    if not twin.plant.box.emergency_stop:
        least_pa = AIR_SHARE * twin.parameters.supply.pressure_pa
        twin.run_until(lambda: twin.plant.supply.pressure_pa >= least_pa, within_ms=AIR_LIMIT_MS, what="pressure")
    for device in struck_cylinders(twin, fault):
        device.place(device.position_m)


def struck_cylinders(twin: Twin, fault: Fault) -> list[Cylinder]:
    """Return the slides and lifts whose air a fault has changed."""
    arms = twin.plant.arms.items()
    drives: dict[str, Cylinder] = {f"{side}.slide": arm.slide for side, arm in arms}
    drives |= {f"{side}.lift": arm.lift for side, arm in arms}
    if fault.target in AIR:
        return list(drives.values())
    return [device for name, device in drives.items() if f"{fault.target}.".startswith(f"{name}.")]
