"""How a study refuses what it cannot do."""


class StudyError(ValueError):
    """A study cannot be run as asked; one line: where, which key, what is wrong, the remedy."""
