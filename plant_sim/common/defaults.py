"""Files, port and numbers of the delivered plant, which options show without importing it."""

from pathlib import Path
from typing import Final

DEFAULT_MACHINE: Final = Path(__file__).parents[1] / "machine.yaml"
"""Parameters of the delivered machine."""
DEFAULT_PLANTER: Final = Path(__file__).parents[1] / "planter.yaml"
"""Parameters of the chain planter."""
DEFAULT_PORT: Final = 5020
"""TCP port of the Modbus server of the plant."""
DEFAULT_PASSES: Final = 5
"""Passes of a line by which its rows are judged."""
