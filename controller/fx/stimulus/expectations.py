"""Expectations of a stimulus file: which of them a run has not met."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from controller.fx.stimulus.running import TIME
from controller.fx.stimulus.stimulus import ExpectedValues, Stimulus, Values

Record = Mapping[str, int]
"""Time of a scan in ms and the values of the watched devices, as `run` returns them."""


def with_expected(stimulus: Stimulus) -> Stimulus:
    """Return a stimulus that also watches the devices of its expectations."""
    expected = (device for each in stimulus.expect for device in each.values)
    return replace(stimulus, watch=tuple(dict.fromkeys((*stimulus.watch, *expected))))


def unmet(expectations: Iterable[ExpectedValues], records: Sequence[Record]) -> list[str]:
    """Return one line for each expectation that a run has not met, with file, line, time and value.

    Args:
        expectations: Expectations of the stimulus.
        records: Records of the run of a stimulus `with_expected` devices.
    """
    return [f"{each.where}: {reason}" for each in expectations if (reason := _reason(each, records)) is not None]


def _reason(expectation: ExpectedValues, records: Sequence[Record]) -> str | None:
    """Return why an expectation is not met; None if it is."""
    from_ms, to_ms = expectation.from_ms, expectation.to_ms
    before = bisect_right(records, from_ms, key=lambda record: record[TIME])
    # the values at a time are those of the last scan until then
    scans = records[max(0, before - 1) : bisect_right(records, to_ms, key=lambda record: record[TIME])]
    wrong = [_differences(expectation.values, record) for record in scans]
    if not expectation.once:
        return next((f"at {record[TIME]} ms {text}" for record, text in zip(scans, wrong, strict=True) if text), None)
    if not all(wrong):
        return None
    return f"from {from_ms} to {to_ms} ms no scan has {', '.join(f'{d} = {v}' for d, v in expectation.values.items())}"


def _differences(values: Values, record: Record) -> str:
    """Return which devices differ from their expected values; empty if none does."""
    wrong = {device: value for device, value in values.items() if record[str(device)] != value}
    return ", ".join(f"{device} is {record[str(device)]}, must be {value}" for device, value in wrong.items())
