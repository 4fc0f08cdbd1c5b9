"""``python -m plant_sim``: the command line is in `plant_sim.cli`."""

import sys


def main() -> int:
    """Run the command line; Ctrl-C ends it quietly from the first import on."""
    try:
        from plant_sim.cli import main as run  # noqa: PLC0415 - numba takes a while to import

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
