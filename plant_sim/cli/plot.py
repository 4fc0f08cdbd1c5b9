"""Command ``plot``: timing diagram and curves of a recording."""

from __future__ import annotations

import argparse
from pathlib import Path

from plant_sim.scope.plot import plot
from plant_sim.scope.store import Recording
from plant_sim.scope.window import selected_window


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``plot``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="file written with --record")
    parser.add_argument(
        "--out", type=Path, default=None, help="folder for the pictures (default: the folder of the recording)"
    )
    parser.add_argument(
        "--from", dest="start", default=None, metavar="TIME", help="start of the window, e.g. 12s or 12500ms"
    )
    parser.add_argument("--to", dest="end", default=None, metavar="TIME", help="end of the window")
    parser.add_argument(
        "--arm",
        choices=("left", "right"),
        default="left",
        help="arm shown in the timing diagram; without --from and --to the window is its second complete cycle",
    )
    parser.add_argument(
        "--tags",
        nargs="+",
        default=None,
        metavar="TAG",
        help="tags to draw instead of the usual ones; patterns such as 'y.left.*' are allowed",
    )


def run(options: argparse.Namespace) -> int:
    """Write the pictures and print their paths.

    Raises:
        RecordingError: The recording, a tag, the window or the folder is invalid.
    """
    recording = Recording(options.recording)
    window = selected_window(recording, options.start, options.end, side=options.arm)
    out = options.recording.parent if options.out is None else options.out
    for path in plot(recording, out, window, side=options.arm, tags=options.tags):
        print(path)
    return 0
