"""End of a child process with the process that started it, however that one ends.

A command that is killed cannot stop its children. They would work on, the machine would move without anyone who
watches it, and its ports would stay in use. Therefore the parent holds the writing end of a pipe, the lifeline of the
child, which watches the reading end. The system closes the writing end with the last process that holds it.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Sequence
from typing import Final

from controller.common.supervision.threads import supervised

VARIABLE: Final = "TRANSPLANTER_LIFELINE"
"""Environment variable of a child: descriptor and inode number of the reading end."""
END_LIMIT_S = 30.0
"""Limit of the end of a child in order after that of its parent, s; then it ends at once."""
_HAS_INHERITED_DESCRIPTORS: Final = os.name == "posix"


class Lifeline:
    """Pipe that tells one child process that this process has ended; without effect on Windows.

    Attributes:
        writer: Descriptor of the writing end.
        descriptors: Descriptors that the child must inherit.
    """

    def __init__(self, held: Sequence[Lifeline] = ()) -> None:
        """Create the pipe, before the child is started.

        Args:
            held: Lifelines of other children, which the child holds as well: they end after it.
        """
        self._reader, self.writer = os.pipe()
        self._is_closed = False
        self.descriptors: tuple[int, ...] = ()
        if _HAS_INHERITED_DESCRIPTORS:
            self.descriptors = (self._reader, *(lifeline.writer for lifeline in held))

    def environment(self) -> dict[str, str]:
        """Return the environment of the child."""
        if not self.descriptors:
            return dict(os.environ)
        return {**os.environ, VARIABLE: f"{self._reader}:{os.fstat(self._reader).st_ino}"}

    def started(self) -> None:
        """Leave the reading end to the child, which has been started."""
        os.close(self._reader)

    def close(self) -> None:
        """Close the writing end, after the child has ended; no effect if it is closed."""
        if not self._is_closed:
            self._is_closed = True
            os.close(self.writer)


def end_with_parent() -> None:
    """Let this process end like after SIGTERM when all who hold its lifeline have ended; no effect without one."""
    reader = _lifeline(os.environ.pop(VARIABLE, ""))
    if reader is not None:
        os.set_inheritable(reader, False)
        supervised("parent", lambda: _end_after_parent(reader)).start()


def _lifeline(value: str) -> int | None:
    """Return the descriptor of the lifeline; None if the variable is absent or meant for another process."""
    try:
        reader, inode = (int(part) for part in value.split(":"))
        return reader if os.fstat(reader).st_ino == inode else None
    except (ValueError, OSError):
        return None


def _end_after_parent(reader: int) -> None:
    os.read(reader, 1)  # nobody writes: it returns at the end of file
    os.kill(os.getpid(), signal.SIGTERM)
    threading.Event().wait(END_LIMIT_S)
    os._exit(1)
