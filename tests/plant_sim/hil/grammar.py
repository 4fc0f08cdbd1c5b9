"""Grammar of damages: one line of text changes the wires between any controller and the plant.

    SIGNAL[,SIGNAL...] CHANGE[=AMOUNT] @ WHEN[+OFFSET] [for DURATION]

All times are in ms. A signal is the tag of an input or output; the change applies to each of them.

| change | effect while it acts |
|---|---|
| `on`, `off` | forced, as a logical state |
| `delay=T` | every edge comes T later |
| `chop=T` | an active phase is interrupted: T on, T off |
| `drop=N` | every Nth active phase is suppressed |
| `early=T` | an active phase ends T after its beginning |
| `swap=TAG` | shows the state of another signal of the same kind |

| when | the offset counts from |
|---|---|
| `always` | no offset: acts at all times |
| `power-up` | the first scan |
| `start`, `stop`, `emergency_stop` | each press of the button |
| `rest` | each time from which the controller has no actuator on |
| `cycle` | each time the left arm is sent inward |
| `random` | times drawn from the text, 60 s apart on average |

Without a duration the change acts until the time from which it counts comes again.
"""

from __future__ import annotations

import random
import re
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from controller.common.modbus.io_map import IoMap
from plant_sim.hil.machine_view import INDICATORS
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule

BUTTONS: Final = ("start", "stop", "emergency_stop")
WHENS: Final = ("always", "power-up", *BUTTONS, "rest", "cycle", "random")
FORCED: Final = ("on", "off")
AMOUNTED: Final = ("delay", "chop", "drop", "early")
CYCLE_BEGIN: Final = "left.slide_inward"
RANDOM_MEAN_MS: Final = 60_000
_LINE: Final = re.compile(
    r"(?P<signals>\S+) (?P<change>[a-z]+)(=(?P<amount>\S+))? @ "
    r"(?P<when>[a-z_-]+)(\+(?P<offset>\d+))?( for (?P<for>\d+))?"
)

Levels = dict[str, bool]


@dataclass(frozen=True, slots=True)
class Damage:
    """One damage; `parse` reads it from its text.

    Attributes:
        text: Its text.
        signals: Tags of the changed signals.
        change: Kind of change.
        amount: Time or number of the change; 0 = none.
        other: Tag of the other signal of a swap.
        when: Event from which the offset counts.
        offset_ms: Time from the event to the beginning, ms.
        for_ms: Duration, ms; None = until the next event.
    """

    text: str
    signals: tuple[str, ...]
    change: str
    amount: int
    other: str
    when: str
    offset_ms: int
    for_ms: int | None


def parse(text: str, io_map: IoMap) -> Damage:
    """Read a damage.

    Raises:
        ValueError: The text is not a damage of this I/O map.
    """
    match = _LINE.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r}: not a damage")
    change, amount, when = match["change"], match["amount"] or "", match["when"]
    signals = tuple(match["signals"].split(","))
    kinds = ({point.tag for point in io_map.inputs}, {point.tag for point in io_map.outputs})
    others = (amount,) if change == "swap" else ()
    if not any(kind.issuperset((*signals, *others)) for kind in kinds):
        raise ValueError(f"{text!r}: needs inputs only, or outputs only")
    needs_number = change in AMOUNTED
    if change not in (*FORCED, *AMOUNTED, "swap") or when not in WHENS or needs_number != amount.isdigit():
        raise ValueError(f"{text!r}: unknown change or time, or wrong amount")
    number = int(amount) if needs_number else 0
    return Damage(
        text,
        signals,
        change,
        number,
        "".join(others),
        when,
        int(match["offset"] or 0),
        int(match["for"]) if match["for"] else None,
    )


class _Signal:
    """One signal with the past that its change needs."""

    def __init__(self, damage: Damage) -> None:
        self._change, self._amount = damage.change, damage.amount
        self._was = False
        self._risen_ms = 0
        self._phases = 0
        self._past: deque[tuple[int, bool]] = deque([(0, False)])

    def changed(self, now_ms: int, state: bool, other: bool) -> bool:
        """Note the state and return the changed one."""
        if state and not self._was:
            self._risen_ms, self._phases = now_ms, self._phases + 1
        self._was = state
        if self._change == "delay":
            return self._delayed(now_ms, state)
        since_ms = now_ms - self._risen_ms
        states = {
            "on": True,
            "off": False,
            "swap": other,
            "chop": state and since_ms // max(1, self._amount) % 2 == 0,
            "drop": state and self._phases % max(1, self._amount) != 0,
            "early": state and since_ms < self._amount,
        }
        return states[self._change]

    def _delayed(self, now_ms: int, state: bool) -> bool:
        self._past.append((now_ms + self._amount, state))
        while len(self._past) > 1 and self._past[1][0] <= now_ms:
            self._past.popleft()
        return self._past[0][1]


class Shim:
    """A damage that acts on the states of the wires of one controller.

    Attributes:
        damage: The damage.
        changed_scans: Number of scans in which it changed a state; 0 = it was harmless because it never acted.
    """

    def __init__(self, damage: Damage) -> None:
        self.damage = damage
        self.changed_scans = 0
        self._signals = {tag: _Signal(damage) for tag in damage.signals}
        self._since_ms: int | None = 0 if damage.when in ("always", "power-up") else None
        self._event_was = False
        self._random = random.Random(damage.text)
        self._next_ms = self._drawn_ms(0)

    def inputs(self, now_ms: int, states: Levels) -> None:
        """Change the states of the inputs on their way to the controller."""
        if self.damage.when in BUTTONS:
            self._note(now_ms, event=states[self.damage.when])
        elif self.damage.when == "random" and now_ms >= self._next_ms:
            self._since_ms, self._next_ms = now_ms, self._drawn_ms(now_ms)
        self._change(now_ms, states)

    def outputs(self, now_ms: int, states: Levels) -> None:
        """Change the states of the outputs on their way to the plant."""
        if self.damage.when == "cycle":
            self._note(now_ms, event=states[CYCLE_BEGIN])
        elif self.damage.when == "rest":
            rests = not any(state for tag, state in states.items() if tag not in INDICATORS and tag != "tray_forward")
            self._note(now_ms, event=rests)
            self._since_ms = self._since_ms if rests else None
        self._change(now_ms, states)

    def _change(self, now_ms: int, states: Levels) -> None:
        damage, found = self.damage, dict(states)
        for tag, signal in self._signals.items():
            if tag in found:
                state = signal.changed(now_ms, found[tag], found.get(damage.other, False))
                states[tag] = state if self._acts(now_ms) else found[tag]
        self.changed_scans += states != found

    def _acts(self, now_ms: int) -> bool:
        if self._since_ms is None:
            return False
        after_ms = now_ms - self._since_ms - self.damage.offset_ms
        return after_ms >= 0 and (self.damage.for_ms is None or after_ms < self.damage.for_ms)

    def _note(self, now_ms: int, *, event: bool) -> None:
        if event and not self._event_was:
            self._since_ms = now_ms
        self._event_was = event

    def _drawn_ms(self, now_ms: int) -> int:
        return now_ms + round(self._random.expovariate(1 / RANDOM_MEAN_MS))


class ShimmedLink(InProcessLink):
    """Link whose wires pass through shims in both directions."""

    def __init__(self, module: IoModule, shims: Sequence[Shim]) -> None:
        super().__init__(module)
        self._shims = shims

    def read_inputs(self) -> list[bool]:
        image = super().read_inputs()
        points, now_ms = self.module.io_map.inputs, self.module.plant.time_ms
        states = {point.tag: point.active(image[point.number]) for point in points}
        for shim in self._shims:
            shim.inputs(now_ms, states)
        for point in points:
            image[point.number] = point.level(states[point.tag])
        return image

    def write_outputs(self, image: Sequence[bool]) -> None:
        points, now_ms = self.module.io_map.outputs, self.module.plant.time_ms
        states = {point.tag: point.active(image[point.number]) for point in points}
        for shim in self._shims:
            shim.outputs(now_ms, states)
        levels = list(image)
        for point in points:
            levels[point.number] = point.level(states[point.tag])
        super().write_outputs(levels)


_SLIDES: Final = "left.slide_inward,left.slide_outward,right.slide_inward,right.slide_outward"
NAMED: Final[Mapping[str, str]] = {
    "emergency stop acts for 1.5 s": "emergency_stop early=1500 @ always",
    "starts 5 s after power-up": "start on @ power-up+5000 for 200",
    "starts 45 s after a stop": "start on @ stop+45000 for 200",
    "stop is 80 s late": "stop delay=80000 @ always",
    "serves every second cup": "left.cup_pulse,right.cup_pulse drop=2 @ always",
    "chops the slide valves": f"{_SLIDES} chop=40 @ always",
}
"""Damages that the project met before the rules were written; they are no evidence for the rules."""
