"""Named faults of the machine, with start, end and size."""

from plant_sim.faults.catalogue import FAULTS, fault_table
from plant_sim.faults.fault import Fault, parse_fault, parse_size
from plant_sim.faults.kind import FaultableMachine, FaultError, FaultKind, Size
from plant_sim.faults.schedule import FaultSchedule

__all__ = [
    "FAULTS",
    "Fault",
    "FaultError",
    "FaultKind",
    "FaultSchedule",
    "FaultableMachine",
    "Size",
    "fault_table",
    "parse_fault",
    "parse_size",
]
