"""Error of the scenarios."""

from controller.common.errors import InputError


class ScenarioError(InputError):
    """A scenario is invalid; the message is one line with file, line, key, error and remedy."""
