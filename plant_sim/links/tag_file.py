"""Telemetry and operator box as a CSV of Modbus tags, for the operator panel or other clients."""

from __future__ import annotations

from controller.common.document.rendering import csv_text
from plant_sim.links.box import BOX_COILS
from plant_sim.links.telemetry import TELEMETRY
from plant_sim.machine.parameters import Machine, load_machine

COLUMNS = (
    "name",
    "table",
    "address",
    "words",
    "word_order",
    "scale",
    "signed",
    "none",
    "writable",
    "low",
    "high",
    "meaning",
)


def tag_csv(machine: Machine | None = None) -> str:
    """Return the header and one line per tag.

    The column `word_order` is filled for values of two words. If the column `none` contains "yes", all bits set means
    that the value is absent. Below `low` or above `high`, in the unit of the value, it is abnormal.

    Args:
        machine: Parameters of the machine, from which the limits are taken; None = those of the package.
    """
    lowest = _lowest(load_machine() if machine is None else machine)
    rows: list[tuple[object, ...]] = []
    for point in TELEMETRY:
        flags = (_yes(point.signed), _yes(point.may_be_none), _yes(False))
        place = (point.name, "input", point.offset, point.words, point.word_order, f"{point.scale:g}")
        rows.append((*place, *flags, lowest.get(point.name, ""), "", point.meaning))
    flags = (_yes(False), _yes(False), _yes(True))
    rows += [(f"box.{coil.button}", "coil", coil.offset, 1, "", 1, *flags, "", "", coil.meaning) for coil in BOX_COILS]
    return csv_text(COLUMNS, rows)


def _lowest(machine: Machine) -> dict[str, str]:
    """Return the lower limits by tag: where the pressure switch turns off, and what the claws need to work and hold."""
    supply = machine.supply
    limits = {
        "main_pressure_kpa": (supply.pressure_ok_pa - supply.pressure_ok_gap_pa) / 1e3,
        "claw_pressure_kpa": machine.rating.claws_least_pa / 1e3,
        **{f"{side}.clamp_n": machine.claws.holds_above_n for side in ("left", "right")},
    }
    return {name: f"{limit:g}" for name, limit in limits.items()}


def _yes(flag: bool) -> str:
    return "yes" if flag else "no"
