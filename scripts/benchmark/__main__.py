"""Entry point of ``scripts/bench``."""

from __future__ import annotations

from typing import NoReturn

from controller.common.stop_request import StopRequest, run_process


def run() -> NoReturn:
    """Run the benchmark with the process's arguments."""
    run_process(_main)


def _main(stop: StopRequest) -> int:
    from scripts.benchmark.command import main  # noqa: PLC0415 - after the signal handlers are installed

    return main(stop=stop)


if __name__ == "__main__":
    run()
