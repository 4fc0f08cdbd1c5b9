"""The score of the bench: classes of drawn damages, and the file of results."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.plant_sim.hil import score as scoring
from tests.plant_sim.hil.score import ESCAPED, FAILED, HARMLESS, NEVER_ACTED, Scored, main, read, score, summary
from tests.sampling import first_of

RECORDED = read(Path(__file__).with_name("score.jsonl"))
"""Results of the score in the documentation, of all cases."""
CLASSES = (
    ("tray_run on @ power-up+50000 for 1000", FAILED, "power-up: nothing moves without a press"),
    ("left.slide_at_pick_3 swap=stop @ emergency_stop+50000 for 50", NEVER_ACTED, ""),
    ("left.slide_at_pick_3 on @ power-up+100 for 50", HARMLESS, ""),
    ("left.spread delay=10 @ always", ESCAPED, ""),
)


@pytest.mark.parametrize(("damage", "verdict", "case"), first_of(CLASSES))
def test_the_class_of_a_damage(monkeypatch: pytest.MonkeyPatch, damage: str, verdict: str, case: str) -> None:
    monkeypatch.setattr(scoring, "draw", lambda _seed, _io_map: damage)
    monkeypatch.setattr(scoring, "RANDOM_S", 0)
    scored = score(1, ("power-up",))
    assert (scored.seed, scored.damage, scored.verdict, scored.case) == (1, damage, verdict, case)


@pytest.mark.parametrize("recorded", first_of(RECORDED, 0, nightly=20), ids=lambda each: str(each.seed))
def test_a_drawn_damage_is_judged_as_recorded(recorded: Scored) -> None:
    scored = score(recorded.seed)
    assert (scored.damage, scored.verdict, scored.case) == (recorded.damage, recorded.verdict, recorded.case)


def test_the_page_states_the_recorded_score() -> None:
    assert summary(RECORDED) in " ".join((ROOT / "docs/hil-bench.md").read_text(encoding="utf-8").split())


def test_seeds_that_the_file_contains_are_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run: list[int] = []

    def judged(seed: int, _groups: tuple[str, ...]) -> Scored:
        run.append(seed)
        return Scored(seed, "stop off @ always", FAILED if seed % 2 else ESCAPED, "stop: rests" * (seed % 2), "late")

    monkeypatch.setattr(scoring, "score", judged)
    out = tmp_path / "new" / "score.jsonl"
    assert main(["--first", "5", "--count", "2", "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "5 failed: stop off @ always (stop: rests; late)",
        "6 escaped: stop off @ always (late)",
        "2 damages: 1 failed, 0 never acted, 0 harmless, 1 escaped",
    ]
    assert main(["--first", "5", "--count", "3", "--out", str(out)]) == 0
    assert run == [5, 6, 7]
    assert summary(read(out)) == "3 damages: 2 failed, 0 never acted, 0 harmless, 1 escaped"
