"""Incidents reported by the plant."""

import enum
from collections.abc import Callable


class Incident(enum.StrEnum):
    """Kinds of incident."""

    ARMS_COLLIDE = "arms_collide"
    """Both arms are inward of pick 2 on a machine that does not permit this."""
    ARM_THROUGH_TRAY = "arm_through_tray"
    """An arm that is too low, or a seedling in its claws, collides with standing seedlings or a tray."""
    STEMS_CUT = "stems_cut"
    """Claws close on seedlings outside the grip position."""
    TORN = "torn"
    """Clamped seedlings are moved sideways before their plugs are extracted."""
    DROPPED = "dropped"
    """Claws open with seedlings anywhere except over the cups."""
    DROP_OVER_TRAY = "drop_over_tray"
    """Claws open with seedlings over the tray; reported in addition to `DROPPED`."""
    DOUBLE = "double"
    """A plug falls into an occupied cup."""


Report = Callable[[Incident, str], None]
"""Callback that receives an incident and its description."""
