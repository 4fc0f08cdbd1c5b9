"""Command ``planter``: motion of the chain planter of the cabbage paper."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from controller.common.document.parts import Drawing
from controller.common.errors import InputError
from plant_sim.cli.options.planter import FIGURE_SPEEDS_KM_H, FREQUENCY_PER_MIN, REGIMES, SCHEME, SPEED_KM_H
from plant_sim.cli.reproduce.origin import print_json, provenance_of
from plant_sim.common.picture_form import DPI
from plant_sim.planter.fall_report import FallReport
from plant_sim.planter.falls import stored_table, write_table
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.parameters import Planter, assumed_names, load_planter, load_ranges
from plant_sim.planter.report import MotionReport
from plant_sim.planter.scatter import Ground, Ranges

# Modules that require matplotlib, which takes a second to import, are imported only when a figure is drawn.


Save = Callable[[Drawing, Path], None]
"""Function that writes a figure to a file."""

_KM_H = 3.6


def run(options: argparse.Namespace) -> int:
    """Print the report on the motion, and draw the motion if requested.

    Raises:
        InputError: An option is invalid.
        PlanterError: The parameters are invalid.
        FigureError: The figure cannot be written.
    """
    _check(options)
    provenance = provenance_of(options)
    planter = load_planter(options.planter)
    ranges = load_ranges(options.planter)
    if options.falls is not None:
        _write_falls(planter, ranges, options.falls)
        return 0
    speed_km_h = FIGURE_SPEEDS_KM_H.get(options.figure, SPEED_KM_H) if options.speed is None else options.speed
    motion = Motion(
        planter.chain,
        speed_m_s=speed_km_h / _KM_H,
        frequency_per_min=FREQUENCY_PER_MIN if options.frequency is None else options.frequency,
        model=MotionModel(options.model),
    )
    release_deg = planter.chain.release_deg if options.release is None else options.release
    report = MotionReport(motion, release_deg, assumed_names(options.planter))
    if options.plot is not None:
        from plant_sim.common.figure_style import save_as  # noqa: PLC0415
        from plant_sim.planter.drawing.gif import write_comment  # noqa: PLC0415

        save = partial(save_as, provenance=provenance, dpi=DPI if options.dpi is None else options.dpi)
        _draw(report, planter, options.plot, options.figure, save)
        if options.plot.suffix == ".gif":
            write_comment(options.plot, provenance.text)
    stored = {ground: stored_table(planter, ranges, ground) for ground in Ground}
    tables = {ground: table for ground, table in stored.items() if table is not None}
    falls = FallReport(planter, motion, release_deg, tables)
    if options.json:
        print_json(report.record() | falls.record(), provenance)
    else:
        print(report.text(falls.lines()))
    return 0


def _check(options: argparse.Namespace) -> None:
    if options.figure is not None and options.plot is None:
        raise InputError(f"--figure {options.figure}: has no effect without a file; add --plot FILE")
    if options.figure in FIGURE_SPEEDS_KM_H and (options.speed is not None or options.frequency is not None):
        raise InputError(f"--figure {options.figure}: its speed and frequency are fixed; omit --speed and --frequency")
    if options.plot is not None and options.plot.suffix not in (".png", ".svg", ".pdf", ".gif"):
        raise InputError(f"--plot {options.plot}: unknown format; use a name that ends in .png, .svg, .pdf or .gif")
    if options.dpi is not None and (options.plot is None or options.plot.suffix != ".png"):
        raise InputError(f"--dpi {options.dpi}: has no effect without a PNG file; add --plot FILE.png or omit it")


def _write_falls(planter: Planter, ranges: Ranges, folder: Path) -> None:
    """Build the tables of falls and write them to a folder."""
    for ground in Ground:
        try:
            path = write_table(planter, ranges, ground, folder, progress=partial(_print_progress, ground))
        except OSError as error:
            raise InputError(
                f"--falls {folder}: cannot be written ({error.strerror}); specify another folder"
            ) from None
        print(path)


def _print_progress(ground: Ground, done: int, total: int) -> None:
    sys.stderr.write(f"{ground}: {done} of {total} motions\n")
    sys.stderr.flush()


def _draw(report: MotionReport, planter: Planter, path: Path, figure: int | None, save: Save) -> None:
    """Draw a figure of the paper, or the motion of the report if `figure` is None; `save` writes all but a GIF."""
    from plant_sim.common.figure_style import drawing  # noqa: PLC0415
    from plant_sim.planter.drawing import animation  # noqa: PLC0415
    from plant_sim.planter.drawing.paths import motion_figure, regimes_figure  # noqa: PLC0415
    from plant_sim.planter.drawing.scheme import Scheme  # noqa: PLC0415

    motion, chain, model = report.motion, report.motion.chain, report.motion.model
    frequency_per_min, is_gif = motion.frequency_per_min, path.suffix == ".gif"
    after = "Planter" if figure is None else f"Planter, after Fig. {figure}"
    title = (
        f"{after}: {motion.speed_m_s * _KM_H:.4g} km/h, {motion.frequency_per_min:.4g} plants/min, "
        f"λ = {motion.ratio:.4g}, {report.regime}, model {motion.model}"
    )
    with drawing():
        if figure in FIGURE_SPEEDS_KM_H:
            _draw_process(report, planter, path, title, save)
        elif figure == SCHEME and is_gif:
            animation.write_scheme_animation(chain, path, model=model)
        elif figure == SCHEME:
            save(Scheme(chain, model).figure, path)
        elif figure == REGIMES and is_gif:
            animation.write_regimes_animation(chain, path, frequency_per_min=frequency_per_min, model=model)
        elif figure == REGIMES:
            save(regimes_figure(chain, frequency_per_min=frequency_per_min, model=model), path)
        elif is_gif:
            animation.write_animation(motion, path, title=title)
        else:
            save(motion_figure(motion, title=title), path)


def _draw_process(report: MotionReport, planter: Planter, path: Path, title: str, save: Save) -> None:
    """Draw the simulated fall of a block onto rigid ground."""
    from plant_sim.planter.contact import FallFrame, drop  # noqa: PLC0415
    from plant_sim.planter.drawing.process import process_figure, write_process  # noqa: PLC0415

    frames: list[FallFrame] = []
    drop(planter, planter.rigid_ground, report.motion, opener_deg=report.release_deg, frames=frames)
    if path.suffix == ".gif":
        write_process(frames, planter, path, title=title)
    else:
        save(process_figure(frames, planter, title=title), path)
