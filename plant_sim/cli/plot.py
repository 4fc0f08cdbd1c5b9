"""Command ``plot``: timing diagram and curves of a recording."""

from __future__ import annotations

import argparse

from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.common.provenance.result_files import ResultFiles
from plant_sim.scope.plot import plot
from plant_sim.scope.store import Recording
from plant_sim.scope.window import selected_window


def run(options: argparse.Namespace) -> int:
    """Write the pictures and print their paths.

    Raises:
        RecordingError: The recording, a tag, the window or the folder is invalid.
    """
    provenance = provenance_of(options)
    recording = Recording(options.recording)
    window = selected_window(recording, options.start, options.end, side=options.arm)
    out = options.recording.parent if options.out is None else options.out
    paths = plot(recording, out, window, side=options.arm, tags=options.tags, provenance=provenance)
    if options.out is not None:  # a file of the recording's own folder says where the recording comes from
        files = ResultFiles(out, provenance)
        files.add(paths)
        paths = files.finish()
    for path in paths:
        print(path)
    return 0
