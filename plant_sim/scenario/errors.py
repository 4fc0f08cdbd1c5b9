"""Error raised by scenarios."""

from controller.common.errors import InputError


class ScenarioError(InputError):
    """Invalid scenario; the message is one line with file, line, key, error and remedy."""
