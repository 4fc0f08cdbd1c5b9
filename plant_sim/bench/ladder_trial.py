"""A trial with anybody's FX program in the controller's place: the plant, its buttons, and no other knowledge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final

from controller.fx.instruction import Device, Ladder, LadderError
from controller.fx.plc import FxPlc
from controller.fx.reading import load_ladder
from controller.io_map import IoMap
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.links.io_module import IoModule
from plant_sim.parameters import Machine
from plant_sim.plant import Plant

__all__ = ["LadderError", "LadderReport", "load_ladder", "run_ladder_trial"]

SCAN_MS: Final = 10
PRESS_MS: Final = 200
PATIENCE_MS: Final = 20_000
"""Nothing has moved for so long: the operator presses the start button, or there is nothing left to do. Twelve cups at
45 a minute take 16 s."""
MOST_PRESSES: Final = 10
TRAY_LIMIT_MS: Final = 600_000
INDICATORS: Final = ("horn", "lamp_red", "lamp_amber", "lamp_green")


@dataclass(frozen=True, slots=True)
class LadderReport:
    """What a program has done.

    Attributes:
        counts: Where the seedlings are.
        presses: How often the start button was pressed.
        incidents: What went wrong in the plant, one line each.
        simulated_s: How long it took, s.
        error: What has stopped the CPU; empty = nothing.
    """

    counts: SeedlingCounts
    presses: int
    incidents: tuple[str, ...]
    simulated_s: float
    error: str

    @property
    def completed(self) -> bool:
        """Whether every seedling has left tray and claws, and nothing went wrong."""
        return not (self.counts.in_tray or self.counts.in_claw or self.incidents or self.error)

    def record(self) -> dict[str, object]:
        """Return the report as a flat record."""
        counts = asdict(self.counts)
        return {"completed": self.completed, **counts, "presses": self.presses, "incidents": list(self.incidents),
                "simulated_s": self.simulated_s, "error": self.error}  # fmt: skip

    def text(self) -> str:
        """Return the report in a few lines."""
        c = self.counts
        lines = [
            f"{c.total} seedlings: {c.in_cups} in cups, {c.P} not picked, {c.D} lost on the way, {c.T} beside their "
            f"cups, {c.in_tray} left in trays, {c.in_claw} in claws",
            f"{self.simulated_s:.1f} s simulated, start pressed {self.presses} times",
            *self.incidents,
        ]
        return "\n".join([*lines, self.error] if self.error else lines)


def run_ladder_trial(
    ladder: Ladder,
    *,
    seed: int,
    trays: int,
    io_map: IoMap,
    parameters: Machine,
    values: Mapping[Device, int] | None = None,
) -> LadderReport:
    """Let an FX program work the plant until nothing moves any more.

    The operator knows one thing: where nothing has moved for a while and there are seedlings left, the start button
    is pressed.

    Args:
        ladder: The program; it drives the terminals of the I/O map.
        seed: Seed of the plant.
        trays: Trays in the magazine, 72 seedlings each.
        io_map: Wires.
        parameters: Machine parameters.
        values: Registers and relays to be written after the first scan, as somebody at a programming tool would.

    Raises:
        LadderError: The program cannot be run.
    """
    plant = Plant(io_map, parameters, seed=seed, trays=trays)
    module, plc = IoModule(plant, io_map), FxPlc(ladder)
    movers = [point for point in io_map.outputs if point.tag not in INDICATORS]
    presses, still_ms, now_ms, let_go_ms = 0, PATIENCE_MS - PRESS_MS, 0, 0  # the first press comes soon
    scan_ms = SCAN_MS
    while plc.error is None and now_ms < trays * TRAY_LIMIT_MS:
        image = plc.scan(now_ms, module.inputs())[: io_map.output_count]
        if now_ms == 0:
            _write(plc, values or {})
        module.write_outputs(0, image)
        still_ms = 0 if any(point.active(image[point.number]) for point in movers) else still_ms + scan_ms
        if still_ms >= PATIENCE_MS:
            counts = plant.counts()
            if presses == MOST_PRESSES or not (counts.in_tray or counts.in_claw):
                break
            plant.box.start, let_go_ms, still_ms, presses = True, now_ms + PRESS_MS, 0, presses + 1
        if plant.box.start and now_ms >= let_go_ms:
            plant.box.start = False
        scan_ms = max(SCAN_MS, plc.constant_scan_ms)
        module.advance(scan_ms)
        now_ms += scan_ms
    incidents = tuple(f"{event.kind.value}: {event.text}, at {event.time_ms} ms" for event in plant.events)
    return LadderReport(plant.counts(), presses, incidents, now_ms / 1_000, str(plc.error or ""))


def _write(plc: FxPlc, values: Mapping[Device, int]) -> None:
    for device, value in values.items():
        if device.kind == "D":
            plc.memory.D[device.number] = value
        else:
            plc.memory.bits(device.kind)[device.number] = bool(value)
