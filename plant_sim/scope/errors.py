"""Error raised by recordings and plots."""

from controller.common.errors import InputError


class RecordingError(InputError):
    """Recording that cannot be written or read; the one-line message states the file, the problem and the remedy."""
