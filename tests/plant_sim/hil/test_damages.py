"""The bench fails controllers that are damaged on purpose."""

from __future__ import annotations

import pytest

from plant_sim.hil.bench import Bench
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import CaseVerdict
from plant_sim.hil.random_operator import RANDOM, SECONDS_PER_TRAY
from plant_sim.hil.reference import TrialQuantities, excesses
from plant_sim.hil.wire_cases import yield_cases
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from tests.plant_sim.hil.drawn import draw
from tests.plant_sim.hil.grammar import NAMED, WHENS, Shim, parse
from tests.plant_sim.hil.hil_rig import TRAYS, default_map, failures, judge, judge_shimmed, own_trial
from tests.sampling import first_of
from tests.wiring import YIELD, wired

KILLED_BY = {
    "starts 5 s after power-up": ("power-up", "", "unexpected start: "),
    "emergency stop acts for 1.5 s": ("press", "clear and start under", "emergency stop: "),
    "starts 45 s after a stop": ("stop", "", "unexpected start: "),
    "stop is 80 s late": ("stop", "", "late stop: the left arm took 5 rows"),
    "serves every second cup": ("trial", "", "missed cups: 120 cups missed; 8 with"),
    "chops the slide valves": ("trial", "", "switching: left.slide_inward switched on 260 times; 5 with"),
}
"""Group and name of the case that fails each named damage, and the beginning of its reason."""


@pytest.mark.parametrize("name", first_of(KILLED_BY))
def test_a_named_damage_fails_the_case_that_is_written_for_it(name: str) -> None:
    group, only, reason = KILLED_BY[name]
    results, *_ = judge_shimmed([NAMED[name]], [group], only=only)
    assert results[-1].group == group
    assert any(each.startswith(reason) for each in results[-1].reasons), failures(results)


def test_every_named_damage_has_its_case() -> None:
    assert KILLED_BY.keys() == NAMED.keys()


KILLS = [
    ("press", "start held while the emergency", "start off @ emergency_stop for 11500", "unexpected start: "),
    ("press", "a start contact", "start chop=5000 @ always", "unexpected start: "),
    ("press", "start with stop held", "stop off @ start for 600", "unexpected start: "),
    ("press", "start held while the air", "start chop=2000 @ always", "rest without air"),
    ("press", "broken wire of stop", "stop early=300 @ always", "unexpected start: "),
    ("press", "broken wire of the emergency", "emergency_stop early=1500 @ always", "emergency stop: "),
    ("work", "", "left.cup_pulse off @ start+100000 for 60000", "missed cups: "),
    ("work", "", "right.claws_open delay=400 @ start+100000 for 60000", "losses: "),
    ("rest", "emergency stop held", "left.slide_outward on @ emergency_stop+50000 for 100", "emergency stop: "),
    ("rest", "emergency stop released", "left.slide_outward on @ emergency_stop+50000 for 100", "unexpected start: "),
    ("rest", "emergency stop cleared", "start on @ emergency_stop+50000 for 200", "unexpected start: "),
    ("rest", "homed", "left.slide_outward on @ emergency_stop+60000 for 100", "unexpected start: "),
    ("press", "start while homing", "left.slide_outward on @ emergency_stop+28000 for 200", "unexpected start: "),
    ("press", "stop while homing", "tray_run,tray_forward on @ emergency_stop+12000", "rest after stop: not within"),
    ("rest", "after a fault", "left.slide_outward on @ stop+160000 for 100", "unexpected start: "),
    ("emergency stop at an edge", "cycle, 1500 ms", "emergency_stop off @ start+200 for 30000", "emergency stop: "),
    ("emergency stop at an edge", "left: slide_inward", "emergency_stop off @ cycle for 250", "emergency stop: "),
    ("wires", "start shorted to stop", "left.lift_extend on @ emergency_stop+500 for 200", "emergency stop: "),
    ("wires", "left.slide_outward welded", "left.lift_extend on @ emergency_stop+500 for 200", "emergency stop: "),
    ("power and link", "power returns in mid-cycle, start", "start chop=1500 @ always", "unexpected start: "),
    ("emergency stop at an edge", "homing, 100 ms", "emergency_stop off @ start for 400", "emergency stop: "),
    ("rest", "emergency stop held", "left.slide_outward early=100 @ cycle+50000 for 30000", "homing: "),
    ("work", "after an emergency", "left.cup_pulse off @ emergency_stop+130000 for 60000", "missed cups: "),
    ("work", "after a stop", "right.claws_open delay=400 @ stop+110000 for 50000", "dropped: "),
    ("power-up", "", "tray_run on @ power-up+50000 for 1000", "unexpected start: tray_run"),
    ("power-up", "", "left.slide_outward on @ rest+30000 for 200", "unexpected start: left.slide_outward"),
    ("cycle", "", "right.slide_at_feed on @ always", "24 seedlings picked and thrown: not within"),
    ("cycle", "", "left.cup_pulse drop=5 @ always", "24 seedlings picked and thrown: not within"),
    ("cycle", "", "tray_run off @ start", "24 seedlings picked and thrown: not within"),
    ("cycle", "", "left.claws_open delay=200 @ always", "dropped: "),
    ("cycle", "", "right.claws_close swap=right.claws_open @ always", "opposite outputs: "),
    ("trial", "", "right.slide_at_pick_2 delay=200 @ always", "arm_through_tray: "),
    ("trial", "", "tray_forward swap=tray_run @ always", "switching: tray_forward"),
    ("stop", "", "stop off @ always", "rest after stop: not within"),
]
"""Group, name, damage and reason: one damage that a case fails; only this case is run. With the named ones, these are
40 fixed pairs of a case and a damage."""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("group", "only", "damage", "reason"), KILLS, ids=[f"{group}: {name or damage}" for group, name, damage, _ in KILLS]
)
def test_a_case_fails_the_damage_that_is_written_for_it(group: str, only: str, damage: str, reason: str) -> None:
    results, *_ = judge_shimmed([damage], [group], only=only)
    assert results[-1].group == group, failures(results)
    assert any(each.startswith(reason) for each in results[-1].reasons), results[-1]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        ("", ""),
        ("horn off @ always", "horn after a press of start: not within"),
        ("horn delay=1500 @ always", "unexpected start: "),
        ("horn on @ start for 4000", "end of the first pulse of the horn: not within"),
        ("stop off @ start+900 for 500", "unexpected start: "),
    ],
)
def test_the_start_warning_passes_the_program_and_fails_one_that_moves_without_it(damage: str, reason: str) -> None:
    results, *_ = judge_shimmed([damage] if damage else [], ["press"], only="start warning", io_map=wired("horn"))
    (found,) = [each for each in results if each.name.startswith("start warning")]
    assert any(each.startswith(reason) for each in found.reasons) if damage else not found.reasons, found


@pytest.mark.parametrize(
    ("tags", "sides"),
    [((), []), (("left.claw_pressure",), []), (("left.cup_filled",), ["left"]), (YIELD, ["left", "right"])],
)
def test_rows_without_seedlings_are_a_case_of_an_arm_with_an_input_that_tells_them(
    tags: tuple[str, ...], sides: list[str]
) -> None:
    io_map, machine = wired(*tags), load_machine()
    bench = Bench(BenchModule(Plant(io_map, machine, seed=1, trays=1), io_map), machine)
    assert [case.name for case in yield_cases(bench)] == [f"{side} arm: a row without seedlings" for side in sides]


YIELD_DAMAGES = {
    "seedling_beam": [[], ["left.seedling_beam on @ always", "left.seedling_beam chop=40 @ always"]],
    "cup_filled": [[], ["left.cup_filled swap=left.cup_pulse @ always"]],
}
"""Damages by which a controller sees seedlings that are missing, by the only input that tells them; none at first."""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("tag", "damages"), [(tag, damages) for tag, both in YIELD_DAMAGES.items() for damages in both], ids=str
)
def test_a_controller_that_ignores_missing_seedlings_fails(tag: str, damages: list[str]) -> None:
    results, *_ = judge_shimmed(damages, ["fault"], only="without seedlings", io_map=wired(f"left.{tag}"))
    (found,) = [each for each in results if each.name == "left arm: a row without seedlings"]
    assert bool(found.reasons) == bool(damages), found
    assert not damages or found.reasons[0].startswith("missing seedlings: the machine goes on"), found


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["power", "link"])
def test_a_motion_by_the_return_of_power_or_link_fails(name: str) -> None:
    since_ms: list[int] = []

    def moves(bench: Bench, on: set[str]) -> set[str]:
        if bench.is_interrupted:
            since_ms[:] = [bench.now_ms]
        is_due = since_ms and 10_000 < bench.now_ms - since_ms[0] < 10_200
        return on | {"left.slide_outward"} if is_due else on

    results, _ = judge(["power and link"], only=f"{name} returns in mid-cycle", damage=moves)
    failed = failures(results)[f"power and link: {name} returns in mid-cycle"]
    assert any(each.startswith("unexpected start: left.slide_outward on") for each in failed), failed


@pytest.mark.nightly
def test_the_random_operator_passes_the_program_and_fails_a_damaged_one() -> None:
    results, _ = judge(random_s=1_000, trays=1_000 // SECONDS_PER_TRAY + TRAYS, reference=own_trial())
    assert (results[-1].group, results[-1].verdict) == (RANDOM, CaseVerdict.PASSED), results[-1].reasons

    def moves(bench: Bench, on: set[str]) -> set[str]:
        is_late = bench.now_ms > 320_000 and bench.forbidden == "before start was pressed"
        return on | {"tray_run"} if is_late else on

    results, _ = judge(random_s=60, damage=moves)
    assert any(each.startswith("unexpected start: tray_run") for each in results[-1].reasons)


@pytest.mark.weekly
def test_the_random_operator_passes_the_program_for_10_000_s() -> None:
    results, _ = judge(random_s=10_000, trays=10_000 // SECONDS_PER_TRAY + TRAYS, reference=own_trial())
    assert (results[-1].group, results[-1].verdict) == (RANDOM, CaseVerdict.PASSED), results[-1].reasons


def test_the_quantities_of_a_trial_have_limits() -> None:
    usual = TrialQuantities(8, 9, 80_000, {"left.spread": 5})
    assert not list(excesses(usual, usual))
    assert not list(excesses(TrialQuantities(16, 18, 100_000, {"left.spread": 13}), usual))
    worse = TrialQuantities(17, 19, 100_001, {"left.spread": 14, "tray_run": 4})
    assert dict(excesses(worse, usual)) == {
        "losses": "17 seedlings lost; 8 with the reference program, limit 16",
        "missed cups": "19 cups missed; 9 with the reference program, limit 18",
        "duration": "100.001 s; 80 s with the reference program, limit 100 s",
        "switching": "left.spread switched on 14 times; 5 with the reference program, limit 13",
    }


def _acts(text: str, tag: str, states: dict[int, bool]) -> list[int]:
    """Return the times at which an input is on behind a damage; `states` are its changes by time."""
    shim = Shim(parse(text, default_map()))
    on, found = False, []
    for now_ms in range(0, 1_000, 10):
        on = states.get(now_ms, on)
        levels = {point.tag: False for point in default_map().inputs} | {tag: on}
        shim.inputs(now_ms, levels)
        found += [now_ms] if levels[tag] else []
    return found


@pytest.mark.parametrize(
    ("change", "times_ms"),
    [
        ("on @ power-up+50 for 20", [50, 60, *range(100, 200, 10), *range(300, 400, 10)]),
        ("off @ always", []),
        ("delay=500 @ always", [*range(600, 700, 10), *range(800, 900, 10)]),
        ("chop=20 @ always", [n + d for n in (100, 140, 180, 300, 340, 380) for d in (0, 10)]),
        ("drop=2 @ always", [*range(100, 200, 10)]),
        ("early=30 @ always", [100, 110, 120, 300, 310, 320]),
        ("swap=stop @ always", []),
        ("off @ start+20 for 30", [100, 110, *range(150, 200, 10), 300, 310, *range(350, 400, 10)]),
    ],
)
def test_a_change_acts_as_the_grammar_states(change: str, times_ms: list[int]) -> None:
    presses = {100: True, 200: False, 300: True, 400: False}
    assert _acts(f"start {change}", "start", presses) == times_ms


@pytest.mark.parametrize(
    "text",
    [
        "start",
        "start on",
        "start,tray_run off @ always",
        "start delay @ always",
        "start on=3 @ always",
        "start on @ noon",
    ],
)
def test_a_text_outside_the_grammar_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"damage|inputs|unknown"):
        parse(text, default_map())


def test_drawn_damages_belong_to_the_grammar_and_reach_all_of_it() -> None:
    drawn = [parse(draw(seed, default_map()), default_map()) for seed in range(300)]
    assert {each.when for each in drawn} == set(WHENS)
    assert {each.change for each in drawn} == {"on", "off", "delay", "chop", "drop", "early", "swap"}
