"""Machine of a recorded run as a picture: positions from the plant, and its crop if the program is another one."""

from __future__ import annotations

from typing import Any

from controller.debug.machine import RecordedMachine
from controller.hmi.panel.web.run_picture import PanelPicture
from plant_sim.crop.seedling import CELLS_ALONG, PICK_ORDER, Location
from plant_sim.links.io_module import IoModule
from plant_sim.links.telemetry import TELEMETRY
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.debug.machine import TwinMachine
from plant_sim.twin.ladder.recording import LadderMachine

_NO_TRAY, _IN_PLACE = 0, 1
_TAKEN, _FULL, _IN_PROGRESS = 0, 1, 2


def picture_of(recorded: RecordedMachine) -> PanelPicture | None:
    """Return the picture of a recorded machine; None without a plant. Another program has the crop of the plant."""
    if isinstance(recorded, TwinMachine):
        twin = recorded.twin
        return PanelPicture(twin.machine, lambda: recorded.memory, lambda: _telemetry(twin.module))
    if not isinstance(recorded, LadderMachine):
        return None
    module = recorded.module
    return PanelPicture(
        program_of(module.io_map), lambda: recorded.memory, lambda: _telemetry(module), lambda: crop_of(module)
    )


def _telemetry(module: IoModule) -> dict[str, float | None]:
    return {point.name: point.read(module) for point in TELEMETRY}


def crop_of(module: IoModule) -> dict[str, Any]:
    """Return trays, rows and claws as they are in the plant, in the form of the panel's view."""
    plant = module.plant
    placed = plant.conveyor.placed_tray
    run, forward = (_is_on(module, tag) for tag in ("tray_run", "tray_forward"))
    return {
        "tray": {"phase": _NO_TRAY if placed is None else _IN_PLACE, "running": run, "forward": forward},
        "arms": {
            side: {
                "rows": {str(row): _row(plant, placed, column) for row, column in enumerate(columns, start=1)},
                "row": 1,
                "loaded": bool(arm.grip.held),
                "cup_count": 0,
                "claws_closed": arm.claws.gripping,
                "step": None,
            }
            for (side, arm), columns in zip(plant.arms.items(), (PICK_ORDER[::2], PICK_ORDER[1::2]), strict=True)
        },
    }


def _row(plant: Plant, tray: int | None, column: int) -> int:
    """Return the state of a row of cells: taken, full, or in progress."""
    if tray is None:
        return _TAKEN
    standing = sum(seedling.location is Location.STANDING for seedling in plant.seedlings.column(tray, column))
    return _TAKEN if standing == 0 else _FULL if standing == CELLS_ALONG else _IN_PROGRESS


def _is_on(module: IoModule, tag: str) -> bool:
    point = module.io_map[tag]
    return point.active(module.outputs[point.number])
