"""Damages that are drawn by seed from the grammar."""

from __future__ import annotations

import random
from typing import Final

from controller.common.modbus.io_map import IoMap
from plant_sim.hil.machine_view import INDICATORS
from tests.plant_sim.hil.grammar import BUTTONS, WHENS, Damage, parse

AMOUNTS: Final = {
    "delay": (50, 200, 1_000, 5_000, 30_000),
    "chop": (20, 40, 100, 500),
    "drop": (2, 3, 5),
    "early": (20, 100, 500, 2_000),
}
CHANGES: Final = ("on", "off", *AMOUNTS, "swap")
OFFSETS_MS: Final = (0, 500, 5_000, 30_000, 50_000)
DURATIONS_MS: Final = (50, 200, 1_000, 5_000, 30_000, None)


BRIEF_MS: Final = 200
"""Duration up to which a signal is rarely active while a damage that only interrupts it acts, ms."""
LIKELY_FROM: Final = 2_000
"""First seed of which damages that would rarely act are drawn again: four of the first ten from 1000 never acted."""


def draw(seed: int, io_map: IoMap) -> str:
    """Return the text of the damage of a seed: a button, an input or an output with equal chances."""
    chance = random.Random(seed)
    text = _drawn(chance, io_map)
    while seed >= LIKELY_FROM and _rarely_acts(parse(text, io_map)):
        text = _drawn(chance, io_map)
    return text


def _rarely_acts(damage: Damage) -> bool:
    """Return True for a damage that interrupts a signal briefly, or after power-up, when most signals are inactive."""
    if damage.for_ms is None or damage.change in ("on", "swap"):
        return False
    return damage.for_ms <= BRIEF_MS or damage.when == "power-up"


def _drawn(chance: random.Random, io_map: IoMap) -> str:
    inputs = [point.tag for point in io_map.inputs]
    outputs = [point.tag for point in io_map.outputs if point.tag not in INDICATORS]
    kind = chance.choice((BUTTONS, [tag for tag in inputs if tag not in BUTTONS], outputs))
    signal = chance.choice(kind)
    change = chance.choice(CHANGES)
    if change in AMOUNTS:
        amount = f"={chance.choice(AMOUNTS[change])}"
    elif change == "swap":
        others = [tag for tag in (outputs if kind is outputs else inputs) if tag != signal]
        amount = f"={chance.choice(others)}"
    else:
        amount = ""
    when = chance.choice(WHENS)
    if when == "always":
        return f"{signal} {change}{amount} @ always"
    duration_ms = chance.choice(DURATIONS_MS)
    for_how_long = "" if duration_ms is None else f" for {duration_ms}"
    return f"{signal} {change}{amount} @ {when}+{chance.choice(OFFSETS_MS)}{for_how_long}"
