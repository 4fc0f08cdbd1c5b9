"""Picture of the machine of a recorded run: positions, terminals and crop after any scan."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from controller.debug.commands import Debugger
from controller.fx.language.il import read_il
from controller.fx.observation.cross_reference import CrossReference
from controller.hmi.ladder_page.program import PageProgram
from controller.hmi.ladder_page.recorded_source import RecordedSource
from controller.hmi.ladder_page.source import ScanNotKeptError
from controller.program.tags import SIDES
from plant_sim.machine.plant import Plant
from plant_sim.twin.debug.machine import TwinMachine
from plant_sim.twin.debug.picture import crop_of, picture_of
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.ending.rule import EndingRule
from plant_sim.twin.ladder.recording import LadderRecorder
from plant_sim.twin.ladder.trial import run_ladder_trial
from plant_sim.twin.lock_step import SCAN_MS, Twin

IN_PROGRESS = 2
LIFTS = """\
LD X0
SET M0
LD M0
OUT Y2
END
"""
"""X0 lifts the left arm."""


def positions(plant: Plant) -> dict[str, float]:
    found: dict[str, float] = {}
    for side, arm in plant.arms.items():
        found |= {f"{side}.slide_mm": 1_000 * arm.slide.x_m, f"{side}.lift_mm": 1_000 * arm.lift.y_m}
        found |= {f"{side}.spreader_mm": 1_000 * arm.spreader.travel_m, f"{side}.claw_deg": arm.claws.angle_deg}
    return found


def source_of(recorder: TwinRecorder | LadderRecorder) -> RecordedSource:
    line = recorder.close()
    program = PageProgram("program", CrossReference(read_il(LIFTS)))
    return RecordedSource(program, Debugger(line), picture_of(line.machine))


def after(source: RecordedSource, scan: int) -> dict[str, Any]:
    picture = asyncio.run(source.machine(scan))
    assert picture is not None
    return picture


def test_every_scan_of_a_trial_has_its_picture() -> None:
    twin = Twin(trays=1)
    recorder = TwinRecorder(twin)
    twin.home()
    twin.start()
    twin.run_for(3_000)
    first = twin.now_ms // SCAN_MS
    seen = []
    for _ in range(150):
        twin.run_for(SCAN_MS)
        memory = twin.plc.memory
        levels = {point.address: int(memory.Y[point.number]) for point in twin.io_map.outputs}
        counts = {side: twin.plc.read(arm.cup_counter.value) for side, arm in twin.machine.tags.arms.items()}
        seen.append((positions(twin.plant), levels, counts, twin.state))
    source = source_of(recorder)
    shown = {scan: after(source, first + 1 + scan) for scan in (140, 3, 77, 149, 0)}
    for scan, picture in shown.items():
        places, levels, counts, state = seen[scan]
        assert {name: picture["telemetry"][name] for name in places} == places
        assert {address: picture["io"][address] for address in levels} == levels
        assert {side: picture["arms"][side]["cup_count"] for side in SIDES} == counts
        assert picture["state"] == state
    assert len({tuple(seen[scan][0].values()) for scan in shown}) == len(shown)
    with pytest.raises(ScanNotKeptError, match="is not recorded"):
        asyncio.run(source.machine(first + 1_000))


def test_the_picture_of_another_program_shows_the_crop_of_the_plant() -> None:
    recorder = LadderRecorder()
    run_ladder_trial(read_il(LIFTS), seed=1, trays=1, rule=EndingRule(3_000), recorder=recorder)
    source = source_of(recorder)
    before, lifted = after(source, 10), after(source, recorder.timeline.last)
    assert (before["telemetry"]["left.lift_mm"], lifted["telemetry"]["left.lift_mm"]) == pytest.approx(
        (150, 0), abs=0.5
    )
    assert [before["io"]["Y2"], lifted["io"]["Y2"]] == [0, 1]
    assert lifted["tray"]["phase"] == 0  # no tray has been fed
    assert not lifted["counts"]
    assert not any(lifted["arms"][side]["loaded"] for side in SIDES)


def test_the_crop_of_the_plant_is_what_a_sound_machine_believes() -> None:
    twin = Twin(trays=1)
    picture = picture_of(TwinMachine(twin))
    assert picture is not None
    twin.home()
    twin.start()
    compared = set()
    for _ in range(60):
        twin.run_for(500)
        crop, believed = crop_of(twin.module), picture.view()
        assert crop["tray"]["phase"] == believed["tray"]["phase"]
        for side in SIDES:
            own, other = crop["arms"][side], believed["arms"][side]
            if own["loaded"] == other["loaded"] and IN_PROGRESS not in other["rows"].values():
                assert own["rows"] == other["rows"]
                compared.add((own["loaded"], *own["rows"].values()))
    assert compared == {(False, 1, 1, 1), (True, 0, 1, 1), (False, 0, 1, 1), (True, 0, 0, 1)}
