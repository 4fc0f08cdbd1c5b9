"""Catalogue of fault kinds by name."""

from typing import Any

from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS
from plant_sim.devices.cups import DOUBLED, HALVED, MISSED
from plant_sim.faults import parts
from plant_sim.faults.kind import FaultKind, Size

_CONDUCTANCE = "m3/(s Pa)"
_SHARE_LEFT = Size("-", 0.0, 1.0, "remaining share", "30 %")
_HOLE = Size(_CONDUCTANCE, 1e-16, 1e-7, "sonic conductance of the hole", "2e-9")
_SEAT = Size(_CONDUCTANCE, 1e-12, 1e-7, "sonic conductance past the seat", "5e-10")
_DELAY = Size("s", 0.001, 10.0, "additional delay", "200 ms")
_FLAGS = Size("-", 0.0, 1.0, "share of the flags", "5 %")

_SENSOR = "sensor"
_CYLINDER = "cylinder"
_END = "end of a cylinder"


def _true(_sound: Any, _size: float) -> Any:
    return True


def _false(_sound: Any, _size: float) -> Any:
    return False


def _set_to_size(_sound: Any, size: float) -> Any:
    return size


def _add_size(original: Any, size: float) -> Any:
    return original + size


def _scale(original: Any, size: float) -> Any:
    return original * size


def _round_size(_sound: Any, size: float) -> Any:
    return round(size)


def _flags_missed(_sound: Any, size: float) -> Any:
    return MISSED, size


def _flags_halved(_sound: Any, size: float) -> Any:
    return HALVED, size


def _flags_doubled(_sound: Any, size: float) -> Any:
    return DOUBLED, size


_KINDS = (
    # --- sensors and wires
    FaultKind("stuck_on", _SENSOR, "its output is always on", parts.sensors, ("stuck",), _true, "left.lift_up"),
    FaultKind("stuck_off", _SENSOR, "its output is always off", parts.sensors, ("stuck",), _false, "left.lift_up"),
    FaultKind(
        "late_sensor",
        _SENSOR,
        "it delays every edge; a pulse no longer than the delay is suppressed",
        parts.delayable_sensors,
        ("late_s",),
        _set_to_size,
        "left.slide_at_feed",
        _DELAY,
    ),
    FaultKind(
        "broken_wire",
        "wired input",
        "the terminal is off: a normally closed contact reads as active",
        parts.wires,
        ("broken",),
        _true,
        "stop",
    ),
    FaultKind(
        "missed_pulses",
        "cup counter",
        "some flags are not counted",
        parts.flags,
        ("kinds",),
        _flags_missed,
        "left.cup_pulse",
        _FLAGS,
    ),
    FaultKind(
        "doubled_pulses",
        "cup counter",
        "some flags are counted twice",
        parts.flags,
        ("kinds",),
        _flags_doubled,
        "left.cup_pulse",
        _FLAGS,
    ),
    FaultKind(
        "halved_flags",
        "cup counter",
        "some flags are replaced by two of half the length and distance, like the flags of a chain of twice the speed",
        parts.flags,
        ("kinds",),
        _flags_halved,
        "left.cup_pulse",
        _FLAGS,
    ),
    FaultKind(
        "wrong_readings",
        "yield sensor",
        "it reads some cups, stems, or strokes of the claws as their opposite",
        parts.yield_sensors,
        ("wrong",),
        _set_to_size,
        "left.cup_filled",
        Size("-", 0.0, 1.0, "share of the readings", "5 %"),
    ),
    # --- valves and air
    FaultKind(
        "stuck_valve",
        _CYLINDER,
        "the spool of its valve does not move",
        parts.cylinders,
        ("valve.stuck",),
        _true,
        "left.claws",
    ),
    FaultKind(
        "slow_valve",
        _CYLINDER,
        "its valve switches on and off later",
        parts.cylinders,
        ("valve.on_delay_s", "valve.off_delay_s"),
        _add_size,
        "right.lift",
        _DELAY,
    ),
    FaultKind(
        "leak",
        "chamber",
        "air leaks from the chamber, or from the manifold, to the atmosphere",
        parts.pressurised_parts,
        ("leak_m3_s_pa",),
        _set_to_size,
        "left.slide.plus",
        _HOLE,
    ),
    FaultKind(
        "closed_throttle",
        _END,
        "its throttle is closed further: less air leaves this end",
        parts.chambers,
        ("throttle_m3_s_pa",),
        _scale,
        "left.slide.minus",
        _SHARE_LEFT,
    ),
    FaultKind(
        "leaking_check_valve",
        "check valve",
        "it leaks when closed: air leaves this end",
        parts.check_valves,
        ("slip_m3_s_pa",),
        _set_to_size,
        "left.lift.minus",
        _SEAT,
    ),
    FaultKind(
        "low_supply",
        "regulator",
        "its set pressure changes",
        parts.regulator,
        ("regulated_pa",),
        _set_to_size,
        "supply",
        Size("Pa", 0.0, 1e6, "gauge pressure", "0.35 MPa"),
    ),
    FaultKind(
        "low_claw_supply",
        "regulator",
        "the set pressure of the claw regulator changes",
        parts.regulator,
        ("claw_regulated_pa",),
        _set_to_size,
        "supply",
        Size("Pa", 0.0, 1e6, "gauge pressure", "0.15 MPa"),
    ),
    FaultKind(
        "failing_supply",
        "compressor",
        "it delivers less; the pressure falls with consumption",
        parts.compressor,
        ("compressor_kg_s",),
        _scale,
        "compressor",
        Size("-", 0.0, 1.0, "remaining share", "0 %"),
    ),
    # --- moving parts
    FaultKind(
        "jammed",
        "moving part",
        "it is locked in place; its drive keeps operating",
        parts.moving_parts,
        ("blocked",),
        _true,
        "left.slide",
    ),
    FaultKind(
        "dropping_arm",
        "lift",
        "both its check valves leak: the arm sinks while both coils are off",
        parts.lifts,
        ("plus.slip_m3_s_pa", "minus.slip_m3_s_pa"),
        _set_to_size,
        "left.lift",
        _SEAT,
    ),
    FaultKind(
        "decoupled_magnet",
        "slide",
        "its magnets decouple at a lower force; the piston moves without the carriage",
        parts.slides,
        ("magnet_holds_n",),
        _set_to_size,
        "left.slide",
        Size("N", 0.1, 1e5, "force", "20 N"),
    ),
    FaultKind(
        "slipping_belt",
        "spreader",
        "its belt slips at a lower force",
        parts.spreaders,
        ("slips_n",),
        _set_to_size,
        "left.spreader",
        Size("N", 0.1, 5000.0, "force", "15 N"),
    ),
    FaultKind(
        "stalled_stepper",
        "conveyor",
        "its motor has less torque and loses steps",
        parts.stepper,
        ("holds_n",),
        _scale,
        "conveyor",
        Size("-", 0.0, 1.0, "remaining share of the torque", "10 %"),
    ),
    # --- trays and seedlings
    FaultKind(
        "skewed_tray",
        "magazine",
        "trays placed during the fault are skewed: the corner at the beam leads",
        parts.magazine,
        ("skew_m",),
        _set_to_size,
        "magazine",
        Size("m", -0.05, 0.05, "lead of the corner", "8 mm"),
    ),
    FaultKind("missing_tray", "magazine", "it does not place trays", parts.magazine, ("withheld",), _true, "magazine"),
    FaultKind(
        "missing_cells",
        "tray",
        "random cells are empty from the start",
        parts.trays,
        ("empty_cells",),
        _round_size,
        "tray_1",
        Size("cells", 1.0, float(COLUMNS * CELLS_ALONG), "number of cells", "10 %"),
        permanent=True,
    ),
)

FAULTS: dict[str, FaultKind] = {kind.name: kind for kind in _KINDS}
"""Fault kinds by name."""


def fault_table() -> list[tuple[str, ...]]:
    """Return all fault kinds as a table for the reference documentation, header row first."""
    heading = ("fault", "target", "effect", "size", "example")
    return [heading, *(_row(kind) for kind in FAULTS.values())]


def _row(kind: FaultKind) -> tuple[str, ...]:
    """Return the table row of one fault kind."""
    example = f"{kind.name}:{kind.example}"
    size = "-"
    if kind.size is not None:
        size = f"{kind.size.meaning}, {kind.size.range}"
        example += f"={kind.size.example.replace(' ', '')}"
    times = "" if kind.permanent else "@12s..20s"
    return f"`{kind.name}`", kind.target, kind.effect, size, f"`{example}{times}`"
