"""``python -m plant_sim``."""

import sys

from plant_sim.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
