"""JSON record of the throughput study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from controller.program.tags import ROWS, SIDES
from plant_sim.study.estimates import IntervalBasis, estimate
from plant_sim.study.runner import trial_record
from plant_sim.study.throughput.bottleneck import Bottleneck
from plant_sim.study.throughput.driving import FrequencyResult, ThroughputResult, ground_speed_km_h
from plant_sim.study.throughput.gains import MotionGain
from plant_sim.study.throughput.pace import TRAYS, CyclePace
from plant_sim.study.throughput.scan import ConditionScan


def record_of(result: ThroughputResult, bottlenecks: Sequence[Bottleneck], basis: IntervalBasis) -> dict[str, object]:
    """Return the JSON record of the study."""
    limits, advice, spacing_m = result.limits, result.advice, result.spacing_m
    return {
        "spacing_m": spacing_m,
        "intervals": basis.record(),
        "points": [_point_record(point, result.paces, basis) for point in result.points],
        "observed": [
            {"set": dict(run.setting.values), "trays": TRAYS, "seed": run.seed, "reason": run.reason}
            for pace in result.paces.values()
            for run in pace.runs
        ],
        "scan": [_scan_record(each) for each in result.results.values()],
        "limits_per_min": {
            "without_gap": _condition_record(limits.without_gap),
            "settled": _condition_record(limits.settled),
            **{f"row {row}": _condition_record(scan) for row, scan in limits.by_row.items()},
        },
        "gains": [_gain_record(each) for each in result.gains],
        "advice": None
        if advice is None
        else {
            name: {
                "ground_speed_km_h": ground_speed_km_h(point.frequency_per_min, spacing_m),
                "least_waiting_s": point.least_wait_s,
                **_scan_record(point),
            }
            for name, point in (("highest", advice.highest), ("with_margin", advice.with_margin))
        },
        "bottlenecks": {each.name: each.record() for each in bottlenecks},
    }


def _condition_record(scan: ConditionScan) -> dict[str, object]:
    return {"limit": scan.limit, "first_failure": scan.first_failure, "met_again": scan.met_again}


def _gain_record(gain: MotionGain) -> dict[str, object]:
    return {
        "motion": gain.motion.name,
        "parameter": gain.motion.parameter,
        "value": gain.value,
        "base_s": gain.base_s,
        "changed_s": gain.changed_s,
        "margin_s": gain.margin_s,
        "scanned_per_min": [min(gain.scan.met), max(gain.scan.met)],
        "limit_per_min": gain.scan.limit,
        "gain_per_min": gain.gain_per_min,
        "interval_per_min": gain.interval_per_min,
        "differences_per_min": gain.differences_per_min,
    }


def _scan_record(point: FrequencyResult) -> dict[str, object]:
    return {
        "frequency_per_min": point.frequency_per_min,
        "set": dict(point.setting.values),
        "gaps": point.gaps,
        "trials": [trial_record(trial) for trial in point.trials],
    }


def _point_record(point: FrequencyResult, paces: Mapping[int, CyclePace], basis: IntervalBasis) -> dict[str, object]:
    success = estimate("S", point.trials, is_binomial=basis.is_binomial)
    return {
        "frequency_per_min": point.frequency_per_min,
        "set": dict(point.setting.values),
        "S": success.mean,
        "S_low": success.low,
        "S_high": success.high,
        "S_sd": success.sd,
        "missed_cups": point.mean("missed_cups"),
        "missed_cups_a_settled_tray": paces[point.frequency_per_min].settled_missed_cups,
        "cycle_time_s": point.mean("cycle_time_s"),
        "air_l_min": point.air_l_min,
        "air_l_per_seedling": point.air_l_per_seedling,
        "waiting_s": {f"{side} row {row}": point.waiting_s(side, row) for side in SIDES for row in ROWS},
        "least_margin_s": {f"row {row}": paces[point.frequency_per_min].least_margin_s(row) for row in ROWS},
        "trials": [trial_record(trial) for trial in point.trials],
    }
