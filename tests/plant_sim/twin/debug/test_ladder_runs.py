"""Recorded trial with an FX program in place of the controller: every scan is that of the trial, with the plant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from controller.common.errors import InputError
from controller.debug.commands import Debugger
from controller.fx.language.il import read_il
from plant_sim.cli.main import main
from plant_sim.faults import parse_fault
from plant_sim.twin.ending.rule import EndingRule
from plant_sim.twin.ladder.recording import LadderRecorder
from plant_sim.twin.ladder.trial import run_ladder_trial
from tests.sampling import first_of

PROGRAM = """\
LD X0
SET M0
LD M0
ANI X2
OUT Y2
LD X2
OUT T0 K30
LD T0
OUT Y3
LD M8002
SET S0
STL S0
LD T0
SET S20
STL S20
RET
END
"""
"""X0 lifts the left arm, which stays up: X2 is the upper switch."""


class NotingRecorder(LadderRecorder):
    """Recorder that notes the devices and the plant after every scan of the trial."""

    def begin(self, *parts: Any) -> None:
        super().begin(*parts)
        self.noted: dict[int, tuple[object, bytes]] = {}

    def scanned(self, now_ms: int) -> None:
        super().scanned(now_ms)
        self.noted[self.timeline.last] = self.state()

    def state(self) -> tuple[object, bytes]:
        machine = self._machine
        return machine.image(""), machine.module.plant.state.tobytes()


def played(*faults: str) -> NotingRecorder:
    recorder = NotingRecorder()
    rule = EndingRule(9_000)
    run_ladder_trial(read_il(PROGRAM), seed=1, trays=1, faults=map(parse_fault, faults), rule=rule, recorder=recorder)
    recorder.close()
    return recorder


def test_every_scan_can_be_returned_to_with_the_plant() -> None:
    recorder = played("stuck_off:left.lift_up@5s..6s")
    line = recorder.timeline
    assert line.last > 800
    for scan in (*range(line.last, 0, -37), 1, 51, 50, 49, line.last):
        line.seek(scan)
        assert recorder.state() == recorder.noted[scan], scan
        assert line.machine.now_ms == 10 * scan
    assert [str(entry) for _, entry in line.entries()] == ["start=on", "start=off"]


def test_why_a_branch_and_values_of_the_plant() -> None:
    debugger = Debugger(played().timeline)
    (found,) = debugger.execute("last left.lift.position_m<0.05")
    assert found.startswith("left.lift.position_m<0.05: False -> True in scan ")
    list(debugger.execute("goto 600"))
    assert list(debugger.execute("show left.lift_up")) == ["X2: 1"]
    assert list(debugger.execute("show Y3")) == ["Y3: 1"]
    words = "\n".join(debugger.execute("why Y3"))
    assert "T0" in words
    assert "Proved by replay: with X2=off@" in words
    answers = list(debugger.execute("branch X0=off@1.."))
    assert any("Y2: 1 | 0" in line for line in answers)
    with pytest.raises(InputError, match="a value of the plant cannot be set"):
        list(debugger.execute("branch left.lift.position_m=0@5"))


@pytest.mark.parametrize(
    "fault", first_of(["stuck_off:left.lift_up", "jammed:left.lift", "closed_throttle:left.lift.plus=1e-11"])
)
def test_why_ends_at_the_fault_of_the_plant_and_proves_it(fault: str) -> None:
    debugger = Debugger(played(f"{fault}@200ms..").timeline)
    english, chinese = ("\n".join(debugger.execute(f"why not Y3{language}")) for language in ("", " zh"))
    name = fault.partition("=")[0]
    assert "X2 left.lift_up is off" in english
    (cause,) = (line for line in english.splitlines() if line.startswith("Cause: "))
    assert cause.startswith(f"Cause: fault {name}, since 0.20 s; left.lift ")
    assert f"Proved by replay: with mend={name}@" in english
    assert "X2 左：升降在上限位" in chinese
    assert "左：升降 " in chinese
    assert "left." not in chinese.replace(name, "")


def test_a_safeguard_is_a_cause_of_another_program_and_no_contact_to_bridge() -> None:
    recorder = LadderRecorder()
    text = "LD X0\nOR M0\nANI X24\nOUT M0\nLD M0\nAND X1\nOUT Y2\nEND\n"
    run_ladder_trial(read_il(text), seed=1, trays=1, rule=EndingRule(3_000), recorder=recorder)
    words = "\n".join(Debugger(recorder.close()).execute("why not M0"))
    assert "  1. needs X0 start on; cause: X24 stop on" in words
    assert "needs X24" not in words


def test_a_fault_and_a_button_of_a_branch() -> None:
    debugger = Debugger(played().timeline)
    (_, *answers) = debugger.execute("branch fault=jammed:left.lift@50..")
    assert any(line.startswith("first difference") or "Y3" in line for line in answers), answers
    list(debugger.execute("use branch"))
    assert list(debugger.execute("show X2 Y3")) == ["X2: 0", "Y3: 0"]
    list(debugger.execute("branch start=off@1.."))
    with pytest.raises(InputError, match="no such kind of fault"):
        list(debugger.execute("branch mend=jamed:left.lift@5"))
    with pytest.raises(InputError, match="on or off"):
        list(debugger.execute("branch start=2@5"))


def test_the_command_takes_a_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "program.il"
    file.write_text(PROGRAM, encoding="utf-8")
    given = ["debug", "--ladder", str(file), "--trays", "1", "--max-s", "5"]
    assert main([*given, "--do", "last M0"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("M0: 0 -> 1 in scan ")
    assert main([*given, "--set", "settle=30"]) == 2
    assert "--ladder: the program has its own initial values" in capsys.readouterr().err
    assert main(["debug", "--cpu", "fx3u"]) == 2
    assert "--cpu and --modules: belong to an FX program" in capsys.readouterr().err
