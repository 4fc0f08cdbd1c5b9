"""Custom studies: the file, its design, the analysis of known responses, and one run on the twin."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from controller.common.document.parts import Heading, Picture, Table
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.machine.parameters import load_machine
from plant_sim.study.custom.file import load_custom_study, responses
from plant_sim.study.custom.study import custom_study
from plant_sim.study.errors import StudyError
from plant_sim.study.estimates import Estimate, estimate
from plant_sim.study.factors import FactorSetting
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial
from tests.paths import DOCS
from tests.plant_sim.study.figures import figures_of

EXAMPLE = DOCS / "examples/own-study.yaml"
MACHINE = load_machine()
FOAM, PRESSURE = "crop.foam_thickness_mm", "crop.claw_pressure_mpa"

GOOD = """\
name: foam-and-pressure
title: Foam and pressure
design: factorial
factors:
  crop.foam_thickness_mm: {levels: [8 mm, 1 cm, 12]}
  crop.claw_pressure_mpa: {low: 0.3, high: 5 bar}
replicates: 2
seedlings: 12
responses: [S, cycle_time_s]
model: interactions
"""


def written(tmp_path: Path, text: str) -> Path:
    """Write a study file and return its path."""
    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def edited(old: str, new: str) -> str:
    """Return the text of the valid study file with one replacement."""
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)


@cache
def some_report() -> TrialReport:
    """Return a trial report as a template."""
    return run_trial(seed=1, seedlings=12)


def report(**values: object) -> TrialReport:
    """Return a trial report with some fields replaced."""
    return replace(some_report(), **values)  # type: ignore[arg-type]


class Known(RunOptions):
    """Substitute for trials: the cycle time follows a known function with a known scatter."""

    __slots__ = ()

    @staticmethod
    def cycle_time_s(foam_mm: float, pressure_mpa: float) -> float:
        """Return the known cycle time for a setting, s."""
        return 8.0 + 0.5 * (foam_mm - 10) - 20.0 * (pressure_mpa - 0.4) + 10.0 * (foam_mm - 10) * (pressure_mpa - 0.4)

    def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
        """Return the reports for every setting; the scatter of the trials at a setting has a mean of 0."""
        scatter_s = np.linspace(-0.1, 0.1, self.trials)
        return [
            [
                report(
                    seedlings=self.seedlings,
                    in_cups=self.seedlings - 1,
                    cycle_time_s=self.cycle_time_s(setting.values[FOAM], setting.values[PRESSURE]) + float(error_s),
                )
                for error_s in scatter_s
            ]
            for setting in settings
        ]


def options(kind: type[RunOptions] = Known) -> RunOptions:
    """Return run options for a test."""
    return kind(trials=5, seed=9, workers=1, machine=MACHINE, io_map=load_io_map(DEFAULT_IO_MAP))


def table(study: Study, name: str) -> Table:
    """Return a table of a study by name."""
    return next(part for part in study.parts if isinstance(part, Table) and part.name == name)


def test_a_factorial_has_every_combination_in_the_units_of_the_parameters(tmp_path: Path) -> None:
    own = load_custom_study(written(tmp_path, GOOD), MACHINE)
    assert own.points.tolist() == [[8, 0.3], [10, 0.3], [12, 0.3], [8, 0.5], [10, 0.5], [12, 0.5]]
    assert np.allclose(own.coded, [[-1, -1], [0, -1], [1, -1], [-1, 1], [0, 1], [1, 1]])
    assert own.settings[3].values == {FOAM: 8.0, PRESSURE: 0.5}
    assert (own.replicates, own.seed, own.seedlings, own.model) == (2, 1, 12, "interactions")
    assert own.responses == ("S", "cycle_time_s")


def test_a_central_composite_reaches_beyond_low_and_high_by_its_axial_level(tmp_path: Path) -> None:
    text = edited("design: factorial", "design: central-composite\ncentres: 3").replace(
        "{levels: [8 mm, 1 cm, 12]}", "{centre: 12, step: 3.6}"
    )
    own = load_custom_study(written(tmp_path, text), MACHINE)
    assert len(own.points) == 4 + 4 + 3
    assert np.abs(own.coded).max() == pytest.approx(2**0.5)
    assert own.points[:, 0].max() == pytest.approx(12 + 3.6 * 2**0.5)
    own = load_custom_study(written(tmp_path, text + "axial: 1\n"), MACHINE)
    assert np.abs(own.coded).max() == pytest.approx(1.0)


def test_a_latin_hypercube_stays_between_low_and_high_and_follows_its_seed(tmp_path: Path) -> None:
    text = edited("design: factorial", "design: latin-hypercube\nruns: 20").replace(
        "{levels: [8 mm, 1 cm, 12]}", "{low: 8, high: 12}"
    )
    own = load_custom_study(written(tmp_path, text), MACHINE)
    again = load_custom_study(written(tmp_path, text), MACHINE)
    other = load_custom_study(written(tmp_path, text + "seed: 2\n"), MACHINE)
    assert own.points.shape == (20, 2)
    assert np.array_equal(own.points, again.points)
    assert not np.array_equal(own.points, other.points)
    assert 8 <= own.points[:, 0].min() < 8.2
    assert 11.8 < own.points[:, 0].max() <= 12


def test_set_points_are_rounded_to_integers_before_coding(tmp_path: Path) -> None:
    text = edited("design: factorial", "design: latin-hypercube\nruns: 9").replace(
        "crop.foam_thickness_mm: {levels: [8 mm, 1 cm, 12]}", "program.release_delay: {low: 50 ms, high: 180 ms}"
    )
    own = load_custom_study(written(tmp_path, text), MACHINE)
    steps = [setting.values["program.release_delay"] for setting in own.settings]
    assert steps == np.round(steps).tolist()
    assert own.points[:, 0].tolist() == [10 * step for step in steps]  # ms, the unit of the file
    assert np.allclose(own.coded[:, 0], (own.points[:, 0] - 115) / 65)
    heading = table(custom_study(own, options(RunsOnly)), "runs").heading
    assert heading[1] == "program.release_delay, ms"


def test_fixed_values_apply_to_every_run(tmp_path: Path) -> None:
    fixed = "fixed: {crop.seedling_age_d: 45 d, program.pause_at_feed: 0.3 s}\n"
    own = load_custom_study(written(tmp_path, GOOD + fixed), MACHINE)
    assert {setting.values["crop.seedling_age_d"] for setting in own.settings} == {45.0}
    assert {setting.set_points()["pause_at_feed"] for setting in own.settings} == {30}
    text = custom_study(own, options()).text()
    assert "Fixed in every run: crop.seedling_age_d = 45 d, program.pause_at_feed = 300 ms." in text


def test_every_numeric_field_of_a_trial_is_a_valid_response() -> None:
    assert {"S", "P", "D", "T", "missed_cups", "cycle_time_s", "simulated_s", "in_cups"} <= set(responses())
    assert not {"seed", "wall_s", "reason", "alarms", "cycle_times", "completed", "accounted"} & set(responses())
    for name in responses():
        assert isinstance(getattr(some_report(), name), int | float | None), name


BAD: list[tuple[str, int, str]] = [
    (
        edited("crop.foam_thickness_mm", "crop.foam_thicknes_mm"),
        5,
        "factors.crop.foam_thicknes_mm: unknown parameter of the machine; did you mean foam_thickness_mm?",
    ),
    (
        edited("crop.foam_thickness_mm", "program.relase_delay"),
        5,
        "factors.program.relase_delay: unknown set-point; did you mean release_delay?",
    ),
    (edited("12]", "31 mm]"), 5, "factors.crop.foam_thickness_mm: must be 0 to 30, not 31"),
    (
        edited("12]", "12 MPa]"),
        5,
        "factors.crop.foam_thickness_mm.levels: '12 MPa': MPa is a unit of another quantity; use m ",
    ),
    (edited("12]", "twelve]"), 5, "factors.crop.foam_thickness_mm.levels: 'twelve': not a number; "),
    (edited("12]", "10 mm]"), 5, "factors.crop.foam_thickness_mm.levels: contains a level twice; delete one"),
    (
        edited("{levels: [8 mm, 1 cm, 12]}", "{levels: [8 mm]}"),
        5,
        "factors.crop.foam_thickness_mm.levels: requires at least two levels",
    ),
    (
        edited("{levels: [8 mm, 1 cm, 12]}", "{levels: [{a: 8}, 9]}"),
        5,
        "factors.crop.foam_thickness_mm.levels[1]: must be a word or a number, not a mapping",
    ),
    (
        edited("{levels: [8 mm, 1 cm, 12]}", "{levels: [8, [9]]}"),
        5,
        "factors.crop.foam_thickness_mm.levels[2]: must be a word or a number, not a list",
    ),
    (
        edited("12]", "12, {}]"),
        5,
        "factors.crop.foam_thickness_mm.levels[4]: must be a word or a number, not a mapping",
    ),
    (
        edited("{levels: [8 mm, 1 cm, 12]}", "{level: [8 mm]}"),
        5,
        "factors.crop.foam_thickness_mm.level: unknown key; did you mean levels?",
    ),
    (edited("{levels: [8 mm, 1 cm, 12]}", "[8, 9]"), 5, "factors.crop.foam_thickness_mm: must be a mapping"),
    (edited("low: 0.3, ", ""), 6, "factors.crop.claw_pressure_mpa: must have {levels: [...]}, {low:, high:} or "),
    (edited("low: 0.3", "low: 0.6"), 6, "factors.crop.claw_pressure_mpa.low: must be below high"),
    (
        edited("{low: 0.3, high: 5 bar}", "{centre: 0.3, step: 0}"),
        6,
        "factors.crop.claw_pressure_mpa.step: must be more than 0",
    ),
    (
        edited("crop.claw_pressure_mpa", "crop.foam_thickness_mm"),
        6,
        "factors: key 'crop.foam_thickness_mm' is already defined on line 5; delete one",
    ),
    (GOOD + "model: linear\n", 11, "file: key 'model' is already defined on line 10; delete one"),
    (
        GOOD[: GOOD.index("factors:")] + "factors: {}\n" + GOOD[GOOD.index("replicates") :],
        4,
        "factors: is empty; specify at least one parameter or set-point with its levels",
    ),
    (GOOD[: GOOD.index("factors:")] + GOOD[GOOD.index("replicates") :], 1, "factors: is empty; "),
    (
        edited("[S, cycle_time_s]", "[S, cycle_times_s]"),
        9,
        "responses: unknown response 'cycle_times_s'; did you mean cycle_time_s?",
    ),
    (edited("[S, cycle_time_s]", "[S, S]"), 9, "responses: 'S' is duplicated; delete one"),
    (edited("[S, cycle_time_s]", "[S, {}]"), 9, "responses[2]: must be a word or a number, not a mapping"),
    (edited("[S, cycle_time_s]", "[]"), 9, "responses: is missing or empty; use some of "),
    (edited("[S, cycle_time_s]", "S"), 9, "responses: must be a list"),
    (edited("interactions", "cubic"), 10, "model: unknown model 'cubic'; use one of none, linear, "),
    (
        edited("interactions", "quadratic"),
        10,
        "model: quadratic cannot be fitted to this design: regression: the design cannot separate these terms: 1, X2^2",
    ),
    (
        edited("interactions", "quadratic").replace("replicates: 2", "replicates: 1"),
        10,
        "model: quadratic cannot be fitted to this design: regression: 6 runs for 6 coefficients",
    ),
    (edited("factorial", "factory"), 3, "design: unknown design 'factory'; did you mean factorial?"),
    (edited("factorial", "central-composite"), 5, "factors.crop.foam_thickness_mm: must have {low:, high:} or "),
    (
        edited("factorial", "central-composite").replace("{levels: [8 mm, 1 cm, 12]}", "{low: 0, high: 29}"),
        5,
        "factors.crop.foam_thickness_mm: must be 0 to 30, not -6.0061, an axial point; reduce the distance ",
    ),
    (edited("factorial", "factorial\nruns: 5"), 4, "runs: does not apply to design factorial; remove it"),
    (
        edited("factorial", "latin-hypercube").replace("{levels: [8 mm, 1 cm, 12]}", "{low: 8, high: 12}"),
        1,
        "runs: is missing; add it",
    ),
    (edited("name: foam-and-pressure", "name: ../foam"), 1, "name: must consist of lower-case words with hyphens"),
    (edited("title: Foam and pressure", "title: ''"), 2, "title: must not be empty"),
    (edited("replicates: 2", "replicates: 0"), 7, "replicates: must be an integer, 1 to 100000, not '0'"),
    (edited("replicates: 2", "replicates: 99999"), 7, "replicates: results in more than 100000 trials; reduce it"),
    (edited("seedlings: 12", "seedlings: 0"), 8, "seedlings: must be an integer, 1 to "),
    (edited("seedlings: 12", "sedlings: 12"), 8, "sedlings: unknown key; did you mean seedlings?"),
    (GOOD + "fixed: {crop.foam_thickness_mm: 9}\n", 11, "fixed.crop.foam_thickness_mm: is also a factor; delete one"),
    (
        GOOD + "fixed: {crop.seedling_age_d: 9 mm}\n",
        11,
        "fixed.crop.seedling_age_d: '9 mm': mm is a unit of another quantity",
    ),
    (GOOD + "fixed: {crop.seedling_age_d: 300}\n", 11, "fixed.crop.seedling_age_d: must be 1 to 200"),
    (
        GOOD + "fixed: {program.clamp: 2 s, handling.cell_pitch_m: 50 mm}\n",
        4,
        "factors: spreader.travel_m: spreads the claws to 0.067 m; it must equal cups.pitch_m to 1 mm (with ",
    ),
    (
        GOOD + "fixed: {program.clamp: 20 s}\n",
        11,
        "fixed.program.clamp: must be 100 to 2000 ms in steps of 10 ms, not 20000 ms",
    ),
    (GOOD + "fixed: {program.no_cups: 20 ms}\n", 11, "fixed.program.no_cups: must be "),
    (GOOD + "fixed: {program.trays_target: 4}\n", 11, "fixed.program.trays_target: is derived from the number of"),
    ("", 1, "file: is empty; write the required sections"),
    ("- a\n", 1, "file: does not begin with a section"),
    ("name: [\n", 2, "file: is not YAML"),
]


@pytest.mark.parametrize(("text", "line", "complaint"), BAD, ids=[case[2][:50] for case in BAD])
def test_an_invalid_file_is_rejected_with_line_key_and_remedy(
    tmp_path: Path, text: str, line: int, complaint: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(StudyError) as refusal:
        load_custom_study(path, MACHINE)
    message = str(refusal.value)
    assert message.startswith(f"{path}:{line}: {complaint}")
    assert "\n" not in message


def test_trials_and_seed_of_the_command_line_are_validated_like_those_of_the_file(tmp_path: Path) -> None:
    """One trial per point leaves no degrees of freedom for the error; this is reported before the first trial."""
    text = edited("levels: [8 mm, 1 cm, 12]", "levels: [8 mm, 12 mm]")
    path = written(tmp_path, text)
    assert load_custom_study(path, MACHINE).replicates == 2
    assert (
        load_custom_study(path, MACHINE, trials=3, seed=0).replicates,
        load_custom_study(path, MACHINE, seed=0).seed,
    ) == (
        3,
        0,
    )
    with pytest.raises(StudyError, match=r":10: model: interactions cannot be fitted .* 4 runs for 4 coefficients"):
        load_custom_study(path, MACHINE, trials=1)
    with pytest.raises(StudyError, match=r"^--trials 99999: results in more than 100000 trials; reduce it$"):
        load_custom_study(path, MACHINE, trials=99_999)


def test_dependent_parameters_can_only_be_changed_together(tmp_path: Path) -> None:
    """The pitch of the claws must match the pitch of the cups."""
    text = edited("crop.claw_pressure_mpa: {low: 0.3, high: 5 bar}", "crop.seedling_age_d: {low: 45, high: 55}")
    text += "fixed: {handling.cell_pitch_m: 42 mm, spreader.travel_m: 198 mm}\n"
    own = load_custom_study(written(tmp_path, text), MACHINE)
    assert own.settings[0].machine(MACHINE).handling.cell_pitch_m == 0.042


TIED = GOOD.replace(
    "crop.claw_pressure_mpa: {low: 0.3, high: 5 bar}", "handling.cell_pitch_m: {low: 41 mm, high: 43 mm}"
)
TRAVEL = "tied:\n  spreader.travel_m: {to: handling.cell_pitch_m, low: 209 mm, high: 187 mm}\n"
"""The eleven gaps of twelve claws spread by the travel, so that their pitch is that of the cups, 60 mm."""


def test_a_tied_parameter_changes_with_its_factor(tmp_path: Path) -> None:
    own = load_custom_study(written(tmp_path, TIED + TRAVEL), MACHINE)
    pairs = {(each.values["handling.cell_pitch_m"], each.values["spreader.travel_m"]) for each in own.settings}
    assert np.array(sorted(pairs)) == pytest.approx(np.array([[0.041, 0.209], [0.043, 0.187]]))
    text = custom_study(own, options(RunsOnly)).text()
    assert "Tied: spreader.travel_m changes with handling.cell_pitch_m, from 0.209 to 0.187 m." in text
    with pytest.raises(StudyError, match=r"spreader.travel_m: spreads the claws to"):
        load_custom_study(written(tmp_path, TIED), MACHINE)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("to: handling.cell_pitch_m", "to: handling.cell_pitch"), "tied.spreader.travel_m.to: unknown factor"),
        ((", high: 187 mm", ""), "tied.spreader.travel_m: must have {to:, low:, high:}"),
        (
            ("spreader.travel_m:", "crop.foam_thickness_mm:"),
            "tied.crop.foam_thickness_mm: is also a factor; delete one",
        ),
        (("high: 187 mm", "high: 187 s"), "tied.spreader.travel_m.high: '187 s': s is a unit of another quantity"),
        (("spreader.travel_m:", "spreader.travl_m:"), "tied.spreader.travl_m: unknown parameter of the machine"),
    ],
)
def test_an_invalid_tie_is_rejected_with_its_line(tmp_path: Path, change: tuple[str, str], complaint: str) -> None:
    path = written(tmp_path, TIED + TRAVEL.replace(*change))
    with pytest.raises(StudyError) as refusal:
        load_custom_study(path, MACHINE)
    assert str(refusal.value).startswith(f"{path}:12: {complaint}")


def test_percentages_are_pooled_and_get_the_exact_binomial_interval() -> None:
    """The Clopper-Pearson interval for 130 and 140 of 144 equals that from quantiles of the beta distribution."""
    found = estimate("S", [report(in_cups=130, seedlings=144), report(in_cups=140, seedlings=144)])
    assert found.mean == pytest.approx(100 * 270 / 288)
    assert found.low == pytest.approx(100 * stats.beta.ppf(0.025, 270, 19))
    assert found.high == pytest.approx(100 * stats.beta.ppf(0.975, 271, 18))
    every = estimate("S", [report(in_cups=144, seedlings=144)])
    assert (every.mean, every.high) == (100.0, 100.0)
    assert every.low == pytest.approx(100 * 0.025 ** (1 / 144))


@pytest.mark.parametrize(("count", "share"), [("in_cups", "S"), ("P", "F_p"), ("D", "F_d"), ("T", "F_t")])
def test_a_number_of_seedlings_has_the_interval_of_its_share(count: str, share: str) -> None:
    """The interval of the share is multiplied by the number of seedlings per trial.

    For 3 and 5 seedlings, Student's t distribution would give ± 12.7.
    """
    trials = [report(**{count: 3}, seedlings=144), report(**{count: 5}, seedlings=144)]
    found, part = estimate(count, trials), estimate(share, trials)
    assert found.mean == pytest.approx(4.0)
    assert found.low == pytest.approx(144 * stats.beta.ppf(0.025, 8, 281))
    assert found.high == pytest.approx(144 * stats.beta.ppf(0.975, 9, 280))
    assert [found.mean, found.low, found.high] == pytest.approx(
        [1.44 * (part.mean or 0), 1.44 * (part.low or 0), 1.44 * (part.high or 0)]
    )
    assert found.sd == pytest.approx(2**0.5)
    none = estimate(count, [report(**{count: 0}, seedlings=144)] * 2)
    assert (none.mean, none.low, none.sd) == (0.0, 0.0, 0.0)
    assert none.high == pytest.approx(144 * (1 - 0.025 ** (1 / 288)))


def test_other_means_have_the_student_interval_if_the_trials_differ() -> None:
    trials = [report(cycle_time_s=value) for value in (8.0, 8.3, 8.9)]
    found = estimate("cycle_time_s", trials)
    sd = np.std([8.0, 8.3, 8.9], ddof=1)
    half = stats.t.ppf(0.975, 2) * sd / 3**0.5
    assert (found.mean, found.sd) == pytest.approx((8.4, sd))
    assert [found.low, found.high] == pytest.approx([8.4 - half, 8.4 + half])
    assert estimate("cycle_time_s", trials[:1]) == Estimate(8.0)
    assert estimate("missed_cups", [report(missed_cups=3)] * 2) == Estimate(3.0, sd=0.0)
    assert estimate("air_l_min", [report(air_l_min=None)] * 2) == Estimate(None)


def test_the_scatter_between_trials_is_listed_beside_the_pooled_values(tmp_path: Path) -> None:
    """The report states whether binomial intervals are allowed if a response counts seedlings."""
    own = load_custom_study(written(tmp_path, edited("[S, cycle_time_s]", "[S, missed_cups]")), MACHINE)
    study = custom_study(own, options())
    heading, (run, _, low, high, sd) = table(study, "s-intervals").heading, table(study, "s-intervals").rows[0]
    assert heading == ("run", "mean", "low", "high", "SD between trials")
    assert (run, sd) == (1, 0.0)
    assert None not in (low, high)
    assert table(study, "missed-cups-intervals").shown()[0][2:4] == ("-", "-")
    assert "Binomial intervals: allowed (scatter between equal trials" in study.text()
    uncounted = load_custom_study(written(tmp_path, edited("[S, cycle_time_s]", "[missed_cups]")), MACHINE)
    assert "seedling to fail by itself" not in custom_study(uncounted, options()).text()


def test_the_model_recovers_the_known_function(tmp_path: Path) -> None:
    """The coded coefficients are those of the known function; the error consists only of the scatter of the trials."""
    study = custom_study(load_custom_study(written(tmp_path, GOOD), MACHINE), options())
    record = json.loads(study.json())
    model = record["models"]["cycle_time_s"]
    values = {term: each["value"] for term, each in model["coefficients"].items()}
    assert values == pytest.approx({"1": 8.0, "X1": 1.0, "X2": -2.0, "X1 X2": 2.0})
    assert model["anova"]["pure error"]["sum_of_squares"] == pytest.approx(6 * 2 * 0.1**2)
    assert model["anova"]["lack of fit"]["sum_of_squares"] == pytest.approx(0.0, abs=1e-9)
    assert table(study, "runs").rows[5][:3] == (6, 12, 0.5)
    assert table(study, "runs").rows[5][4] == pytest.approx(8 + 1 - 2 + 2)
    assert table(study, "factors").rows == (("X1", FOAM, "mm", 8, 12), ("X2", PRESSURE, "MPa", 0.3, 0.5))
    assert [len(run["trials"]) for run in record["runs"]] == [2] * 6
    assert record["runs"][3]["setting"] == {FOAM: 8.0, PRESSURE: 0.5}


class Losing(RunOptions):
    """Substitute for trials: binomial numbers of seedlings are lost in picking, more with thick foam."""

    __slots__ = ()

    def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
        """Return the reports for every setting."""
        chance = np.random.default_rng(3)
        reports = []
        for setting in settings:
            lost = chance.binomial(144, 0.05 + 0.02 * (setting.values[FOAM] - 8), size=self.trials)
            reports.append([self.of(int(each)) for each in lost])
        return reports

    @staticmethod
    def of(lost: int) -> TrialReport:
        """Return a report of 144 seedlings, some of them lost in picking."""
        percent = 100 * lost / 144
        return report(seedlings=144, in_cups=144 - lost, P=lost, D=0, S=100 - percent, F_p=percent, F_d=0.0)


def test_rates_are_fitted_to_the_counts_of_the_trials_without_p_values(tmp_path: Path) -> None:
    """Success with the identity link, losses with the logit; the repeated trials of six points give the error."""
    text = edited("[S, cycle_time_s]", "[S, F_p, F_d]").replace("replicates: 2", "replicates: 4")
    study = custom_study(load_custom_study(written(tmp_path, text), MACHINE), options(Losing))
    models = json.loads(study.json())["models"]
    assert {name: model["link"] for name, model in models.items()} == {"S": "identity", "F_p": "logit"}
    assert models["S"]["dispersion"]["degrees"] == models["F_p"]["dispersion"]["degrees"] == 6 * 3
    effects = table(study, "f-p-coefficients")
    assert effects.heading == ("term", "estimate", "Monte Carlo error", "95 % interval: from", "to")
    assert effects.caption.endswith("; coefficients in logits")
    name, value, _, low, high = effects.rows[1]
    assert (name, value) == ("X1", models["F_p"]["coefficients"]["X1"]["value"])
    assert isinstance(low, float)
    assert isinstance(high, float)
    assert 0 < low < 0.5 * np.log(0.13 / 0.87 / (0.05 / 0.95)) < high
    assert not any(part.heading[-1] == "P" for part in study.parts if isinstance(part, Table))
    assert "in every trial: no model is fitted" in study.text()


def test_what_was_fitted_and_a_changed_machine_are_on_the_first_page(tmp_path: Path) -> None:
    changed = replace(options(), machine=MACHINE.with_values({"seedling.adhesion_n": 2.0}))
    study = custom_study(load_custom_study(written(tmp_path, GOOD), MACHINE), changed)
    before = [str(part) for part in study.parts[: study.parts.index(Heading("Runs"))]]
    assert any(part.startswith("Changed machine: seedling.adhesion_n differ") for part in before)
    assert any(part.startswith("What was fitted to what") for part in before)
    assert json.loads(study.json())["changed_parameters"] == ["seedling.adhesion_n"]


def test_a_constant_response_is_reported_and_not_fitted(tmp_path: Path) -> None:
    study = custom_study(load_custom_study(written(tmp_path, GOOD), MACHINE), options())
    assert "S is " in study.text()
    assert "in every trial: no model is fitted" in study.text()
    assert "S" not in json.loads(study.json())["models"]
    assert "s-coefficients" not in [part.name for part in study.parts if isinstance(part, Table)]


@pytest.mark.parametrize(
    ("change", "pictures", "line"),
    [
        (lambda text: text, ["s-main-effects", "cycle-time-s-main-effects"], "joins the means at the levels"),
        (
            lambda text: text.replace("interactions", "none"),
            ["s-main-effects", "cycle-time-s-main-effects"],
            "joins the means at the levels",
        ),
        (
            lambda text: (
                text.replace("factorial", "latin-hypercube\nruns: 12")
                .replace("{levels: [8 mm, 1 cm, 12]}", "{low: 8, high: 12}")
                .replace("interactions", "quadratic")
            ),
            ["s-main-effects", "cycle-time-s-contours", "cycle-time-s-main-effects"],
            "the line is the model with the other factors at coded 0",
        ),
    ],
    ids=["factorial", "without a model", "latin hypercube, quadratic"],
)
def test_the_plots_match_the_design_and_the_model(
    tmp_path: Path, change: Callable[[str], str], pictures: list[str], line: str
) -> None:
    study = custom_study(load_custom_study(written(tmp_path, change(GOOD)), MACHINE), options())
    assert [part.name for part in study.parts if isinstance(part, Picture)] == pictures
    assert line in study.text()
    if "cycle-time-s-contours" not in pictures:
        effects = next(figure for name, figure in figures_of(study).items() if name.startswith("cycle"))
        drawn = effects.axes[1].lines[-1].get_ydata()
        assert np.asarray(drawn) == pytest.approx([10.0, 6.0])  # mean over foam at 0.3 and 0.5 MPa


class Troubled(Known):
    """Substitute for trials: one does not complete, and some are outside the range of the paper."""

    __slots__ = ()

    def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
        """Return the reports of every setting."""
        reports = super().run(settings)
        reports[2][1] = replace(reports[2][1], reason="COMPLETE not reached within 600000 ms")
        reports[4][0] = replace(reports[4][0], extrapolates=True)
        return reports


def test_limitations_are_reported_before_the_figures(tmp_path: Path) -> None:
    text = edited("high: 5 bar", "high: 6.5 bar")
    study = custom_study(load_custom_study(written(tmp_path, text), MACHINE), options(Troubled))
    before = study.parts[: study.parts.index(Heading("Runs"))]
    text = "\n".join(part for part in before if isinstance(part, str))
    assert "Outside the manufacturer's rating: crop.claw_pressure_mpa: 0.65 MPa" in text
    assert "Outside the range tested in the pepper paper; the behaviour of seedlings is extrapolated: run 5." in text
    assert (
        "1 of 12 trials did not complete; they are included with their final counts. run 3: COMPLETE not reached"
        in text
    )


class RunsOnly(RunOptions):
    """Substitute for trials: all have identical results."""

    __slots__ = ()

    def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
        """Return the reports of every setting."""
        return [[some_report()] * self.trials for _ in settings]


class Chance(RunOptions):
    """Substitute for trials: the results have a large scatter that is independent of the setting."""

    __slots__ = ()

    def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
        """Return the reports of every setting."""
        chance = np.random.default_rng(7)
        return [[report(cycle_time_s=float(chance.normal(9.0))) for _ in range(self.trials)] for _ in settings]


def test_a_model_without_significance_is_reported_first_and_has_no_surface(tmp_path: Path) -> None:
    """The contours and the line in the main-effects plots are omitted."""
    text = (
        edited("factorial", "latin-hypercube\nruns: 12")
        .replace("{levels: [8 mm, 1 cm, 12]}", "{low: 8, high: 12}")
        .replace("interactions", "quadratic")
        .replace("[S, cycle_time_s]", "[cycle_time_s]")
    )
    study = custom_study(load_custom_study(written(tmp_path, text), MACHINE), options(Chance))
    before = study.parts[: study.parts.index(Heading("Runs"))]
    assert any(str(part).startswith("cycle_time_s: the effects do not exceed the Monte Carlo error") for part in before)
    ((name, figure),) = figures_of(study).items()
    assert name == "cycle-time-s-main-effects"
    assert len(figure.axes[0].lines) == 1, "the points, and no curve"
    assert "cycle-time-s-coefficients" in [part.name for part in study.parts if isinstance(part, Table)]


def test_the_plural_is_used_for_several_runs_outside_the_range(tmp_path: Path) -> None:
    class Outside(Known):
        __slots__ = ()

        def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
            reports = super().run(settings)
            for run in (1, 3):
                reports[run][0] = replace(reports[run][0], extrapolates=True)
            return reports

    study = custom_study(load_custom_study(written(tmp_path, GOOD), MACHINE), options(Outside))
    assert "the behaviour of seedlings is extrapolated: runs 2, 4." in study.text()


def test_counts_have_a_unit(tmp_path: Path) -> None:
    own = load_custom_study(written(tmp_path, edited("[S, cycle_time_s]", "[T, missed_cups]")), MACHINE)
    assert table(custom_study(own, options()), "runs").heading[3:] == (
        "T, seedlings per trial",
        "missed_cups, cups per trial",
    )


def test_a_small_study_runs_on_the_twin(tmp_path: Path) -> None:
    """In real trials, an arm waits longer for cups at half the planting frequency."""
    text = edited(
        "crop.claw_pressure_mpa: {low: 0.3, high: 5 bar}", "cups.planting_frequency_per_min: {low: 30, high: 1 /s}"
    )
    own = load_custom_study(written(tmp_path, text), MACHINE, trials=1)
    record = json.loads(custom_study(own, options(RunOptions)).json())
    assert [run["setting"]["cups.planting_frequency_per_min"] for run in record["runs"]] == [30, 30, 30, 60, 60, 60]
    assert all(trial["completed"] for run in record["runs"] for trial in run["trials"])
    cycles_s = [run["estimates"]["cycle_time_s"]["mean"] for run in record["runs"]]
    assert min(cycles_s[:3]) > max(cycles_s[3:])
    assert record["seedlings"] == 12


def test_the_documented_example_can_be_run() -> None:
    own = load_custom_study(EXAMPLE, MACHINE)
    assert (own.name, own.design, own.model) == ("foam-and-pressure", "central-composite", "quadratic")
    assert own.settings[1].values == {"crop.seedling_age_d": 50.0, FOAM: 15.6, PRESSURE: pytest.approx(0.32)}
