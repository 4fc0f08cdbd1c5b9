"""Score of the bench: damages drawn by seed, and the class of each.

``python -m tests.plant_sim.hil.score --first 1000 --count 200 [--out FILE]`` runs the bench on each damage in lock step
until the first failure, prints one line for each, and the number of each class at the end or if it is interrupted.
Results are appended to a file of JSON lines; seeds that the file already contains are not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Final

from plant_sim.hil.bench_run import CaseVerdict
from plant_sim.hil.selection import GROUPS
from plant_sim.hil.trace import Levels
from tests.paths import ROOT
from tests.plant_sim.hil.drawn import draw
from tests.plant_sim.hil.hil_rig import default_map, judge_shimmed

FAILED, NEVER_ACTED, HARMLESS, ESCAPED = "failed", "never acted", "harmless", "escaped"
"""Classes: a case failed; no wire was changed; every output is as without, or a reason is stated; all others."""
CLASSES: Final = (FAILED, NEVER_ACTED, HARMLESS, ESCAPED)
SAME_OUTPUTS: Final = "every output is the same in every scan as without the damage"
RANDOM_S: Final = 1_000
"""Time for which the random operator acts after all cases, s."""
SHOWN_HARMLESS: Final[Mapping[str, str]] = {
    "right.lift_up early=100 @ stop+0 for 1000": "the slide of an arm that finishes its row after a stop waits for the "
    "upper switch of the lift for 0.9 s at most; then the row is thrown",
    "left.lift_up off @ random+500 for 50": "an arm on its way stops for 50 ms; a loaded arm at rest no longer counts "
    "as up, and start is refused until the machine has been stopped and homed",
    "start chop=20 @ random+50000 for 200": "a press of start bounces for 0.2 s at most; the presses after the first "
    "one find a machine that homes or works, and have no effect",
}
"""Reasons why damages that no case fails do no harm and break no requirement, by their texts."""
DEFAULT_OUT: Final = ROOT / "var/bench-score.jsonl"


@dataclass(frozen=True, slots=True)
class Scored:
    """One drawn damage and its class.

    Attributes:
        seed: Seed.
        damage: Text of the damage.
        verdict: One of `CLASSES`.
        case: Group and name of the failed case; empty if none failed.
        reason: First reason of the failure, or why the damage is harmless.
    """

    seed: int
    damage: str
    verdict: str
    case: str = ""
    reason: str = ""

    @property
    def line(self) -> str:
        """One line of text."""
        because = "; ".join(filter(None, (self.case, self.reason)))
        return f"{self.seed} {self.verdict}: {self.damage}" + (f" ({because})" if because else "")


def score(seed: int, groups: tuple[str, ...] = GROUPS) -> Scored:
    """Judge the damage of a seed with groups of cases and the random operator."""
    damage = draw(seed, default_map())
    results, bench, (shim,) = judge_shimmed([damage], groups, random_s=RANDOM_S)
    last = results[-1]
    if last.verdict is CaseVerdict.FAILED:
        return Scored(seed, damage, FAILED, f"{last.group}: {last.name}", last.reasons[0])
    if not shim.changed_scans:
        return Scored(seed, damage, NEVER_ACTED)
    if bench.trace.entries == _undamaged(groups):
        return Scored(seed, damage, HARMLESS, reason=SAME_OUTPUTS)
    if reason := SHOWN_HARMLESS.get(damage):
        return Scored(seed, damage, HARMLESS, reason=reason)
    return Scored(seed, damage, ESCAPED)


@cache
def _undamaged(groups: tuple[str, ...]) -> list[Levels]:
    """Return the levels of all wires in the same run without a damage."""
    _, bench, _ = judge_shimmed([], groups, random_s=RANDOM_S)
    return bench.trace.entries


def read(path: Path) -> list[Scored]:
    """Return the results of a file; none if it does not exist."""
    return [Scored(**json.loads(line)) for line in path.read_text().splitlines()] if path.exists() else []


def summary(scored: Iterable[Scored]) -> str:
    """Return the number of each class."""
    numbers = Counter(each.verdict for each in scored)
    return f"{numbers.total()} damages: " + ", ".join(f"{numbers[name]} {name}" for name in CLASSES)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--first", type=int, default=1_000, help="first seed")
    options.add_argument("--count", type=int, default=200, help="number of seeds")
    options.add_argument("--cases", action="append", choices=GROUPS, metavar="GROUP", help="as of 'hil' (default: all)")
    options.add_argument("--out", type=Path, default=DEFAULT_OUT, help="file of results")
    return options


def main(arguments: Sequence[str]) -> int:
    """Score the seeds that the file does not contain, and print the classes of all."""
    options = parser().parse_args(arguments)
    seeds = range(options.first, options.first + options.count)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    scored = {each.seed: each for each in read(options.out)}
    with suppress(KeyboardInterrupt), options.out.open("a") as file:
        for seed in seeds:
            if seed not in scored:
                scored[seed] = score(seed, tuple(options.cases or GROUPS))
                file.write(json.dumps(asdict(scored[seed])) + "\n")
                file.flush()
                _say(scored[seed].line)
    _say(summary(each for each in scored.values() if each.seed in seeds))
    return 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
