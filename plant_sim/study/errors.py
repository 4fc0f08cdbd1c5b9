"""Error raised by studies."""

from controller.common.errors import InputError


class StudyError(InputError):
    """Raised if a study cannot be run; the message is one line with location, key, error and remedy."""
