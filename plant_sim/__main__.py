"""Entry point of ``python -m plant_sim``."""

from __future__ import annotations

import os
from typing import Final, NoReturn

from controller.common.stop_request import StopRequest, run_process

ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "1")
"""Variable of the environment with which NumPy and SciPy calculate in one thread, and its value.

Their matrices have tens of rows here, so that further threads only wait for each other: with two threads the search for
an optimum took 0.8 s of processor time on a busy computer, with one 0.02 s. Studies start a process for each processor.
"""


def run() -> NoReturn:
    """Run the command of the process's arguments."""
    run_process(_main)


def _main(stop: StopRequest) -> int:
    os.environ.setdefault(*ONE_THREAD)  # NumPy reads it when it is imported
    from plant_sim.cli.main import main  # noqa: PLC0415 - after the signal handlers are installed

    return main(stop=stop)


if __name__ == "__main__":
    run()
