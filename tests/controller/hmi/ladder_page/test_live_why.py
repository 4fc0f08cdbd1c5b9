"""Questions at a live program: the answer of one scan beside that of a recorded run, and on the page."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from controller.debug.timeline import RunTimeline
from controller.debug.why.answer import CauseKind, WhyAnswer
from controller.debug.why.history import RunHistory
from controller.debug.why.inquiry import Inquiry
from controller.debug.why.machine_program import MachineProgram
from controller.debug.why.single_scan import SingleScan, answer_of_scan
from controller.fx.observation.cross_reference import device_key
from controller.hmi.ladder_page import live_source
from controller.hmi.ladder_page.live_scan import LiveScan, LiveScanObserver
from controller.hmi.ladder_page.texts import TEXTS
from controller.hmi.modbus.held_scan import HeldScan
from controller.hmi.serving.snapshot import HELD_SCANS, snapshot_of
from plant_sim.twin.lock_step import Twin
from tests.controller.debug.test_why import RELAYS, STEPS, path, run, sets
from tests.controller.hmi.ladder_page.page_rig import LadderRig
from tests.controller.hmi.ladder_page.test_live_scan import LADDER, SCRATCH_WORDS, held_of
from tests.controller.hmi.panel.page.screen import chromium
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of


def live(line: RunTimeline, scan: int) -> LiveScan:
    """Return a scan of a run as a page reads it from a controller."""
    observer = LiveScanObserver(line.machine.ladder)
    held: list[HeldScan] = []
    for number in range(scan, scan - HELD_SCANS, -1):
        line.seek(number)
        held.append(held_of(snapshot_of(line.machine.memory, 10 * (number - 1), number), observer))
    return observer.observe(held)


def asked(line: RunTimeline, device: str, scan: int | None = None) -> WhyAnswer:
    """Return the answer of a live page at a scan of a run."""
    number, key = line.last if scan is None else scan, device_key(device)
    seen = live(line, number)
    assert key is not None
    assert seen.known is not None
    assert seen.before is not None
    one = SingleScan(number, seen.held.at_ms, seen.before, seen.held.memory, seen.known)
    return answer_of_scan(one, line.machine.explained, key)


def recorded(line: RunTimeline, device: str, scan: int) -> WhyAnswer:
    key = device_key(device)
    assert key is not None
    return Inquiry(RunHistory(line), line.machine.explained).ask(key, scan)


def network(seed: int) -> tuple[str, str]:
    """Return a program of relays, timers and outputs without any that keeps its value, and changes of its inputs."""
    draw = random.Random(seed)
    sources = ["X0", "X1", "X2", "X3", "M0", "M1", "M2", "M3", "T0"]
    coils = ["M0", "M1", "M2", "M3", "T0 K3", "Y0", "Y1"]
    draw.shuffle(coils)
    rungs = []
    for coil in coils:
        joins = [draw.choice(("AND", "ANI", "OR", "ORI")) for _ in range(draw.randint(1, 3))]
        first = draw.choice(("LD", "LDI", "LDP"))
        rungs += [f"{join} {draw.choice(sources)}" for join in (first, *joins)] + [f"OUT {coil}"]
    changes = "; ".join(f"{at_ms}: X{draw.randrange(4)}={draw.randrange(2)}" for at_ms in range(0, 300, 20))
    return " / ".join(rungs), changes


@pytest.mark.parametrize("seed", first_of(range(60)))
def test_the_answer_is_that_of_a_recorded_run_where_no_past_scan_is_needed(seed: int, tmp_path: Path) -> None:
    """The sets are those of the whole record, and the way is that of a record of this scan alone."""
    line = run(*network(seed), tmp_path, scans=30)
    for scan in (5, 12, 26):
        alone = line.branch(scan - 1, [])
        alone.extend(scan)
        for device in ("Y0", "Y1", "M0", "M1", "M2", "M3", "T0"):
            found, known = asked(line, device, scan), recorded(alone, device, scan)
            assert (found.sets, found.more) == (known.sets, known.more), device
            assert (path(found), [each.rung for each in found.steps]) == (path(known), [s.rung for s in known.steps])
            assert [each.device for each in found.causes] == [each.device for each in known.causes]
            assert found.sets == recorded(line, device, scan).sets
            assert not any(each.change for each in found.causes)


def test_an_output_is_followed_through_relays_to_the_input_in_words(tmp_path: Path) -> None:
    line = run("LD X0 / ANI X1 / OUT M0 / LD M0 / OUT Y0", "0: X0=1; 300: X1=1", tmp_path)
    found = asked(line, "Y0")
    assert sets(found) == [[("M0", True)]]
    assert [each.shown() for each in found.lines()] == [
        "Why is Y0 off after scan 100, 0.99 s?",
        "  1. needs M0 on  [rung 1]",
        "  Y0 is off, as before this scan  [rung 1]",
        "  M0 is off, as before this scan  [rung 0]",
        "  X1 is on, as before this scan",
        "Cause: X1 is on, as before this scan",
        "Not proved by replay: the scans before are not recorded",
    ]
    scan = next(n for n in line.walk(29, 40) if not line.machine.memory.Y[0])
    changing = asked(line, "Y0", scan)
    assert f"Y0 went off in scan {scan}" in changing.steps[0].text.en


def test_what_an_earlier_scan_has_decided_is_said_by_name(tmp_path: Path) -> None:
    line = run(RELAYS, "0: X0=1 X3=1; 300: X0=0; 400: X2=1; 500: X2=0", tmp_path)
    found = asked(line, "Y0")
    assert path(found) == ["Y0", "M1", "M0", "X0"], "M0 would set M1 in this scan"
    assert found.cause is not None
    assert (found.cause.kind, found.cause.device) == (CauseKind.INPUT, "X0")
    earlier = "M1 is off since an earlier scan; record the run to see why"
    assert earlier in [each.text.en for each in found.causes]
    kept = asked(line, "M1", 35)
    assert [each.text.en for each in kept.causes] == [earlier.replace("off", "on")]
    assert path(kept) == ["M1"]
    words = asked(run("LD X0 / MOV K7 D0 / LD= D0 K7 / OUT Y0", "300: X0=1; 400: X0=0", tmp_path), "Y0")
    assert [each.text.en for each in words.causes] == ["D0 = 7, written in an earlier scan; record the run to see it"]
    counted = asked(run("LD X0 / OUT C0 K1 / LD C0 / OUT Y0", "300: X0=1; 400: X0=0", tmp_path), "Y0")
    assert [each.text.en for each in counted.causes] == ["C0 is on since an earlier scan; record the run to see why"]


def test_steps_timers_and_commands_end_the_way(tmp_path: Path) -> None:
    line = run(STEPS, "100: X0=1; 200: X0=0; 300: X2=1", tmp_path)
    found = asked(line, "S20")
    assert (sets(found), path(found)[-1]) == ([[("X1", True)]], "X1")
    waiting = asked(line, "Y1")
    assert (sets(waiting), path(waiting)) == ([[("S21", True)]], ["Y1", "Y1", "S21"])
    assert [each.text.en for each in waiting.causes] == ["S21 is off since an earlier scan; record the run to see why"]
    timed = asked(run("LD X0 / OUT T0 K20 / LD T0 / OUT Y0", "500: X0=1", tmp_path), "Y0")
    assert [(each.kind, each.text.en) for each in timed.causes] == [(CauseKind.TIMER, "T0 runs: 4 of K20")]
    commanded = asked(run("LD M400 / OUT Y0", "", tmp_path), "Y0")
    assert [(each.kind, each.device) for each in commanded.causes] == [(CauseKind.COMMAND, "M400")]


def test_a_relay_that_changes_after_its_contact_is_followed_as_its_contact_was(tmp_path: Path) -> None:
    """M0 comes on behind the rung that reads it, so it was off when Y0 was executed."""
    line = run("LD M0 / OUT Y0 / LD X0 / OUT M0", "300: X0=1", tmp_path)
    scan = next(n for n in line.walk(29, 40) if line.machine.memory.M[0])
    found = asked(line, "Y0", scan)
    assert (sets(found), [each.device for each in found.causes]) == ([[("M0", True)]], ["M0"])
    assert found.cause is not None
    assert found.cause.text.en == "M0 is off since an earlier scan; record the run to see why"
    assert path(asked(line, "Y0", scan + 1)) == ["Y0", "M0", "X0"]


def test_a_safeguard_is_a_cause_and_never_a_contact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = run("LD X0 / AND X1 / OUT M0 / LD M0 / AND X1 / AND X2 / OUT Y0", "0: X0=1", tmp_path)
    monkeypatch.setattr(line.machine.explained, "is_safeguard", lambda key, _: key == ("X", 1))
    found = asked(line, "Y0")
    assert [each.device for one in found.sets for each in one.causes] == ["X1"]
    assert sets(found) == [[("M0", True), ("X2", True)]]
    assert found.cause is not None
    assert (found.cause.kind, found.cause.device) == (CauseKind.SAFEGUARD, "X1")


@pytest.mark.nightly
def test_interlocks_and_safeguards_of_the_machine_are_causes_and_never_contacts() -> None:
    """The emergency stop was pressed one scan ago."""
    twin = Twin(seed=2)
    twin.home()
    observer = LiveScanObserver(LADDER, SCRATCH_WORDS)
    held: list[HeldScan] = []
    twin.press("emergency_stop", for_ms=500)
    for _ in range(HELD_SCANS):
        twin.run_for(10)
        held.insert(0, held_of(snapshot_of(twin.plc.memory, twin.now_ms - 10, twin.plc.scans), observer))
    seen, program = observer.observe(held), MachineProgram(MACHINE)
    assert seen.known is not None
    assert seen.before is not None
    one = SingleScan(seen.held.number, seen.held.at_ms, seen.before, seen.held.memory, seen.known)
    guarded = 0
    for point in MACHINE.io_map.outputs:
        of = ("Y", point.number)
        found = answer_of_scan(one, program, of)
        for each in found.sets:
            guarded += bool(each.causes)
            devices = filter(None, (device_key(contact.device) for contact in each.contacts))
            assert not any(program.is_safeguard(key, of) for key in devices)
        assert not any(cause.change for cause in found.causes)
    assert guarded > 5
    lift = answer_of_scan(one, program, ("Y", 2))
    assert path(lift)[:3] == ["Y2", "M134", "S25"]
    assert lift.cause is not None
    assert (lift.cause.kind, lift.cause.device) == (CauseKind.SAFEGUARD, "X25")
    alarm = answer_of_scan(one, program, ("S", 900))
    assert "“Emergency stop pressed” is on since an earlier scan" in alarm.causes[0].text.en


TEXT = "LD X0\nSET M0\nLD M0\nAND X1\nOUT Y0\nEND\n"


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[LadderRig]:
    monkeypatch.setattr(live_source, "PERIOD_MS", 0)
    with LadderRig(TEXT) as rig:
        yield rig


def test_the_page_tells_the_reason_of_the_last_scan_and_of_a_kept_one(rig: LadderRig) -> None:
    rig.scan((0,), ())
    kept = rig.web.look("executed", keep=1)["scan"]
    rig.scan((1,))
    answer = rig.web.get("/api/why", device="Y0", scan=kept).json()
    words = [line["text"]["en"] for line in answer["lines"]]
    assert answer["available"]
    assert words[0].startswith(f"Why is Y0 off after scan {kept}")
    assert [line["text"]["en"] for line in answer["lines"] if line["cause"]] == [
        "Cause: X1 is off, as before this scan"
    ]
    assert 1 in [line["rung"] for line in answer["lines"]]
    last = rig.web.get("/api/why", device="m0").json()["lines"]
    assert last[0]["text"]["en"].startswith("Why is M0 on")
    assert any("M0 is on since an earlier scan" in line["text"]["en"] for line in last)
    unused = rig.web.get("/api/why", device="Y7").json()["lines"]
    assert [line["text"]["en"] for line in unused] == ["Y7: the program does not use it"]


def test_a_scan_that_is_not_known_has_no_reason(rig: LadderRig) -> None:
    rig.scan(())
    rig.live.writes.submit(lambda: rig.live.plc.memory.M.__setitem__(0, True))
    rig.scan(())
    answer = rig.web.get("/api/why", device="Y0").json()
    assert answer == {"available": False, "lines": [], "differing": ["M0"], "hidden": []}


def test_the_tab_why_answers_on_a_live_page(rig: LadderRig) -> None:
    rig.scan((0,))
    with chromium() as browser:
        page = browser.new_page(locale="zh-CN")
        page.goto(rig.web.origin)
        page.locator("[data-tab=outputs]").click()
        page.locator("li[data-device=Y0] button").click()
        page.locator("[data-action=why]").click()
        expect(page.locator("[data-part=why] li.cause")).to_have_text("原因：X1 断开，与本扫描之前相同 ")
        rig.live.writes.submit(lambda: rig.live.plc.memory.M.__setitem__(0, False))
        rig.scan(())
        page.locator("[data-tab=why]").click()
        expect(page.locator("[data-part=why] p")).to_have_text(TEXTS["differs"].zh.format(devices="M0"))
