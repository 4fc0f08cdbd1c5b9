"""Runs of a machine whose cup counters may be deceived from power-up, with the record of their inputs."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from controller.core.expr import Bit
from plant_sim.devices.cups import HALVED
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.lock_step import Twin

START_M = {"left": 0.0107, "right": 0.0179}
"""Positions of the chains at power-up as the counters report them, m."""


def running(per_min: float, *, halved: bool = False, late_s: float = 0.0, io_map: IoMap | None = None) -> Twin:
    """Return a machine after power-up with flags in their exact positions.

    The chains are placed so that the counters report `START_M`, whether or not they are deceived.

    Args:
        per_min: Planting frequency, cups per minute.
        halved: True if each cup carries two flags of half the length at half the pitch.
        late_s: Delay of the cup counters, s.
        io_map: I/O map; None = the default map.
    """
    values = {"cups.planting_frequency_per_min": per_min, "cups.pulse_jitter": 0.0}
    machine = load_machine().with_values(values)
    twin = Twin(trays=1, io_map=io_map, parameters=machine, set_points={"trays_target": 1})
    twin.plant.seedlings.make_typical()
    for side, arm in twin.plant.arms.items():
        at_m = START_M[side] + late_s * arm.cups.speed_m_s
        if halved:
            arm.cups.set_flag_kinds(HALVED, 1.0)
            at_m = (START_M[side] - machine.cups.sensor_lead_m) / 2
        arm.cups.place(at_m)
        arm.cups.pulse.late_s = late_s
    return twin


def inputs_of(twin: Twin, *, for_ms: int) -> list[tuple[bool, ...]]:
    """Home and start the machine, and return its inputs in every scan."""
    bits = [Bit("X", point.number) for point in twin.io_map.inputs]
    seen: list[tuple[bool, ...]] = []
    twin.watch(lambda twin: seen.append(tuple(bool(twin.plc.read(bit)) for bit in bits)))
    twin.home()
    twin.start()
    twin.run_for(for_ms)
    return seen
