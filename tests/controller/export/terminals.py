"""Operator who knows the terminals of a package only: the push buttons, the amber lamp, and the machine that moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from controller.core.expr import Word
from controller.export.runtime_parts.part import SCAN_MS
from plant_sim.links.io_module import IoModule
from tests.controller.export.package_rig import MOVERS

LAMP: Final = "lamp_amber"
PAUSE_MS: Final = 1_750
"""Shortest pause between two groups of flashes, ms."""
REST_MS: Final = 5_000
"""Time without motion after which the machine stands still, ms."""
WATCH_MS: Final = 8_000
"""Time for which the lamp is watched at first, ms; questions are repeated every 7 s."""
BLINKS: Final = -1
"""Lamp that blinks without pauses."""


class Rig(Protocol):
    """PLC with an exported program at the terminals of the plant."""

    module: IoModule

    def read(self, word: Word) -> int: ...

    def write(self, word: Word, value: int) -> None: ...

    def set_relay(self, place: str) -> None: ...

    def scan(self) -> list[bool]: ...

    def power_cycle(self, *, memory_lost: bool = False) -> None: ...


class Terminals:
    """Operator at the terminals of a machine.

    Attributes:
        rig: PLC on the plant.
        rises_ms: Times at which the amber lamp was switched on, ms.
        moved_ms: Time of the last scan with an output that moves the machine, ms.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.rises_ms: list[int] = []
        self.now_ms = self.moved_ms = 0
        self._lit = False

    def run(self, for_ms: int, until: Callable[[], bool] = lambda: False) -> bool:
        """Run scans; return whether a condition became true, which ends them."""
        for _ in range(for_ms // SCAN_MS):
            image = self.rig.scan()
            self.now_ms += SCAN_MS
            if any(image[number] for number in MOVERS):
                self.moved_ms = self.now_ms
            lit = self.rig.module.plant.indicators[LAMP]
            if lit and not self._lit:
                self.rises_ms.append(self.now_ms)
            self._lit = lit
            if until():
                return True
        return False

    def press(self, button: str, for_ms: int) -> None:
        """Press a button of the box and release it."""
        setattr(self.rig.module.plant.box, button, True)
        self.run(for_ms)
        setattr(self.rig.module.plant.box, button, False)
        self.run(50)

    def set_relay(self, relay: str, place: str) -> None:
        """Set a command relay at its place for a client, or by its number with a tool."""
        self.rig.set_relay(relay if place == "device test of GX Works2" else place)
        self.run(50)

    def switch_off(self, for_ms: int, *, memory_lost: bool = False) -> None:
        """Switch the PLC off and on again; its outputs are off meanwhile, and the plant goes on."""
        module = self.rig.module
        for _ in range(for_ms // SCAN_MS):
            module.write_outputs(0, module.io_map.safe_outputs())
            module.advance(SCAN_MS)
        self.now_ms += for_ms
        self.rig.power_cycle(memory_lost=memory_lost)

    def truth(self, question: int) -> str:
        """Return the true answer to a question about what the operator sees: loaded claws, the tray, empty cups."""
        arms = self.rig.module.plant.arms
        return "yes" if question > len(arms) or list(arms.values())[question - 1].grip.held else "no"

    def rests(self, within_ms: int, for_ms: int = REST_MS) -> bool:
        """Run scans; return whether the machine stands still for a time."""
        begin_ms = self.now_ms
        return self.run(within_ms, lambda: self.now_ms - max(begin_ms, self.moved_ms) >= for_ms)

    def takes(self, within_ms: int) -> bool:
        """Run scans; return whether an arm takes seedlings from the tray."""
        standing = self.rig.module.plant.counts().in_tray
        return self.run(within_ms, lambda: self.rig.module.plant.counts().in_tray < standing)

    def flashes(self) -> int:
        """Watch the lamp; return the number of flashes in a group, 0 if it is off, or `BLINKS`."""
        self.rises_ms.clear()
        if not self.run(WATCH_MS, lambda: bool(self.rises_ms)):
            return 0
        self.run(2 * WATCH_MS)
        groups: list[list[int]] = []
        for at_ms in self.rises_ms:
            if not groups or at_ms - groups[-1][-1] > PAUSE_MS:
                groups.append([])
            groups[-1].append(at_ms)
        if len(groups) == 1:
            return BLINKS
        return max(map(len, groups))
