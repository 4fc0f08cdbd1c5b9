"""Machine constants given to `ladder export`: each package has them at every start, and waits for X25."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cli.main import main as controller
from controller.export.packages.package import CONFIRMATION
from controller.export.runtime_parts.part import SCAN_MS
from controller.fx.language.il import read_il
from controller.program.states import State
from tests.controller.export.package_rig import MOVERS, PLACES, FxRig, PackageRig, files_in, parsed_program
from tests.controller.export.terminals import Rig
from tests.controller.program.interlock_scene import TAGS
from tests.sampling import first_of, one_in

CLAMP = TAGS.sp.clamp
CLEAR_SCANS = 3_200 // SCAN_MS


def exported(target: str, folder: Path, *options: str) -> Rig:
    """Return the PLC with the package that the command writes."""
    assert controller(["ladder", "export", "--target", target, "--out", str(folder), *options]) == 0
    files = files_in(folder)
    if target == "fx2n":
        return FxRig(read_il(files["transplanter.il"]))
    return PackageRig(target, parsed_program(target, files).plc(device_byte=PLACES[target].device_byte), trays=1)


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


@pytest.mark.nightly
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
