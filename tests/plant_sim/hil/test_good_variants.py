"""The bench passes good controllers that differ from the machine's own program."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import repeat
from typing import NamedTuple

import pytest

from plant_sim.hil.selection import FIRST_GROUPS, PRESS
from plant_sim.twin.lock_step import SCAN_MS
from tests.plant_sim.hil.exported import Scan, fx_engine, judge_export, package
from tests.plant_sim.hil.hil_rig import default_map, failures, judge_shimmed
from tests.wiring import wired

GROUPS = (*FIRST_GROUPS, PRESS)
"""Groups for the variants that change presses or the time of a scan."""


def _jitter(base_ms: int, most_ms: int) -> Iterator[int]:
    chance = random.Random(base_ms)
    while True:
        yield base_ms + chance.randint(0, most_ms)


class Good(NamedTuple):
    """A good variant: differences from the own program on the delivered machine."""

    damages: tuple[str, ...] = ()
    periods_ms: Iterable[int] = repeat(SCAN_MS)
    set_points: Mapping[str, int] = {}
    slide_share: float = 1.0
    groups: tuple[str, ...] = FIRST_GROUPS


_ALL_INPUTS = ",".join(each.tag for each in default_map().inputs)
_ALL_OUTPUTS = ",".join(each.tag for each in default_map().outputs)
GOOD = {
    "scan of 5 ms": Good(periods_ms=repeat(5)),
    "scan of 5 to 8 ms": Good(periods_ms=_jitter(5, 3), groups=GROUPS),
    "scan of 8 to 12 ms": Good(periods_ms=_jitter(8, 4)),
    "slides 10 % slower": Good(slide_share=0.9),
    "every input 10 ms later": Good((f"{_ALL_INPUTS} delay=10 @ always",)),
    "every output 10 ms later": Good((f"{_ALL_OUTPUTS} delay=10 @ always",)),
    "clears while stop is held for 3.1 s": Good(("stop off @ stop+3100 for 60",), groups=GROUPS),
    "converges above the cups": Good(set_points={"converge_at": 1}),
    "waits above the cups": Good(set_points={"descend_at_count": 6}),
    "opens the claws for longer": Good(set_points={"release": 30}),
    "waits longer at feed": Good(set_points={"pause_at_feed": 80}),
}


@pytest.mark.nightly
@pytest.mark.parametrize("name", GOOD)
def test_a_good_variant_passes(name: str) -> None:
    good = GOOD[name]
    results, *_ = judge_shimmed(
        good.damages,
        good.groups,
        periods_ms=good.periods_ms,
        set_points=good.set_points,
        slide_share=good.slide_share,
    )
    assert not failures(results)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2, 12))
def test_another_seed_passes_the_first_cases(seed: int) -> None:
    results, *_ = judge_shimmed([], FIRST_GROUPS, seed=seed)
    assert not failures(results)


@pytest.mark.nightly
@pytest.mark.parametrize("export", [fx_engine, lambda: package("openplc"), lambda: package("codesys")])
def test_an_export_passes(export: Callable[[], Scan]) -> None:
    assert not failures(judge_export(export(), GROUPS))


@pytest.mark.nightly
def test_a_machine_with_a_start_warning_passes() -> None:
    results, *_ = judge_shimmed([], GROUPS, io_map=wired("horn"))
    assert not failures(results)


@pytest.mark.nightly
def test_scans_of_8_to_12_ms_pass_the_first_cases() -> None:
    results, *_ = judge_shimmed([], FIRST_GROUPS, periods_ms=_jitter(8, 4))
    assert [each.group for each in results] == list(FIRST_GROUPS)
    assert not failures(results)
