"""Recorded runs of the twin: any scan can be returned to, bit for bit, and recording changes nothing."""

from __future__ import annotations

import random

import pytest

from controller.common.errors import InputError
from controller.program.states import State
from plant_sim.faults import parse_fault
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import SCAN_MS, NotReachedError, Twin
from tests.sampling import first_of

INTERVAL = 50


def image(twin: Twin) -> tuple[bytes, bytes, bytes, list[bool]]:
    """Return every device of the program, the state of the plant, and the buttons."""
    plc = twin.runtime.plc
    return plc.execution.save(), plant_bytes(twin), twin.plant.params.tobytes(), twin.plant.box.save()


def plant_bytes(twin: Twin) -> bytes:
    return twin.plant.state.tobytes()


class Witness:
    """Twin that is run scan by scan, and whose state after each scan is stored without the recorder."""

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self.images: list[object] = [image(twin)]

    def run(self, ms: int) -> None:
        for _ in range(ms // SCAN_MS):
            self.twin.run_for(SCAN_MS)
            self.images.append(image(self.twin))


def disturbed(run: Witness) -> int:
    """Home and start the machine, and disturb it with all that can enter; return the last scan before a power cycle."""
    twin = run.twin
    run.run(30)
    twin.press("start")
    run.run(12_000)
    twin.press("start", for_ms=250)
    run.run(4_000)
    twin.plant.faults.add(parse_fault(f"stuck_off:left.lift_up@{twin.plant.time_ms}ms..{twin.plant.time_ms + 900}ms"))
    run.run(1_730)
    twin.command("hold")
    run.run(2_000)
    twin.runtime.order("reset")
    run.run(400)
    twin.plant.planting_frequency_per_min = 30.0
    run.run(370)
    twin.plant.box.emergency_stop = True
    run.run(640)
    twin.plant.box.emergency_stop = False
    twin.press("stop", for_ms=3_200)
    run.run(4_010)
    off = len(run.images) - 1
    twin.power_cycle(730)
    run.run(1_000)
    twin.runtime.set_points({"trays_target": "1"})
    run.run(500)
    twin.plc.write(twin.machine.tags.sp.trays_target, 2)
    twin.press("start")
    run.run(3_000)
    return off


@pytest.mark.parametrize("drawn", first_of([40, 150]))
def test_every_scan_of_a_disturbed_run_can_be_returned_to_in_any_order(drawn: int) -> None:
    twin = Twin(seed=7, faults=[parse_fault("leak:left.slide.plus=2e-9@5s..9s")])
    recorder = TwinRecorder(twin, interval=INTERVAL)
    run = Witness(twin)
    off = disturbed(run)
    line = recorder.close()
    assert (line.first, line.last) == (0, len(run.images) - 1)
    scans = random.Random(1).sample(range(line.last + 1), drawn)
    for scan in (*scans, 0, 1, line.last, line.last - 1, *range(1_200, 1_300), *range(off + 60, off - 5, -1)):
        line.seek(scan)
        assert image(twin) == run.images[scan], scan


def test_recording_changes_nothing() -> None:
    images = []
    for records in (True, False):
        twin = Twin(seed=3)
        recorder = TwinRecorder(twin) if records else None
        twin.home()
        twin.start()
        twin.run_for(3_010)
        with pytest.raises(NotReachedError):
            twin.run_until_state(State.ABORTED, within_ms=500)
        if recorder is not None:
            recorder.close()
        images.append((image(twin), twin.now_ms, twin.events, twin.module.save()))
    assert images[0] == images[1]


def test_the_oldest_scans_are_dropped_in_whole_intervals() -> None:
    twin = Twin()
    recorder = TwinRecorder(twin, length=300, interval=INTERVAL)
    run = Witness(twin)
    run.run(8_130)
    line = recorder.close()
    assert line.last == 813
    assert line.first == 500  # the last interval of which a scan is among the latest 300
    line.seek(500)
    assert image(twin) == run.images[500]
    with pytest.raises(InputError, match="scan 499: not recorded; choose one from 500 to 813"):
        line.seek(499)


def test_a_run_step_by_step_is_not_recorded() -> None:
    with pytest.raises(InputError, match="machine code"):
        TwinRecorder(Twin(step_by_step=True))
