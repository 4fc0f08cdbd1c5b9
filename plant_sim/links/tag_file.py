"""Telemetry and operator box as a CSV of Modbus tags, for the operator panel or other clients."""

from __future__ import annotations

import csv
import io

from plant_sim.links.box import BOX_COILS
from plant_sim.links.telemetry import TELEMETRY

COLUMNS = ("name", "table", "address", "words", "scale", "signed", "none", "writable", "meaning")


def tag_csv() -> str:
    """Return the header and one line per tag.

    Values of two words have the high word first. If the column `none` contains "yes", all bits set means that the value
    is absent.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for point in TELEMETRY:
        flags = (_yes(point.signed), _yes(point.may_be_none), _yes(False))
        writer.writerow((point.name, "input", point.offset, point.words, f"{point.scale:g}", *flags, point.meaning))
    for coil in BOX_COILS:
        flags = (_yes(False), _yes(False), _yes(True))
        writer.writerow((f"box.{coil.button}", "coil", coil.offset, 1, 1, *flags, coil.meaning))
    return text.getvalue()


def _yes(flag: bool) -> str:
    return "yes" if flag else "no"
