"""Damages drawn at random over all packages, and the tests that detect them.

``python -m tests.suite.damages --seed 1 --count 40 [--out FILE] [--against FILE]`` plants each damage in a copy of the
checkout, runs the tests that can execute the damaged module, the nearest first, and prints one line. Results are
appended to a file of JSON lines; damages that the file already contains are not planted again. ``--against`` compares
them with the results of an earlier state of the tests.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from random import Random
from tempfile import TemporaryDirectory
from typing import Final

from tests.paths import ROOT
from tests.suite.dependencies import Dependencies, own_dependencies
from tests.suite.operators import Change, Kind, changes
from tests.suite.planting import SourceCopy
from tests.suite.selection import executing

LIMIT_S: Final = 300.0
"""Default time limit for the tests of one damage, s."""
BATCH: Final = 8
"""Number of test files run by one process; a process takes 2 s to start."""
COMPARE_SOURCES: Final = frozenset({"tests/project/test_adding_a_device.py", "tests/project/test_damages.py"})
"""Test files that compare the text of sources with a list, and fail whether or not the damaged code is tested."""
DEFAULT_OUT: Final = ROOT / "var/damages.jsonl"

KILLED, ESCAPED, UNFINISHED, INVALID = "killed", "escaped", "unfinished", "invalid"
"""Results: a test failed; all passed; the time limit was reached; the failed test also fails without the damage."""


@dataclass(frozen=True)
class Damage:
    """One drawn damage: file, relative to the root, and change of its text."""

    file: str
    change: Change

    def __str__(self) -> str:
        """Return the place and the change in one line."""
        old, new = (" ".join(text.split()) for text in (self.change.old, self.change.new))
        return f"{self.file}:{self.change.line}: {self.change.kind}: {old} => {new}"


@dataclass(frozen=True)
class Result:
    """Result of one damage, as stored in the file of results.

    Attributes:
        damage: Place and change, which identify the damage.
        result: See `KILLED`.
        test: Failed test; empty if none failed.
        duration_s: Duration until the result, s.
    """

    damage: str
    result: str
    test: str
    duration_s: float

    def __str__(self) -> str:
        """Return the line that is printed."""
        by = f" by {self.test}" if self.test else ""
        return f"{self.damage}: {self.result}{by} after {self.duration_s:.1f} s"


def draw(sources: dict[str, str], seed: int) -> Iterator[Damage]:
    """Yield different damages of source texts until none is left.

    A package is drawn first, then a kind of damage, then a change; a long file or a frequent kind therefore does not
    get more damages.

    Args:
        sources: Text of each file.
        seed: Seed of the draw; the damages do not depend on how many are taken.
    """
    random = Random(seed)
    drawn = set[str]()
    packages = defaultdict[str, dict[Kind, list[Damage]]](lambda: defaultdict(list))
    for file, text in sorted(sources.items()):
        for change in changes(text):
            packages[str(PurePosixPath(file).parent)][change.kind].append(Damage(file, change))
    while packages:
        package = random.choice(sorted(packages))
        kinds = packages[package]
        kind = random.choice(sorted(kinds))
        damage = kinds[kind].pop(random.randrange(len(kinds[kind])))
        if str(damage) not in drawn:  # the same change may occur twice in a line
            drawn.add(str(damage))
            yield damage
        if not kinds[kind]:
            del kinds[kind]
        if not kinds:
            del packages[package]


def nearest_first(file: str, tests: Iterable[str]) -> list[str]:
    """Return test files ordered by the distance of their folder from that of a source file.

    >>> nearest_first("controller/core/scan.py", ["tests/project/test_x.py", "tests/controller/core/test_y.py"])
    ['tests/controller/core/test_y.py', 'tests/project/test_x.py']
    """
    folder = PurePosixPath(file).parts[:-1]

    def distance(test: str) -> tuple[bool, int, str]:
        other = PurePosixPath(test.removeprefix("tests/")).parts[:-1]
        common = sum(1 for ours, theirs in zip(folder, other, strict=False) if ours == theirs)
        named = PurePosixPath(test).stem == f"test_{PurePosixPath(file).stem}"
        return not (named and other == folder), len(folder) + len(other) - 2 * common, test

    return sorted(tests, key=distance)


def judge(damage: Damage, copy: SourceCopy, graph: Dependencies, limit_s: float = LIMIT_S) -> Result:
    """Plant a damage and run the tests that can execute the damaged module, until the first failure."""
    able = {path.as_posix() for path in executing(graph, Path(damage.file))}
    tests = nearest_first(damage.file, able - COMPARE_SOURCES)
    used_s = 0.0
    with copy.planted(damage.file, damage.change.applied_to((copy.root / damage.file).read_text(encoding="utf-8"))):
        for first in range(0, len(tests), BATCH):
            outcome = copy.run(tests[first : first + BATCH], limit_s - used_s)
            used_s += outcome.duration_s
            if not outcome.passed:
                break
        else:
            return Result(str(damage), ESCAPED, "", used_s)
    if outcome.code is None:
        return Result(str(damage), UNFINISHED, "", used_s)
    test = outcome.detected_by
    again = test.partition("[")[0] if "/" in test else tests[0]  # every parameter: a summary may shorten them
    return Result(str(damage), KILLED if copy.run([again], limit_s).passed else INVALID, test, used_s)


def read_results(path: Path) -> dict[str, Result]:
    """Return the results of a file by damage; none if it does not exist.

    Raises:
        ValueError: A line is not a result.
    """
    if not path.exists():
        return {}
    results = dict[str, Result]()
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            result = Result(**json.loads(line))
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path}: line {number}: not a result of this command; delete the line") from error
        results[result.damage] = result
    return results


def comparison(now: dict[str, Result], before: dict[str, Result]) -> Iterator[str]:
    """Yield a line for each damage whose result differs from the earlier one, and the totals of both."""
    common = [damage for damage in now if damage in before]
    for damage in common:
        if now[damage].result != before[damage].result:
            yield f"{damage}: {before[damage].result} before, now {now[damage].result}"
    for name, results in (("before", before), ("now", now)):
        counts = Counter(results[damage].result for damage in common)
        duration_s = sum(results[damage].duration_s for damage in common)
        totals = ", ".join(f"{counts[result]} {result}" for result in (KILLED, ESCAPED, UNFINISHED, INVALID))
        yield f"{name}: {totals} of {len(common)} damages, {duration_s:.0f} s"


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, plant and judge damages; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.suite.damages", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument("--count", type=int, default=40, help="number of damages")
    parser.add_argument("--limit-s", type=float, default=LIMIT_S, help="time limit for the tests of one damage, s")
    parser.add_argument("--out", type=Path, default=DEFAULT_OUT, help="file of results, continued if it exists")
    parser.add_argument("--against", type=Path, help="file of earlier results to compare with")
    options = parser.parse_args(arguments)
    try:
        known = read_results(options.out)
        before = read_results(options.against) if options.against else {}
    except ValueError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    if options.against and not options.against.exists():
        parser.exit(2, f"{parser.prog}: {options.against} does not exist; give a file that --out has written\n")
    results = {result.damage: result for result in _judged(options, known)}
    if options.against:
        sys.stdout.writelines(f"{line}\n" for line in comparison(results, before))
    return 0


def _judged(options: argparse.Namespace, known: dict[str, Result]) -> Iterator[Result]:
    """Yield the result of each damage, known or new; print it, and store it if it is new."""
    graph = own_dependencies()
    files = [name for name in graph.facts if not name.startswith("tests/")]
    damages = draw({name: (ROOT / name).read_text(encoding="utf-8") for name in files}, options.seed)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder, options.out.open("a", encoding="utf-8") as out:
        copy = SourceCopy(Path(folder), ROOT)
        for _, damage in zip(range(options.count), damages, strict=False):
            result = known.get(str(damage)) or judge(damage, copy, graph, options.limit_s)
            if result.damage not in known:
                out.write(f"{json.dumps(asdict(result))}\n")
                out.flush()
            sys.stdout.write(f"{result}\n")
            sys.stdout.flush()
            yield result


if __name__ == "__main__":
    sys.exit(main())
