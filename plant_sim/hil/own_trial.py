"""Trial of the machine's own program on the bench, with which other controllers are compared."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from plant_sim.hil.bench import Bench, ControllerSupply
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import BenchRun
from plant_sim.hil.own_program import drive
from plant_sim.hil.reference import TrialQuantities
from plant_sim.hil.selection import FIRST_GROUPS
from plant_sim.links.in_process import InProcessLink
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import set_points_of


class OwnTrialError(Exception):
    """The machine's own program does not complete the trial; the message is one line."""


def measure(plant: Plant, io_map: IoMap, machine: Machine) -> TrialQuantities:
    """Run the first cases with the machine's own program until the end of the trial.

    Args:
        plant: New plant, equal to that of the controller to be judged.
        io_map: I/O map.
        machine: Parameters of the plant.

    Raises:
        OwnTrialError: The trial is not completed.
    """
    module = BenchModule(plant, io_map)
    bench = Bench(module, machine)
    run = BenchRun(bench, groups=FIRST_GROUPS)
    ended: list[bool] = []
    bench.play(run.procedure(), ended=lambda: ended.append(True))
    drive(
        InProcessLink(module),
        ControllerSupply(),
        until=lambda: bool(ended) or bench.trial is not None,
        set_points=set_points_of(machine),
    )
    if bench.trial is None:
        raise OwnTrialError("the machine's own program does not complete this trial")
    return bench.trial
