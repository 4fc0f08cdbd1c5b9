"""Questions why a device of an FX program is on or off, from its rung through past scans to the cause."""

from __future__ import annotations

from pathlib import Path
from string import Formatter

import pytest

from controller.common.errors import InputError
from controller.debug.commands import Debugger
from controller.debug.fx_machine import record_run
from controller.debug.timeline import RunTimeline
from controller.debug.why import texts
from controller.debug.why.answer import CauseKind, WhyAnswer
from controller.debug.why.proof import answer
from controller.fx.language.il import read_il
from controller.fx.observation.cross_reference import device_key
from controller.fx.stimulus.stimulus import load_stimulus


def run(text: str, changes: str, folder: Path, scans: int = 100) -> RunTimeline:
    """Record a run of a program; the changes are written as ``200: X0=1 X1=0; 300: M5=1``."""
    rows = []
    for change in filter(None, changes.split(";")):
        at_ms, values = change.split(":")
        rows.append(f"  - {{at_ms: {at_ms.strip()}, set: {{{', '.join(values.split()).replace('=', ': ')}}}}}\n")
    stimulus = f"scan_ms: 10\nscans: {scans}\n" + ("inputs:\n" + "".join(rows) if rows else "") + "watch: [Y0]\n"
    (folder / "stimulus.yaml").write_text(stimulus, encoding="utf-8")
    ladder = read_il("\n".join([*text.split(" / "), "END"]))
    return record_run(ladder, load_stimulus(folder / "stimulus.yaml"))


def why(line: RunTimeline, device: str, scan: int | None = None) -> WhyAnswer:
    key = device_key(device)
    assert key is not None
    return answer(line, line.machine.explained, key, line.last if scan is None else scan)


def sets(found: WhyAnswer) -> list[list[tuple[str, bool]]]:
    return [[(contact.device, contact.on) for contact in each.contacts] for each in found.sets]


def path(found: WhyAnswer) -> list[str]:
    return [step.device for step in found.steps]


RELAYS = "LD X0 / ANI X1 / OUT M0 / LD M0 / SET M1 / LD X2 / RST M1 / LD M1 / AND X3 / OUT Y0"


def test_an_output_is_followed_through_relays_to_the_input_that_changed_last(tmp_path: Path) -> None:
    """X2 has reset M1 for 100 ms, long before the question."""
    line = run(RELAYS, "0: X0=1 X3=1; 300: X0=0; 400: X2=1; 500: X2=0", tmp_path)
    found = why(line, "Y0")
    assert sets(found) == [[("M1", True)]]
    assert path(found) == ["Y0", "M1", "X2"]
    assert [step.scan for step in found.steps] == [41, 41, 41]
    assert found.cause is not None
    assert (found.cause.kind, found.cause.device, found.cause.scan) == (CauseKind.INPUT, "X2", 41)


def test_the_cause_is_proved_if_the_output_comes_with_the_input_changed(tmp_path: Path) -> None:
    line = run(RELAYS, "0: X0=1 X3=1; 300: X0=0; 400: X2=1; 500: X2=0", tmp_path)
    before = line.machine.image("")
    proof = why(line, "Y0").proof
    assert (proof.proved, proof.change, proof.scan) == (True, "X2=off@38..51", 41)
    line.seek(line.last)
    assert line.machine.image("") == before


def test_a_cause_that_is_not_enough_is_not_proved_and_says_what_is_left(tmp_path: Path) -> None:
    """X3 opens last, but X0 is off and X2 resets M1 all the time."""
    line = run(RELAYS, "0: X3=1 X2=1; 500: X3=0", tmp_path)
    found = why(line, "Y0")
    assert found.cause is not None
    assert found.cause.device == "X3"
    assert not found.proof.proved
    assert found.proof.change == "X3=on@48.."
    assert "then: X0 is off" in found.proof.text.en


def test_without_a_plant_no_physical_cause_is_claimed(tmp_path: Path) -> None:
    found = why(run(RELAYS, "0: X0=1; 300: X0=0", tmp_path), "Y0")
    assert {cause.kind for cause in found.causes} <= {CauseKind.INPUT, CauseKind.UNCHANGED}


def test_a_timer_that_runs_is_the_cause_with_its_value(tmp_path: Path) -> None:
    line = run("LD X0 / OUT T0 K20 / LD T0 / OUT Y0", "500: X0=1", tmp_path)
    found = why(line, "Y0")
    assert found.cause is not None
    assert found.cause.kind == CauseKind.TIMER
    assert found.cause.text.en == "T0 runs: 4 of K20"
    assert not found.proof.proved


def test_a_timer_that_has_elapsed_leads_to_its_rung(tmp_path: Path) -> None:
    line = run("LD X0 / ANI X1 / OUT T0 K2 / LD T0 / SET Y0", "300: X0=1", tmp_path)
    found = why(line, "Y0")
    assert path(found)[:2] == ["Y0", "T0"]
    assert path(found)[-1] in ("X0", "X1")
    assert found.cause is not None
    assert found.cause.device == "X0"


STEPS = "LD X0 / SET S20 / STL S20 / OUT Y0 / LD X1 / AND X2 / SET S21 / STL S21 / OUT Y1 / RET"


def test_an_active_step_is_asked_for_its_transition(tmp_path: Path) -> None:
    found = why(run(STEPS, "100: X0=1; 200: X0=0; 300: X2=1", tmp_path), "S20")
    assert "Why has step S20 not left" in found.question.en
    assert sets(found) == [[("X1", True)]]
    assert found.cause is not None
    assert found.cause.device == "X1"


def test_an_output_of_an_inactive_step_waits_for_the_step(tmp_path: Path) -> None:
    found = why(run(STEPS, "100: X0=1; 200: X0=0; 300: X2=1", tmp_path), "Y1")
    assert sets(found) == [[("S21", True)]]
    assert path(found)[-1] == "X1"


def test_a_step_that_was_left_leads_to_the_transition(tmp_path: Path) -> None:
    found = why(run(STEPS, "100: X0=1; 200: X0=0; 300: X2=1; 400: X1=1", tmp_path), "S20")
    assert path(found)[:2] == ["S20", "X1"]
    assert "was left" in found.steps[0].text.en


def test_an_output_in_a_zone_without_power_leads_to_its_master_control(tmp_path: Path) -> None:
    line = run("LD X0 / MC N0 M100 / LD X1 / OUT Y0 / MCR N0", "100: X0=1 X1=1; 300: X0=0", tmp_path)
    found = why(line, "Y0")
    assert sets(found) == [[("M100", True)]]
    assert path(found)[-1] == "X0"
    assert found.proof.proved


def test_a_jumped_output_leads_to_the_jump(tmp_path: Path) -> None:
    line = run("LD X0 / CJ P0 / LD X1 / OUT Y0 / P0 / LD X2 / OUT Y1", "100: X0=1; 300: X1=1", tmp_path)
    found = why(line, "Y0")
    assert sets(found) == [[("X0", False)]]
    assert found.cause is not None
    assert found.cause.device == "X0"
    assert not found.proof.proved or found.proof.change.startswith("X0=off")


def test_a_device_that_the_program_does_not_write_is_a_command(tmp_path: Path) -> None:
    found = why(run("LD M400 / SET M0 / LD M0 / OUT Y0", "300: M400=1; 310: M400=0", tmp_path), "Y0")
    assert found.cause is not None
    assert (found.cause.kind, found.cause.device) == (CauseKind.COMMAND, "M400")


def test_a_comparison_leads_to_the_rung_that_wrote_the_word(tmp_path: Path) -> None:
    line = run("LD X0 / MOV K7 D0 / LD= D0 K7 / OUT Y0", "300: X0=1; 400: X0=0", tmp_path)
    assert path(why(line, "Y0")) == ["Y0", "D0", "X0"]
    assert "= 7 after" in why(line, "D0").question.en


def test_more_than_five_sets_are_not_shown_and_said(tmp_path: Path) -> None:
    text = " / ".join(["LD X0", *(f"OR X{n}" for n in range(1, 7)), "OUT Y0"])
    found = why(run(text, "", tmp_path), "Y0")
    assert (len(found.sets), found.more) == (5, True)
    assert "further sets are not shown" in "\n".join(line.shown() for line in found.lines())


def test_the_console_answers_in_both_languages_and_stays_at_its_scan(tmp_path: Path) -> None:
    debugger = Debugger(run(RELAYS, "0: X0=1 X3=1; 300: X0=0; 400: X2=1; 500: X2=0", tmp_path))
    list(debugger.execute("goto 60"))
    english = list(debugger.execute("why Y0"))
    assert english[:2] == ["Why is Y0 off after scan 60, 0.60 s?", "  1. needs M1 on  [rung 3]"]
    assert english[-2:] == [
        "Cause: X2 is on, since scan 41, 0.41 s",
        "Proved by replay: with X2=off@38..51, Y0 is on in scan 41",
    ]
    chinese = list(debugger.execute("why Y0 zh"))
    assert len(chinese) == len(english)
    assert chinese[-1].startswith("重放证明")
    assert list(debugger.execute("why not Y0")) == english
    assert list(debugger.execute("why not X3")) == [
        "X3 is on in scan 60; go back to a scan in which it is off, or ask why X3"
    ]
    assert debugger.scan == 60


def test_every_sentence_has_the_same_places_in_both_languages() -> None:
    for key, text in texts.SENTENCES.items():
        english, chinese = (sorted(name for _, name, _, _ in Formatter().parse(each) if name) for each in text)
        assert english == chinese, key
        assert text.en != text.zh, key


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("why", "write a device or tag"),
        ("why Y0 Y1", "write a device or tag"),
        ("why TN0", "not a device"),
        ("why nothing", "no such device"),
    ],
)
def test_an_invalid_question_is_one_line(command: str, message: str, tmp_path: Path) -> None:
    debugger = Debugger(run(RELAYS, "", tmp_path, scans=5))
    with pytest.raises(InputError, match=message) as error:
        list(debugger.execute(command))
    assert "\n" not in str(error.value)


def test_a_question_at_the_first_scan_says_where_to_ask(tmp_path: Path) -> None:
    debugger = Debugger(run(RELAYS, "", tmp_path, scans=5))
    list(debugger.execute("goto 0"))
    with pytest.raises(InputError, match="choose one from 1 to 5"):
        list(debugger.execute("why Y0"))
