"""Things that must not happen, as the plant notes them."""

import enum
from collections.abc import Callable


class Incident(enum.StrEnum):
    """Kinds of incident."""

    ARMS_COLLIDE = "arms_collide"
    """Both arms are inward of pick 2 on a machine where they may not meet."""
    ARM_THROUGH_TRAY = "arm_through_tray"
    """An arm too low, or what it carries, meets standing seedlings or a tray."""
    STEMS_CUT = "stems_cut"
    """Claws close on seedlings that do not stand where the claws grip."""
    TORN = "torn"
    """Clamped seedlings are moved sideways before their plugs are out."""
    DROPPED = "dropped"
    """Loaded claws open anywhere but over the cups."""
    DROP_OVER_TRAY = "drop_over_tray"
    """The same over the tray; noted in addition."""
    DOUBLE = "double"
    """A plug falls into a cup that is taken."""


#: Takes note of an incident and a sentence about it.
Report = Callable[[Incident, str], None]
