"""Command ``study``: run, analyse and report the papers' experiments and custom studies."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.set_points import FASTEST_PER_MIN, SLOWEST_PER_MIN
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.study import campaign, experiments
from plant_sim.cli.study.experiment_options import ANALYSE, PLAN
from plant_sim.cli.study.progress import busy, study_progress
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.common.picture_form import PICTURE_OPTIONS, check_picture_options, picture_form
from plant_sim.common.units import QuantityError, parse_quantity
from plant_sim.machine.parameters import load_machine
from plant_sim.study.errors import StudyError

if TYPE_CHECKING:
    from plant_sim.study.report.study import Study
    from plant_sim.study.runner import RunOptions

# Modules that need statsmodels, which takes a second to import, are imported by the study that uses them.

_RUN = ("trials", "seed", "seedlings", "workers", "machine", "io_map")
_PACE = ("spacing", "frequencies")
_DRAWS = ("trials", "seed", "workers")
_CLUSTER = ("engine", "scheduler", "timeout", "shard")
_EXPERIMENTS = tuple(name for name in dict.fromkeys((*ANALYSE, *PLAN)) if name not in _RUN)
_RANGE = re.compile(r"(\d+)\.\.(\d+)/(\d+)")


@dataclass(frozen=True, slots=True)
class _StudyEntry:
    """Entry in the table of studies.

    Attributes:
        make: Function that runs the study; None for a campaign, which has no report.
        options: Options that apply to the study.
        data: Data sets accepted by `--data`.
    """

    make: Callable[[argparse.Namespace], Study] | None
    options: tuple[str, ...]
    data: tuple[str, ...] = ()


def run(options: argparse.Namespace) -> int:
    """Run a study, print it and write the report.

    Raises:
        StudyError: An option, the study's file or the output folder is invalid.
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
    """
    entry: _StudyEntry = _STUDIES[options.name]
    _check(options, entry)
    if entry.make is None:
        return campaign.run(options)
    from plant_sim.study.report.study import check_folder, write  # noqa: PLC0415

    if options.out is not None:
        check_folder(options.out)
    provenance = provenance_of(options)
    study = entry.make(options)
    if "seed" in entry.options and options.seed is None:
        provenance = dataclasses.replace(provenance, seed=cast("int", study.record.get("seed", 1)))
    sys.stdout.write(f"{study.json(provenance) if options.json else study.text()}\n")
    sys.stdout.flush()
    if options.out is not None:
        for path in write(study, options.out, provenance, picture_form(options)):
            sys.stderr.write(f"{path}\n")
    return 0


def _check(options: argparse.Namespace, entry: _StudyEntry) -> None:
    name = options.name
    if (options.file is None) == ("file" in entry.options):
        missing = options.file is None
        kind = "CSV table of the trials" if name == "analyse" else "YAML file of the study"
        remedy = f"specify the {kind}" if missing else "omit it, or use the study own, analyse or campaign"
        raise StudyError(f"FILE: {'is missing' if missing else f'has no effect with {name}'}; {remedy}")
    if options.data is not None and options.data not in entry.data:
        there = f"use {' or '.join(entry.data)}" if entry.data else "omit it"
        raise StudyError(f"--data {options.data}: is not a data set of {name}; {there}")
    if entry.make is None:
        for option in PICTURE_OPTIONS:
            if getattr(options, option) is not None:
                raise StudyError(f"--{option}: has no effect with {name}, which draws no pictures; omit it")
    check_picture_options(options)
    for option in (*_RUN, *_PACE, *_CLUSTER, *_EXPERIMENTS):
        if getattr(options, option) is None:
            continue
        flag = f"--{option.replace('_', '-')}"
        if option not in entry.options:
            why = "" if entry.options else ", which runs no trials"
            raise StudyError(f"{flag}: has no effect with {name}{why}; omit it")
        if options.data is not None:
            raise StudyError(f"{flag}: has no effect with --data, which runs no trials; omit one of them")


def _spacing_m(text: str) -> float:
    try:
        return parse_quantity(text, "m")
    except QuantityError as error:
        raise StudyError(f"--spacing: {error}") from None


def _frequencies_per_min(text: str) -> tuple[int, ...]:
    """Return the planting frequencies of a range, ``20..90/10``, or a list, ``20,30,45``, 1/min."""
    ends = _RANGE.fullmatch(text.replace(" ", ""))
    if ends is not None:
        low, high, step = map(int, ends.groups())
        if low > high or step < 1:
            raise StudyError(
                f"--frequencies {text}: contains no frequencies; write the lower limit first and a step of 1 or more"
            )
        frequencies: Sequence[int] = range(low, high + 1, step)
    elif all(each.strip().isdecimal() for each in text.split(",")):
        frequencies = [int(each) for each in text.split(",")]
    else:
        raise StudyError(f"--frequencies {text}: is neither a range nor a list; write 20..90/10 or 20,30,45")
    if not all(SLOWEST_PER_MIN <= each <= FASTEST_PER_MIN for each in frequencies):
        raise StudyError(f"--frequencies {text}: must be whole numbers from {SLOWEST_PER_MIN} to {FASTEST_PER_MIN}")
    return tuple(frequencies)


@contextmanager
def _run_options(options: argparse.Namespace, *, trials: int, seed: int = 1) -> Iterator[RunOptions]:
    """Yield the run options, with the study's defaults for missing options; show the progress during the run."""
    from plant_sim.study.fleet import SEEDLINGS  # noqa: PLC0415
    from plant_sim.study.runner import RunOptions  # noqa: PLC0415

    machine, io_map = load_machine(options.machine or DEFAULT_MACHINE), load_io_map(options.io_map or DEFAULT_IO_MAP)
    with study_progress() as progress:
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


def _pepper_single(options: argparse.Namespace) -> Study:
    with _run_options(options, trials=5) as run_options, run_options.prepared():
        from plant_sim.study.pepper.single_factor import single_study  # noqa: PLC0415

        return single_study(run_options)


def _pepper_rsm(options: argparse.Namespace) -> Study:
    if options.data is not None:
        from plant_sim.study.pepper.paper import paper_study  # noqa: PLC0415

        with busy("analysing the paper's table"):
            return paper_study()
    with _run_options(options, trials=5) as run_options, run_options.prepared():
        from plant_sim.study.pepper.response_surface import rsm_study  # noqa: PLC0415

        return rsm_study(run_options)


def _cabbage_rsm(options: argparse.Namespace) -> Study:
    if options.data is None:
        raise StudyError("--data: cabbage-rsm has two data sets; specify printed or reconciled")
    from plant_sim.study.cabbage.study import cabbage_study  # noqa: PLC0415

    with busy("analysing the paper's table"):
        return cabbage_study(options.data)


def _calibration(options: argparse.Namespace) -> Study:
    from plant_sim.study.pepper.calibration_study import calibration_study  # noqa: PLC0415
    from plant_sim.study.runner import command_line  # noqa: PLC0415

    machine, seed = load_machine(options.machine or DEFAULT_MACHINE), 1 if options.seed is None else options.seed
    command = command_line("calibration", seed=seed, machine=options.machine)
    with busy("fitting the constants of the seedling"):
        return dataclasses.replace(calibration_study(machine, seed=seed), command=command)


def _throughput(options: argparse.Namespace) -> Study:
    from plant_sim.study.throughput.driving import FREQUENCIES_PER_MIN, LEAST_TRIALS  # noqa: PLC0415
    from plant_sim.study.throughput.study import throughput_study  # noqa: PLC0415

    spacing_m = None if options.spacing is None else _spacing_m(options.spacing)
    text = options.frequencies
    frequencies = FREQUENCIES_PER_MIN if text is None else _frequencies_per_min(text)
    with _run_options(options, trials=LEAST_TRIALS) as run_options:
        return throughput_study(run_options, frequencies_per_min=frequencies, spacing_m=spacing_m)


def _line_slip(options: argparse.Namespace) -> Study:
    from plant_sim.study.slip import slip_study  # noqa: PLC0415

    with busy("planting rows"):
        return slip_study(load_machine(), seed=_or(options.seed, 1))


def _planter_verdicts(options: argparse.Namespace) -> Study:
    from plant_sim.planter.parameters import load_planter, load_ranges  # noqa: PLC0415
    from plant_sim.study.planter.verdict_study import verdict_study  # noqa: PLC0415

    with study_progress("points") as progress:
        return verdict_study(
            load_planter(), load_ranges(), draws=_or(options.trials, 60), progress=progress, **_draw_options(options)
        )


def _planter_release(options: argparse.Namespace) -> Study:
    from plant_sim.planter.falls import default_table  # noqa: PLC0415
    from plant_sim.planter.parameters import load_planter, load_ranges  # noqa: PLC0415
    from plant_sim.planter.scatter import Ground  # noqa: PLC0415
    from plant_sim.study.planter.release_study import release_study  # noqa: PLC0415

    tables = {kind: default_table(kind) for kind in Ground}
    with study_progress("points") as progress:
        return release_study(
            load_planter(),
            load_ranges(),
            tables,
            draws=_or(options.trials, 40),
            progress=progress,
            **_draw_options(options),
        )


def _planter_lodging(options: argparse.Namespace) -> Study:
    from plant_sim.planter.parameters import load_planter, load_ranges  # noqa: PLC0415
    from plant_sim.study.planter.lodging_study import TRIAL_SEEDLINGS, lodging_study  # noqa: PLC0415

    with study_progress("settings and trials") as progress:
        return lodging_study(
            load_planter(),
            load_ranges(),
            blocks=_or(options.trials, 160),
            seedlings=_or(options.seedlings, TRIAL_SEEDLINGS),
            progress=progress,
            **_draw_options(options),
        )


def _draw_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return seed and number of processes of a study of the planter."""
    return {"seed": _or(options.seed, 1), "workers": options.workers}


def _or(value: int | None, default: int) -> int:
    return default if value is None else value


def _custom(options: argparse.Namespace) -> Study:
    from plant_sim.study.custom.file import load_custom_study  # noqa: PLC0415
    from plant_sim.study.custom.study import custom_study  # noqa: PLC0415

    machine = load_machine(options.machine or DEFAULT_MACHINE)
    custom = load_custom_study(
        options.file, machine, trials=options.trials, seed=options.seed, seedlings=options.seedlings
    )
    with _run_options(options, trials=custom.replicates, seed=custom.seed) as run_options:
        return custom_study(custom, run_options)


_STUDIES: Mapping[str, _StudyEntry] = {
    "pepper-single": _StudyEntry(_pepper_single, _RUN),
    "pepper-rsm": _StudyEntry(_pepper_rsm, _RUN, ("paper",)),
    "cabbage-rsm": _StudyEntry(_cabbage_rsm, (), ("printed", "reconciled")),
    "calibration": _StudyEntry(_calibration, ("seed", "machine")),
    "throughput": _StudyEntry(_throughput, (*_RUN, *_PACE)),
    "planter-verdicts": _StudyEntry(_planter_verdicts, _DRAWS),
    "planter-release": _StudyEntry(_planter_release, _DRAWS),
    "planter-lodging": _StudyEntry(_planter_lodging, (*_DRAWS, "seedlings")),
    "line-slip": _StudyEntry(_line_slip, ("seed",)),
    "own": _StudyEntry(_custom, (*_RUN, "file")),
    "analyse": _StudyEntry(experiments.analyse, (*ANALYSE, "file")),
    "plan": _StudyEntry(experiments.plan, PLAN),
    "campaign": _StudyEntry(None, (*_RUN, *_CLUSTER, "file")),
}
