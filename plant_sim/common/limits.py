"""Validation of spec dataclasses, with errors that name the parameter."""


class SpecError(ValueError):
    """Invalid parameter; the message states the requirement.

    Attributes:
        key: Name of the parameter.
        complaint: Violated requirement.
    """

    def __init__(self, key: str, complaint: str) -> None:
        """Initialise the error.

        Args:
            key: Name of the parameter.
            complaint: Violated requirement, phrased to follow the key in a sentence.
        """
        super().__init__(f"{key} {complaint}")
        self.key = key
        self.complaint = complaint


def require_within(spec: object, low: float, high: float, *keys: str) -> None:
    """Check that attributes of a spec are within a closed interval.

    Args:
        spec: The spec under construction.
        low: Smallest valid value, in the unit of the attributes.
        high: Largest valid value.
        *keys: Attributes to check.

    Raises:
        SpecError: An attribute is outside the interval or is not a number.
    """
    for key in keys:
        value = getattr(spec, key)
        if not low <= value <= high:
            raise SpecError(key, f"must be {low:g} to {high:g}, not {value:g}")


def require(holds: bool, key: str, complaint: str) -> None:
    """Check a relation between parameters.

    Args:
        holds: True if the relation holds.
        key: Name of the parameter.
        complaint: Requirement, phrased to follow the key in a sentence.

    Raises:
        SpecError: The relation does not hold.
    """
    if not holds:
        raise SpecError(key, complaint)
