"""How a spec dataclass refuses a value that no machine can have, and says which."""


class SpecError(ValueError):
    """A parameter is impossible; the text says what it must be.

    Attributes:
        key: Name of the parameter.
        complaint: What it must be.
    """

    def __init__(self, key: str, complaint: str) -> None:
        """Name the parameter and what is wrong with it.

        Args:
            key: Name of the parameter.
            complaint: What it must be, to follow the key in a sentence.
        """
        super().__init__(f"{key} {complaint}")
        self.key = key
        self.complaint = complaint


def require_within(spec: object, low: float, high: float, *keys: str) -> None:
    """Check that attributes of a spec lie in a closed interval.

    Args:
        spec: The spec under construction.
        low: Smallest possible value, in the unit of the attributes.
        high: Largest possible value.
        *keys: Attributes to check.

    Raises:
        SpecError: one of them lies outside, or is not a number.
    """
    for key in keys:
        value = getattr(spec, key)
        if not low <= value <= high:
            raise SpecError(key, f"must lie within {low:g} to {high:g}, not {value:g}")


def require(holds: bool, key: str, complaint: str) -> None:
    """Check a relation between parameters.

    Args:
        holds: Whether it holds.
        key: The parameter to name.
        complaint: What it must be, to follow the key in a sentence.

    Raises:
        SpecError: it does not hold.
    """
    if not holds:
        raise SpecError(key, complaint)
