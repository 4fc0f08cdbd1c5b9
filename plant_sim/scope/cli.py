"""Options of the command line for recording and plotting."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_record_argument(parser: argparse.ArgumentParser) -> None:
    """Let a command record its run: ``options.record`` is the file, None without one."""
    parser.add_argument(
        "--record",
        type=Path,
        default=None,
        metavar="FILE",
        help="record every tag, place, pressure and seedling to a Parquet file (docs/scope.md)",
    )


def add_plot_arguments(parser: argparse.ArgumentParser) -> None:
    """Give the command `plot` its options."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="a file made with --record")
    parser.add_argument(
        "--out", type=Path, default=None, help="folder for the pictures; that of the recording by default"
    )
    parser.add_argument("--from", dest="start", default=None, metavar="TIME", help="from when, as 12s or 12500ms")
    parser.add_argument("--to", dest="end", default=None, metavar="TIME", help="until when")
    parser.add_argument(
        "--arm",
        choices=("left", "right"),
        default="left",
        help="whose wires the timing diagram shows, and whose second full cycle without --from and --to",
    )
    parser.add_argument(
        "--tags",
        nargs="+",
        default=None,
        metavar="TAG",
        help="these instead of the usual ones; patterns as 'y.left.*' may be given",
    )


def plot_command(options: argparse.Namespace) -> int:
    """Write the pictures of a recording and say where they lie.

    Raises:
        RecordingError: the recording, a tag, the time or the folder is wrong.
    """
    # matplotlib and pyarrow take most of a second to import, which only this command pays
    from plant_sim.scope.plot import plot  # noqa: PLC0415
    from plant_sim.scope.store import Recording  # noqa: PLC0415
    from plant_sim.scope.window import chosen_window  # noqa: PLC0415

    recording = Recording(options.recording)
    window = chosen_window(recording, options.start, options.end, side=options.arm)
    out = options.recording.parent if options.out is None else options.out
    for path in plot(recording, out, window, side=options.arm, tags=options.tags):
        sys.stdout.write(f"{path}\n")
    return 0
