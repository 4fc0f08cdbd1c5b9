"""Named faults: what can break in the machine, from when to when, and how badly."""

from plant_sim.faults.catalogue import FAULTS, fault_table
from plant_sim.faults.fault import Fault, parse_fault, size_of
from plant_sim.faults.kind import Breakable, FaultError, FaultKind, Size
from plant_sim.faults.schedule import FaultSchedule

__all__ = [
    "FAULTS",
    "Breakable",
    "Fault",
    "FaultError",
    "FaultKind",
    "FaultSchedule",
    "Size",
    "fault_table",
    "parse_fault",
    "size_of",
]
