"""Exception of the planting lines."""

from controller.common.errors import InputError


class LineError(InputError):
    """Invalid line or ground, or a result that cannot be written; the one-line message states location and remedy."""
