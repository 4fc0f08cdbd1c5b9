"""Error raised by studies."""

from controller.common.errors import InputError


class StudyError(InputError):
    """Study that cannot be run; the message is one line with location, key, error and remedy."""
