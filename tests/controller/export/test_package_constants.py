"""Machine constants given to `ladder export`: each package has them at every start, and waits for X25."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import pytest

from controller.cli.main import main as controller
from controller.core.expr import Word
from controller.export.packages.package import CONFIRMATION
from controller.export.runtime_parts.part import SCAN_MS
from controller.fx.engine.plc import FxPlc
from controller.fx.language.reading import load_ladder
from controller.program.states import State
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from tests.controller.export.package_rig import MOVERS, PLACES, PackageRig, parsed_program
from tests.controller.program.interlock_scene import MACHINE, TAGS
from tests.sampling import first_of, one_in

CLAMP = TAGS.sp.clamp
CLEAR_SCANS = 3_200 // SCAN_MS


class Rig(Protocol):
    """PLC with an exported program at the terminals of the plant."""

    module: IoModule

    def read(self, word: Word) -> int: ...

    def write(self, word: Word, value: int) -> None: ...

    def scan(self) -> list[bool]: ...

    def power_cycle(self) -> None: ...


class StRig(PackageRig):
    """Package in Structured Text on the plant."""

    def power_cycle(self) -> None:
        self.plc.power_cycle()


class FxRig:
    """Instruction list on the simulated FX2N at the terminals of the plant."""

    def __init__(self, folder: Path) -> None:
        self._plc = FxPlc(load_ladder(folder / "transplanter.il"))
        self._now_ms = 0
        self.module = IoModule(Plant(MACHINE.io_map, load_machine(), seed=1, trays=1), MACHINE.io_map)

    def read(self, word: Word) -> int:
        return self._plc.memory.D[word.number]

    def write(self, word: Word, value: int) -> None:
        self._plc.memory.D[word.number] = value

    def scan(self) -> list[bool]:
        image = self._plc.scan(self._now_ms, self.module.inputs())[: MACHINE.io_map.output_count]
        self.module.write_outputs(0, image)
        self.module.advance(SCAN_MS)
        self._now_ms += SCAN_MS
        return image

    def power_cycle(self) -> None:
        self._plc.power_cycle()


def exported(target: str, folder: Path, *options: str) -> Rig:
    """Return the PLC with the package that the command writes."""
    assert controller(["ladder", "export", "--target", target, "--out", str(folder), *options]) == 0
    if target == "fx2n":
        return FxRig(folder)
    files = {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}
    return StRig(target, parsed_program(target, files).plc(device_byte=PLACES[target].device_byte))


def scans(rig: Rig, count: int) -> bool:
    """Run scans; return whether an output that moves the machine was on."""
    images = [rig.scan() for _ in range(count)]
    return any(image[number] for image in images for number in MOVERS)


def press(rig: Rig, button: str, count: int = 20) -> bool:
    """Press a button for a number of scans and release it; return whether an output that moves the machine was on."""
    setattr(rig.module.plant.box, button, True)
    moved = scans(rig, count)
    setattr(rig.module.plant.box, button, False)
    return scans(rig, 20) or moved


def state(rig: Rig) -> State:
    return State(rig.read(TAGS.machine.state))


@pytest.mark.parametrize(
    ("target", "by_file"), one_in(2, [("openplc", False), ("codesys", False), ("plain", True), ("fx2n", False)])
)
def test_a_constant_given_to_the_export_is_in_force_and_confirmed_at_each_start(
    target: str, *, by_file: bool, tmp_path: Path
) -> None:
    """X0 homes only after X25 has been pressed and released and X24 held; a written value is lost with the power."""
    file = tmp_path / "constants.yaml"
    file.write_text("clamp: 21\n", encoding="utf-8")
    rig = exported(target, tmp_path / target, *(["--constants", str(file)] if by_file else ["--set", "clamp=21"]))
    assert CONFIRMATION in (tmp_path / target / "README.txt").read_text(encoding="utf-8")
    for _ in range(2):
        scans(rig, 20)
        assert rig.read(CLAMP) == 21
        assert not press(rig, "start")
        assert state(rig) is State.STOPPED
        rig.write(CLAMP, 20)
        rig.power_cycle()
    scans(rig, 20)
    assert not press(rig, "emergency_stop")
    assert state(rig) is State.ABORTED
    assert not press(rig, "stop", CLEAR_SCANS)
    assert state(rig) is State.STOPPED
    assert press(rig, "start")
    assert state(rig) is State.RESETTING
    assert rig.read(CLAMP) == 21


@pytest.mark.parametrize("target", first_of(["fx2n", "openplc", "codesys", "plain"]))
def test_without_other_constants_the_first_press_homes(target: str, tmp_path: Path) -> None:
    rig = exported(target, tmp_path / target)
    scans(rig, 20)
    assert rig.read(CLAMP) == 20
    assert press(rig, "start")
    assert state(rig) is State.RESETTING
