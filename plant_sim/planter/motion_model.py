"""Models of the motion of the planter."""

from enum import StrEnum


class MotionModel(StrEnum):
    """Model of the motion.

    `PRINTED` uses equations 1 to 8 with their errors: equation 1 contains -H instead of -h, equation 6 lacks a factor
    omega, and the horizontal speed in equation 8 has the wrong sign. `CORRECTED` corrects these errors, but a point at
    distance l from the pitch line still moves on arcs of radius R + l, and its vertical speed jumps by l omega at every
    joint. In `RIGID`, a planter only translates, as an upright parallelogram requires: every point moves on
    the path of the hinge, of radius R, shifted by a constant.
    """

    PRINTED = "printed"
    CORRECTED = "corrected"
    RIGID = "rigid"
