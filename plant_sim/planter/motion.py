"""Motion of the planters on the chain in three models.

Coordinates: x forward and y up from the position of the centre of the lower sprocket at time 0. At time 0, planter 0
is at joint B, where it enters the upper sprocket; planter k is k spacings behind it.

Source: cabbage paper, 2.1.2 (equations 1 to 8); docs/sources/machine.md 6 and 7.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant_sim.common.limits import SpecError
from plant_sim.planter.chain import ChainSpec, Offset
from plant_sim.planter.motion_model import MotionModel

_FASTEST_M_S = 10.0
_MOST_PER_MIN = 1000.0


class PathSegment(IntEnum):
    """Segment of the path, in order of time from 0."""

    TOP = 0
    """Arc BC on the upper sprocket, forward relative to the machine."""
    FALL = 1
    """Straight line CD, downward."""
    BOTTOM = 2
    """Arc DA on the lower sprocket, backward relative to the machine."""
    RISE = 3
    """Straight line AB, upward."""


class Joint(NamedTuple):
    """Joint of two segments.

    Attributes:
        name: Name of the joint in the paper, A to D.
        time_s: First time at which planter 0 passes the joint, s.
        position_jump_m: Jump of the position, (x, y), m.
        velocity_jump_m_s: Jump of the velocity, (x, y), m/s.
    """

    name: str
    time_s: float
    position_jump_m: tuple[float, float]
    velocity_jump_m_s: tuple[float, float]


class Motion:
    """Motion of all planters at constant machine speed and planting frequency.

    Points of a planter are specified by their offset from the hinge, (forward, up), m. `PRINTED` and `CORRECTED`
    are equations of the tip; for another point, l and -h are replaced by the components of its offset.

    Attributes:
        chain: Parameters of the chain.
        speed_m_s: Speed of the machine, m/s.
        frequency_per_min: Planting frequency, 1/min.
        model: Model of the motion.
        period_s: Duration of one revolution of the chain, s.
        chain_m_s: Speed of the chain, omega R, m/s.
        omega_rad_s: Angular speed of the sprockets, rad/s.
        starts_s: Start times of the segments of planter 0 in the first period, and the end of the period, s.
    """

    def __init__(
        self, chain: ChainSpec, *, speed_m_s: float, frequency_per_min: float, model: MotionModel = MotionModel.RIGID
    ) -> None:
        """Initialise the motion.

        Args:
            chain: Parameters of the chain.
            speed_m_s: Speed of the machine, 0 to 10 m/s.
            frequency_per_min: Plants per minute, one from each passing planter; above 0, up to 1000.
            model: Model of the motion.

        Raises:
            SpecError: The speed or the frequency is out of range.
        """
        if not 0.0 <= speed_m_s <= _FASTEST_M_S:
            raise SpecError("speed_m_s", f"must be 0 to {_FASTEST_M_S:g}, not {speed_m_s:g}")
        if not 0.0 < frequency_per_min <= _MOST_PER_MIN:
            raise SpecError("frequency_per_min", f"must be above 0, up to {_MOST_PER_MIN:g}, not {frequency_per_min:g}")
        self.chain = chain
        self.speed_m_s = speed_m_s
        self.frequency_per_min = frequency_per_min
        self.model = model
        radius_m, straight_m = chain.sprocket_radius_m, chain.centre_distance_m
        self.period_s = chain.planters * 60 / frequency_per_min
        self.chain_m_s = chain.loop_m / self.period_s
        self.omega_rad_s = self.chain_m_s / radius_m
        arc_s, straight_s = math.pi / self.omega_rad_s, straight_m / self.chain_m_s
        self.starts_s = (0.0, arc_s, arc_s + straight_s, 2 * arc_s + straight_s, self.period_s)

    def __repr__(self) -> str:
        return (
            f"<Motion, model {self.model}: {self.speed_m_s:g} m/s, {self.frequency_per_min:g} plants/min, spacing "
            f"{1000 * self.spacing_m:.0f} mm, lambda {self.ratio:.3f}>"
        )

    @property
    def ratio(self) -> float:
        """Ratio lambda of chain speed to machine speed; infinity if the machine is at rest. Source: equation 9."""
        return self.chain_m_s / self.speed_m_s if self.speed_m_s else math.inf

    @property
    def spacing_m(self) -> float:
        """Distance between plants in the row, m: travel of the machine from one planter to the next."""
        return self.speed_m_s * self.period_s / self.chain.planters

    def time_at_s(self, phase_deg: float) -> float:
        """Return the first time at which planter 0 is at a phase of the bottom arc, s.

        Args:
            phase_deg: Angle from joint D, degrees: 90 is the lowest point, 180 is joint A.
        """
        return self.starts_s[PathSegment.BOTTOM] + math.radians(phase_deg) / self.omega_rad_s

    def radius_m(self, offset: Offset) -> float:
        """Return the radius of the arcs of a point, m.

        Raises:
            SpecError: The point is R or more behind the hinge, and the model is not `RIGID`.
        """
        if self.model is MotionModel.RIGID:
            return self.chain.sprocket_radius_m
        radius_m = self.chain.sprocket_radius_m + offset[0]
        if radius_m <= 0.0:
            raise SpecError("offset", f"must be less than R behind the hinge in model {self.model}, not {offset[0]:g}")
        return radius_m

    def segment(self, time_s: ArrayLike) -> NDArray[np.intp]:
        """Return the `PathSegment` of every planter.

        Args:
            time_s: Times, s; a scalar is treated as an array of one time.

        Returns:
            Array of shape (planters, times).
        """
        return self._segment(self._since_s(np.atleast_1d(np.asarray(time_s, dtype=float))))

    def position_m(self, time_s: ArrayLike, offset: Offset = (0.0, 0.0)) -> NDArray[np.float64]:
        """Return the position of a point of every planter.

        Args:
            time_s: Times, s; a scalar is treated as an array of one time.
            offset: Point of the planter; by default the hinge.

        Returns:
            Array of shape (planters, times, 2) with x and y, m.
        """
        times_s = np.atleast_1d(np.asarray(time_s, dtype=float))
        since_s = self._since_s(times_s)
        on_machine_m = self._on_machine_m(self._segment(since_s), since_s, offset)
        on_machine_m[..., 0] += self.speed_m_s * times_s
        return on_machine_m

    def velocity_m_s(self, time_s: ArrayLike, offset: Offset = (0.0, 0.0)) -> NDArray[np.float64]:
        """Return the velocity of a point of every planter; in `PRINTED`, the velocity of equations 5 to 8.

        Args:
            time_s: Times, s; a scalar is treated as an array of one time.
            offset: Point of the planter; by default the hinge.

        Returns:
            Array of shape (planters, times, 2) with x and y, m/s.
        """
        since_s = self._since_s(np.atleast_1d(np.asarray(time_s, dtype=float)))
        return self._velocity_m_s(self._segment(since_s), since_s, offset)

    def joints(self, offset: Offset | None = None) -> tuple[Joint, ...]:
        """Return the joints B, C, D and A with the jumps of a point in position and velocity.

        Args:
            offset: Point of the planter; by default the tip.
        """
        point = self.chain.tip if offset is None else offset
        joints = []
        for name, after in zip("BCDA", PathSegment, strict=True):
            before = PathSegment((after - 1) % len(PathSegment))
            segments = np.array([before, after])
            since_s = np.array([self.starts_s[before + 1], self.starts_s[after]])
            position_m = np.diff(self._on_machine_m(segments, since_s, point), axis=0)[0]
            velocity_m_s = np.diff(self._velocity_m_s(segments, since_s, point), axis=0)[0]
            joints.append(
                Joint(
                    name,
                    self.starts_s[after],
                    (float(position_m[0]), float(position_m[1])),
                    (float(velocity_m_s[0]), float(velocity_m_s[1])),
                )
            )
        return tuple(joints)

    def _since_s(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the time since each planter was last at joint B, s, of shape (planters, times)."""
        delays_s = np.arange(self.chain.planters) * (self.period_s / self.chain.planters)
        since_s: NDArray[np.float64] = np.mod(times_s - delays_s[:, np.newaxis], self.period_s)
        return since_s

    def _segment(self, since_s: NDArray[np.float64]) -> NDArray[np.intp]:
        return np.searchsorted(self.starts_s[1:4], since_s, side="right")

    def _angle(self, segment: NDArray[np.intp], since_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angle of the sprockets since the start of the segment, rad."""
        angle: NDArray[np.float64] = self.omega_rad_s * (since_s - np.asarray(self.starts_s)[segment])
        return angle

    def _on_machine_m(
        self, segment: NDArray[np.intp], since_s: NDArray[np.float64], offset: Offset
    ) -> NDArray[np.float64]:
        """Return positions relative to the machine, m. Source: equations 1 to 4, corrected except for `PRINTED`."""
        angle = self._angle(segment, since_s)
        radius_m, high_m = self.radius_m(offset), self.chain.centre_distance_m
        ahead_m = offset[0] if self.model is MotionModel.RIGID else 0.0
        line_m = self.chain.sprocket_radius_m * angle
        base_m = -high_m if self.model is MotionModel.PRINTED else offset[1]
        x_m = np.choose(segment, [-radius_m * np.cos(angle), radius_m, radius_m * np.cos(angle), -radius_m]) + ahead_m
        y_m = np.choose(
            segment,
            [
                high_m + offset[1] + radius_m * np.sin(angle),
                high_m + offset[1] - line_m,
                offset[1] - radius_m * np.sin(angle),
                base_m + line_m,
            ],
        )
        return np.stack([x_m, y_m], axis=-1)

    def _velocity_m_s(
        self, segment: NDArray[np.intp], since_s: NDArray[np.float64], offset: Offset
    ) -> NDArray[np.float64]:
        """Return velocities relative to the soil, m/s. Source: equations 5 to 8, corrected except for `PRINTED`."""
        angle = self._angle(segment, since_s)
        arc_m_s = self.radius_m(offset) * self.omega_rad_s
        is_printed = self.model is MotionModel.PRINTED
        top_m_s = self.radius_m(offset) if is_printed else arc_m_s
        bottom_m_s = arc_m_s if is_printed else -arc_m_s
        x_m_s = self.speed_m_s + np.choose(segment, [top_m_s * np.sin(angle), 0.0, bottom_m_s * np.sin(angle), 0.0])
        y_m_s = np.choose(segment, [arc_m_s * np.cos(angle), -self.chain_m_s, -arc_m_s * np.cos(angle), self.chain_m_s])
        return np.stack([x_m_s, y_m_s], axis=-1)
