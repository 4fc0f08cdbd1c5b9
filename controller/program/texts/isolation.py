"""Isolation of the machine before a hand enters it, in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.program.texts.operator import Text

_BEGINNING: Final = Text("Isolate first", "先断电断气并上锁")
ISOLATE_FIRST: Final = Text(f"{_BEGINNING.en}.", f"{_BEGINNING.zh}。")
"""First sentence of a text that sends a hand into the machine."""

ISOLATION: Final = (
    Text(
        "Press the emergency stop. Stopped, Held and Suspended are not sufficient.",
        "按下急停。停止、保持和暂挂均不足以保证安全。",
    ),
    Text("Disconnect power and air, and lock both.", "切断电源和气源，并分别上锁。"),
    Text(
        "Vent the cylinders and the claw reservoir; secure raised lifts mechanically.",
        "排空各气缸和夹爪储气罐；用机械方式固定已升起的臂。",
    ),
    Text("Stop the tractor, so that the ground wheel does not drive the cups.", "停下拖拉机，使地轮不带动苗杯。"),
)
"""Steps of the isolation, in order; docs/safety.md contains the same steps."""


def begins_with_isolation(text: Text) -> bool:
    """Return True if a text begins with the isolation in both languages, alone or for a work that it names."""
    return all(words.startswith(beginning) for words, beginning in zip(text, _BEGINNING, strict=True))
