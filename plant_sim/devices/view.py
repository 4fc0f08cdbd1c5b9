"""Base class of the device views."""

from typing import Any


class View:
    """View of a device in the kernel memory; it stores no state itself.

    Attributes:
        state: State record.
        params: Parameter record; faults change it.
    """

    __slots__ = ("params", "state")

    def __init__(self, state: Any, params: Any) -> None:
        """Create a view of two records."""
        self.state = state
        self.params = params

    @property
    def jammed(self) -> bool:
        """True while the moving part is locked in place; its drive keeps operating."""
        return bool(self.params["blocked"])

    @jammed.setter
    def jammed(self, jammed: bool) -> None:
        self.params["blocked"] = int(jammed)
