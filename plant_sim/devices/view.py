"""What every view of a device in the memory of the kernel has."""

from typing import Any


class View:
    """A device as Python sees it; it holds no state of its own.

    Attributes:
        state: Its record of what moves.
        make: Its record of what decides how; what can break is changed here.
    """

    __slots__ = ("make", "state")

    def __init__(self, state: Any, make: Any) -> None:
        """Look at a device."""
        self.state = state
        self.make = make

    @property
    def jammed(self) -> bool:
        """While True what it moves stands dead; its drive goes on."""
        return bool(self.make["blocked"])

    @jammed.setter
    def jammed(self, jammed: bool) -> None:
        self.make["blocked"] = int(jammed)
