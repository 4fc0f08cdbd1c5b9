"""Labels of axes: the symbol or parameter of a response or factor in words, with its unit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

WORDS: Final[Mapping[str, str]] = {
    "S": "success rate S",
    "F_p": "pick failures F_p",
    "F_d": "carry failures F_d",
    "F_t": "throw failures F_t",
    "P": "lost at picking P",
    "D": "lost while carried D",
    "T": "lost at the throw T",
    "Y1": "lodging Y1",
    "Y2": "injury Y2",
    "in_cups": "seedlings in cups",
    "air_l_min": "air consumption",
    "air_l": "air consumption",
    "simulated_s": "simulated time",
    "speed": "machine speed",
    "frequency": "planting frequency",
}
"""Name of a response or factor in words, by its symbol."""
_UNIT_SUFFIX: Final = re.compile(r"(_(m3|m2|m|mm|s|ms|min|h|d|kg|n|nm|nmm|pa|mpa|v|a|k|deg|per|ohm|share|l|sd))+$")


def axis_label(label: str) -> str:
    """Return the label of an axis for the name and unit of a response or factor.

    >>> axis_label("S, %"), axis_label("crop.foam_thickness_mm, mm"), axis_label("missed_cups, cups per trial")
    ('success rate S, %', 'foam thickness, mm', 'missed cups, cups per trial')
    """
    name, comma, unit = label.partition(", ")
    if name in WORDS:
        return f"{WORDS[name]}{comma}{unit}"
    last = name.rpartition(".")[2]
    if comma or name != last:
        last = _UNIT_SUFFIX.sub("", last)
    return f"{last.replace('_', ' ')}{comma}{unit}"
