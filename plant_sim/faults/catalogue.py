"""Every kind of fault, by name."""

from typing import Any

from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS
from plant_sim.devices.cups import DOUBLED, MISSED
from plant_sim.faults import parts
from plant_sim.faults.kind import FaultKind, Size

_CONDUCTANCE = "m3/(s Pa)"
_SHARE_LEFT = Size("-", 0.0, 1.0, "share left", "30 %")
_HOLE = Size(_CONDUCTANCE, 1e-12, 1e-7, "sonic conductance of the hole", "2e-9")
_SEAT = Size(_CONDUCTANCE, 1e-12, 1e-7, "sonic conductance past the seat", "5e-10")
_DELAY = Size("s", 0.001, 10.0, "how much later", "200 ms")
_FLAGS = Size("-", 0.0, 1.0, "share of the flags", "5 %")

_SENSOR = "sensor"
_CYLINDER = "cylinder"
_END = "end of a cylinder"


def _yes(_sound: Any, _size: float) -> Any:
    return True


def _no(_sound: Any, _size: float) -> Any:
    return False


def _as_big(_sound: Any, size: float) -> Any:
    return size


def _more(sound: Any, size: float) -> Any:
    return sound + size


def _part(sound: Any, size: float) -> Any:
    return sound * size


def _cells(_sound: Any, size: float) -> Any:
    return round(size)


def _missed(_sound: Any, size: float) -> Any:
    return MISSED, size


def _doubled(_sound: Any, size: float) -> Any:
    return DOUBLED, size


_KINDS = (
    # --- sensors and wires
    FaultKind("stuck_on", _SENSOR, "it says on, whatever it sees", parts.sensors, ("stuck",), _yes, "left.lift_up"),
    FaultKind("stuck_off", _SENSOR, "it says off, whatever it sees", parts.sensors, ("stuck",), _no, "left.lift_up"),
    FaultKind(
        "late_sensor", _SENSOR, "it tells every edge later; what lasts no longer than the delay is not told at all",
        parts.moved_sensors, ("late_s",), _as_big, "left.slide_at_feed", _DELAY,
    ),
    FaultKind(
        "broken_wire", "wired input", "the terminal is off: a normally closed contact reads as active",
        parts.wires, ("broken",), _yes, "stop",
    ),
    FaultKind(
        "missed_pulses", "cup counter", "some flags are not seen", parts.flags, ("kinds",), _missed,
        "left.cup_pulse", _FLAGS,
    ),
    FaultKind(
        "doubled_pulses", "cup counter", "some flags are seen twice", parts.flags, ("kinds",), _doubled,
        "left.cup_pulse", _FLAGS,
    ),
    # --- valves and air
    FaultKind(
        "stuck_valve", _CYLINDER, "the spool of its valve stays where it is", parts.cylinders, ("valve.stuck",), _yes,
        "left.claws",
    ),
    FaultKind(
        "slow_valve", _CYLINDER, "its valve switches later, on and off", parts.cylinders,
        ("valve.on_delay_s", "valve.off_delay_s"), _more, "right.lift", _DELAY,
    ),
    FaultKind(
        "leak", "chamber", "air leaks from the chamber, or from the manifold, to the outside",
        parts.leaky, ("leak_m3_s_pa",), _as_big, "left.slide.plus", _HOLE,
    ),
    FaultKind(
        "closed_throttle", _END, "its throttle is turned in: less air leaves this end", parts.chambers,
        ("throttle_m3_s_pa",), _part, "left.slide.minus", _SHARE_LEFT,
    ),
    FaultKind(
        "leaking_check_valve", "check valve", "closed, it lets air out of the end it should hold", parts.check_valves,
        ("slip_m3_s_pa",), _as_big, "left.lift.minus", _SEAT,
    ),
    FaultKind(
        "low_supply", "regulator", "it is set to another pressure", parts.regulator, ("regulated_pa",), _as_big,
        "supply", Size("Pa", 0.0, 1e6, "gauge pressure", "0.35 MPa"),
    ),
    FaultKind(
        "low_claw_supply", "regulator", "that of the claws is set to another pressure", parts.regulator,
        ("claw_regulated_pa",), _as_big, "supply", Size("Pa", 0.0, 1e6, "gauge pressure", "0.15 MPa"),
    ),
    FaultKind(
        "failing_supply", "compressor", "it delivers less; the pressure falls as air is used", parts.compressor,
        ("compressor_kg_s",), _part, "compressor", Size("-", 0.0, 1.0, "share left", "0 %"),
    ),
    # --- what moves
    FaultKind("jammed", "moving part", "it stands dead; its drive goes on", parts.movers, ("blocked",), _yes,
              "left.slide"),
    FaultKind(
        "dropping_arm", "lift", "both its check valves leak: with its coils off the arm sinks", parts.lifts,
        ("plus.slip_m3_s_pa", "minus.slip_m3_s_pa"), _as_big, "left.lift", _SEAT,
    ),
    FaultKind(
        "decoupled_magnet", "slide", "its magnets let go at less force; the piston leaves the carriage behind",
        parts.slides, ("magnet_holds_n",), _as_big, "left.slide", Size("N", 0.1, 1e5, "force", "20 N"),
    ),
    FaultKind(
        "slipping_belt", "spreader", "its belt slips at less force", parts.spreaders, ("slips_n",), _as_big,
        "left.spreader", Size("N", 0.1, 5000.0, "force", "15 N"),
    ),
    FaultKind(
        "stalled_stepper", "conveyor", "its motor has less torque and loses steps", parts.stepper,
        ("holds_n",), _part,
        "conveyor", Size("-", 0.0, 1.0, "share of the torque left", "10 %"),
    ),
    # --- trays and seedlings
    FaultKind(
        "skewed_tray", "magazine", "trays set down meanwhile lie askew: the corner at the beam leads",
        parts.magazine, ("skew_m",), _as_big, "magazine", Size("m", -0.05, 0.05, "lead of the corner", "8 mm"),
    ),
    FaultKind("missing_tray", "magazine", "it sets no tray down", parts.magazine, ("withheld",), _yes, "magazine"),
    FaultKind(
        "missing_cells", "tray", "cells without a seedling from the start, drawn at random", parts.trays,
        ("empty_cells",), _cells, "tray_1", Size("cells", 1.0, float(COLUMNS * CELLS_ALONG), "how many", "10 %"),
        lasts=True,
    ),
)  # fmt: skip

#: Every kind of fault, by name.
FAULTS: dict[str, FaultKind] = {kind.name: kind for kind in _KINDS}


def fault_table() -> list[tuple[str, ...]]:
    """Return every kind of fault for a reference page, the heading first."""
    heading = ("fault", "strikes", "effect", "size", "example")
    return [heading, *(_row(kind) for kind in FAULTS.values())]


def _row(kind: FaultKind) -> tuple[str, ...]:
    """One kind for a reference page."""
    example = f"{kind.name}:{kind.example}"
    size = "-"
    if kind.size is not None:
        size = f"{kind.size.meaning}, {kind.size.range}"
        example += f"={kind.size.example.replace(' ', '')}"
    times = "" if kind.lasts else "@12s..20s"
    return f"`{kind.name}`", kind.target, kind.effect, size, f"`{example}{times}`"
