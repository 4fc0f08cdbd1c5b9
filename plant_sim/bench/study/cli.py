"""``python -m plant_sim study``: the papers' experiments and one's own, run, analysed and written down."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from controller.io_map import DEFAULT_IO_MAP, IoMapError, load_io_map
from plant_sim.bench.study.errors import StudyError
from plant_sim.parameters import DEFAULT_MACHINE, MachineError, load_machine
from plant_sim.quantity import QuantityError, parse_quantity

if TYPE_CHECKING:
    from plant_sim.bench.study.report import Study
    from plant_sim.bench.study.runner import RunOptions

# statsmodels takes a second to import: whatever needs it is imported when its study is asked for

_RUN = ("trials", "seed", "seedlings", "workers", "machine", "io_map")
_PACE = ("spacing", "frequencies")
_LEAST = {"trials": 1, "seed": 0, "seedlings": 1, "workers": 1}
_LINES = 10
_RANGE = re.compile(r"(\d+)\.\.(\d+)/(\d+)")


@dataclass(frozen=True, slots=True)
class _Entry:
    """A study by its name.

    Attributes:
        about: What it answers.
        make: Runs it.
        options: The options that mean something with it.
        data: Data sets that `--data` may name.
    """

    about: str
    make: Callable[[argparse.Namespace], Study]
    options: tuple[str, ...]
    data: tuple[str, ...] = ()


def add_study_arguments(parser: argparse.ArgumentParser) -> None:
    """Give the command `study` its options."""
    names = "; ".join(f"{name}: {entry.about}" for name, entry in _STUDIES.items())
    parser.add_argument("name", choices=_STUDIES, metavar="NAME", help=names)
    parser.add_argument("file", nargs="?", type=Path, metavar="FILE", help="with own: the YAML file of the study")
    parser.add_argument("--data", metavar="SET", help="a printed data set instead of the twin: paper with pepper-rsm, "
                        "printed or reconciled with cabbage-rsm")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--out", type=Path, metavar="DIR", help="new folder for report, tables and pictures")
    parser.add_argument("--trials", type=int, metavar="N", help="trials at each point of the design")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of everything random")
    parser.add_argument("--seedlings", type=int, metavar="N", help="seedlings of a trial, 144 without it")
    parser.add_argument("--spacing", metavar="LENGTH", help="with throughput: from plant to plant in a row, as 35cm")
    parser.add_argument("--frequencies", metavar="LIST", help="with throughput: planting frequencies to begin with, "
                        "plants a minute and row, as 20..90/10 or 20,30,45")  # fmt: skip
    parser.add_argument("--workers", type=int, metavar="N", help="processes side by side; one a core without it")
    parser.add_argument("--machine", type=Path, metavar="FILE", help="the machine's parameters")
    parser.add_argument("--io-map", type=Path, metavar="FILE", help="the wires")


def study_command(options: argparse.Namespace) -> int:
    """Run a study, print it and write it.

    Returns:
        0, or 2 if an option, a file or the folder cannot be used; one line on stderr says why.
    """
    try:
        return _run(options)
    except (StudyError, MachineError, IoMapError) as error:
        print(error, file=sys.stderr)  # noqa: T201 - a command
        return 2


def _run(options: argparse.Namespace) -> int:
    entry: _Entry = _STUDIES[options.name]
    _check(options, entry)
    try:
        from plant_sim.bench.study.report import check_folder, write  # noqa: PLC0415

        if options.out is not None:
            check_folder(options.out)
        study = entry.make(options)
    except ModuleNotFoundError as error:
        if error.name not in ("joblib", "statsmodels"):
            raise
        raise StudyError(f"study: {error.name} is not installed; install seedling-transplanter[studies]") from None
    sys.stdout.write(f"{study.json() if options.json else study.text()}\n")
    sys.stdout.flush()
    if options.out is not None:
        for path in write(study, options.out):
            sys.stderr.write(f"{path}\n")
    return 0


def _check(options: argparse.Namespace, entry: _Entry) -> None:
    name = options.name
    if (options.file is None) == ("file" in entry.options):
        missing = options.file is None
        remedy = "name the YAML file of the study" if missing else "leave it out, or write own before it"
        raise StudyError(f"FILE: {'is missing' if missing else f'means nothing with {name}'}; {remedy}")
    if options.data is not None and options.data not in entry.data:
        there = f"give {' or '.join(entry.data)}" if entry.data else "leave it out"
        raise StudyError(f"--data {options.data}: is no data set of {name}; {there}")
    for option in (*_RUN, *_PACE):
        if getattr(options, option) is None:
            continue
        flag = f"--{option.replace('_', '-')}"
        if option not in entry.options:
            why = "" if entry.options else ", which runs no trials"
            raise StudyError(f"{flag}: means nothing with {name}{why}; leave it out")
        if options.data is not None:
            raise StudyError(f"{flag}: means nothing with --data, which runs no trials; leave one of them out")
    for option, least in _LEAST.items():
        value = getattr(options, option)
        if value is not None and value < least:
            raise StudyError(f"--{option} {value}: give {least} or more")


def _spacing_m(text: str) -> float:
    try:
        return parse_quantity(text, "m")
    except QuantityError as error:
        raise StudyError(f"--spacing: {error}") from None


def _frequencies_per_min(text: str) -> tuple[int, ...]:
    """Planting frequencies written as a range, ``20..90/10``, or as a list, ``20,30,45``."""
    from plant_sim.bench.study.pace import FASTEST_PER_MIN, SLOWEST_PER_MIN  # noqa: PLC0415

    ends = _RANGE.fullmatch(text.replace(" ", ""))
    if ends is not None:
        low, high, step = map(int, ends.groups())
        if low > high or step < 1:
            raise StudyError(f"--frequencies {text}: holds no frequency; write the lower end first and a step from 1")
        found: Sequence[int] = range(low, high + 1, step)
    elif all(each.strip().isdecimal() for each in text.split(",")):
        found = [int(each) for each in text.split(",")]
    else:
        raise StudyError(f"--frequencies {text}: is neither range nor list; write 20..90/10 or 20,30,45")
    if not all(SLOWEST_PER_MIN <= each <= FASTEST_PER_MIN for each in found):
        raise StudyError(f"--frequencies {text}: give whole numbers from {SLOWEST_PER_MIN} to {FASTEST_PER_MIN}")
    return tuple(found)


@contextmanager
def _run_options(options: argparse.Namespace, *, trials: int, seed: int = 1) -> Iterator[RunOptions]:
    """How to run a study, with what it takes where the command line says nothing; shows progress meanwhile."""
    from plant_sim.bench.study.runner import SEEDLINGS, RunOptions  # noqa: PLC0415

    machine, io_map = load_machine(options.machine or DEFAULT_MACHINE), load_io_map(options.io_map or DEFAULT_IO_MAP)
    with _progress() as progress:
        yield RunOptions(
            trials=trials if options.trials is None else options.trials,
            seed=seed if options.seed is None else options.seed,
            seedlings=SEEDLINGS if options.seedlings is None else options.seedlings,
            workers=options.workers,
            machine=machine,
            io_map=io_map,
            progress=progress,
            machine_file=options.machine,
            io_map_file=options.io_map,
        )


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """Show how many trials are done: a bar on a terminal, else a line at each tenth."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _tell_tenths
        return
    columns = (TextColumn("trials"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def _busy(what: str) -> Iterator[None]:
    """Show on a terminal what is being done where no trials are counted."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(what):
        yield


def _tell_tenths(done: int, total: int) -> None:
    if done * _LINES // total > (done - 1) * _LINES // total:
        sys.stderr.write(f"{done} of {total} trials\n")
        sys.stderr.flush()


def _pepper_single(options: argparse.Namespace) -> Study:
    from plant_sim.bench.study.pepper_single import single_study  # noqa: PLC0415

    with _run_options(options, trials=5) as run:
        return single_study(run)


def _pepper_rsm(options: argparse.Namespace) -> Study:
    if options.data is not None:
        from plant_sim.bench.study.pepper_paper import paper_study  # noqa: PLC0415

        with _busy("analysing the paper's table"):
            return paper_study()
    from plant_sim.bench.study.pepper_rsm import rsm_study  # noqa: PLC0415

    with _run_options(options, trials=5) as run:
        return rsm_study(run)


def _cabbage_rsm(options: argparse.Namespace) -> Study:
    if options.data is None:
        raise StudyError("--data: cabbage-rsm has two data sets; give printed or reconciled")
    from plant_sim.bench.study.cabbage import cabbage_study  # noqa: PLC0415

    with _busy("analysing the paper's table"):
        return cabbage_study(options.data)


def _calibration(options: argparse.Namespace) -> Study:
    from plant_sim.bench.study.calibration_study import calibration_study  # noqa: PLC0415
    from plant_sim.bench.study.runner import command_line  # noqa: PLC0415

    machine, seed = load_machine(options.machine or DEFAULT_MACHINE), 1 if options.seed is None else options.seed
    command = command_line("calibration", seed=seed, machine=options.machine)
    with _busy("fitting the constants of the seedling"):
        return dataclasses.replace(calibration_study(machine, seed=seed), command=command)


def _throughput(options: argparse.Namespace) -> Study:
    from plant_sim.bench.study.driving import FREQUENCIES_PER_MIN  # noqa: PLC0415
    from plant_sim.bench.study.throughput import throughput_study  # noqa: PLC0415

    spacing_m = None if options.spacing is None else _spacing_m(options.spacing)
    given = options.frequencies
    frequencies = FREQUENCIES_PER_MIN if given is None else _frequencies_per_min(given)
    with _run_options(options, trials=1) as run:
        return throughput_study(run, frequencies_per_min=frequencies, spacing_m=spacing_m)


def _own(options: argparse.Namespace) -> Study:
    from plant_sim.bench.study.own import own_study  # noqa: PLC0415
    from plant_sim.bench.study.own_file import load_own_study  # noqa: PLC0415

    machine = load_machine(options.machine or DEFAULT_MACHINE)
    own = load_own_study(options.file, machine, trials=options.trials, seed=options.seed, seedlings=options.seedlings)
    with _run_options(options, trials=own.replicates, seed=own.seed) as run:
        return own_study(own, run)


_STUDIES: Mapping[str, _Entry] = {
    "pepper-single": _Entry("what each factor of the pepper paper does by itself", _pepper_single, _RUN),
    "pepper-rsm": _Entry("the pepper paper's response surface and optimum", _pepper_rsm, _RUN, ("paper",)),
    "cabbage-rsm": _Entry("the cabbage paper's regression, from its own tables", _cabbage_rsm, (),
                          ("printed", "reconciled")),
    "calibration": _Entry("where the constants of the seedling come from", _calibration, ("seed", "machine")),
    "throughput": _Entry("what keeps the machine from planting faster", _throughput, (*_RUN, *_PACE)),
    "own": _Entry("a study of one's own", _own, (*_RUN, "file")),
}  # fmt: skip
