"""Trial of a third-party FX program in place of the controller, operated through the push buttons only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final

from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import DeviceOperand, Ladder, LadderError
from controller.fx.language.reading import load_ladder
from controller.iomap.loader import IoMap
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant

__all__ = ["LadderError", "LadderReport", "load_ladder", "run_ladder_trial"]

SCAN_MS: Final = 10
PRESS_MS: Final = 200
IDLE_LIMIT_MS: Final = 20_000
"""Idle time after which the operator presses the start button, or the trial ends. Twelve cups at 45 cups/min
take 16 s."""
MAX_PRESSES: Final = 10
TRAY_LIMIT_MS: Final = 600_000
INDICATORS: Final = ("horn", "lamp_red", "lamp_amber", "lamp_green")


@dataclass(frozen=True, slots=True)
class LadderReport:
    """Result of a trial with an FX program.

    Attributes:
        counts: Final location of the seedlings.
        presses: Number of presses of the start button.
        incidents: Incidents in the plant, one line each.
        simulated_s: Simulated time, s.
        error: CPU error that stopped the program; empty if none.
    """

    counts: SeedlingCounts
    presses: int
    incidents: tuple[str, ...]
    simulated_s: float
    error: str

    @property
    def completed(self) -> bool:
        """True if every seedling has left the trays and claws without an incident or a CPU error."""
        return not (self.counts.in_tray or self.counts.in_claw or self.incidents or self.error)

    def record(self) -> dict[str, object]:
        """Return the report as a flat record."""
        counts = asdict(self.counts)
        return {
            "completed": self.completed,
            **counts,
            "presses": self.presses,
            "incidents": list(self.incidents),
            "simulated_s": self.simulated_s,
            "error": self.error,
        }

    def text(self) -> str:
        """Return the report in a few lines."""
        c = self.counts
        lines = [
            f"{c.total} seedlings: {c.in_cups} in cups, {c.P} lost picking, {c.D} lost carrying, {c.T} lost throwing, "
            f"{c.in_tray} left in trays, {c.in_claw} in claws",
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
    values: Mapping[DeviceOperand, int] | None = None,
    peripherals: Peripherals | None = None,
) -> LadderReport:
    """Run an FX program on the plant until all motion has stopped.

    The operator presses the start button whenever nothing has moved for `IDLE_LIMIT_MS` and seedlings remain.

    Args:
        ladder: The program; it drives the terminals of the I/O map.
        seed: Seed of the plant.
        trays: Trays in the magazine, 72 seedlings each.
        io_map: I/O map.
        parameters: Machine parameters.
        values: Values written to registers and relays after the first scan, as with a programming tool.
        peripherals: Special function modules and serial line; None = none.

    Raises:
        LadderError: The program cannot be run.
    """
    plant = Plant(io_map, parameters, seed=seed, trays=trays)
    module = IoModule(plant, io_map)
    plc = FxPlc(ladder, execution=fastest_execution, peripherals=peripherals)
    movers = [point for point in io_map.outputs if point.tag not in INDICATORS]
    presses, still_ms, now_ms, release_ms = 0, IDLE_LIMIT_MS - PRESS_MS, 0, 0  # first press soon after start
    scan_ms = SCAN_MS
    while plc.error is None and now_ms < trays * TRAY_LIMIT_MS:
        image = plc.scan(now_ms, module.inputs())[: io_map.output_count]
        if now_ms == 0:
            _write(plc, values or {})
        module.write_outputs(0, image)
        still_ms = 0 if any(point.active(image[point.number]) for point in movers) else still_ms + scan_ms
        if still_ms >= IDLE_LIMIT_MS:
            counts = plant.counts()
            if presses == MAX_PRESSES or not (counts.in_tray or counts.in_claw):
                break
            plant.box.start, release_ms, still_ms, presses = True, now_ms + PRESS_MS, 0, presses + 1
        if plant.box.start and now_ms >= release_ms:
            plant.box.start = False
        scan_ms = max(SCAN_MS, plc.constant_scan_ms)
        advance(plc, module, now_ms, scan_ms)
        now_ms += scan_ms
    incidents = tuple(f"{event.kind.value}: {event.text}, at {event.time_ms} ms" for event in plant.events)
    return LadderReport(plant.counts(), presses, incidents, now_ms / 1_000, str(plc.error or ""))


def advance(plc: FxPlc, module: IoModule, now_ms: int, scan_ms: int) -> None:
    """Advance the plant to the next scan, in steps of 1 ms if the program has fast inputs or interrupts."""
    if not plc.is_sampled:
        module.advance(scan_ms)
        return
    for at_ms in range(now_ms + 1, now_ms + scan_ms + 1):
        module.advance(1)
        if at_ms < now_ms + scan_ms:
            before = plc.cpu.latches.copy()
            image = plc.sample(at_ms, module.inputs())
            if image != before:
                module.write_outputs(0, image[: module.io_map.output_count])


def _write(plc: FxPlc, values: Mapping[DeviceOperand, int]) -> None:
    for device, value in values.items():
        if device.kind == "D":
            plc.memory.D[device.number] = value
        else:
            plc.memory.bits(device.kind)[device.number] = bool(value)
