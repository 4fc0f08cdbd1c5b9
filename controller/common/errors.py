"""Base class of the errors that a command reports in one line."""


class InputError(ValueError):
    """Invalid user input: an option, a file, a name or a value.

    The message is one line (one line per error if a file contains several) with the location and the remedy. The
    command line prints it on standard error and exits with code 2.
    """
