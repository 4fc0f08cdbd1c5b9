"""Report on the motion of a chain planter, as text and as a JSON record."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from plant_sim.planter.chain import Offset
from plant_sim.planter.motion import Joint, Motion
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.ratio import Regime, ZeroSpeedPoint, depth_m, point_ratio, regime_of, zero_speed_points
from plant_sim.planter.separation import separation_closed_form_s, separation_time_s

_KM_H = 3.6


@dataclass(frozen=True, slots=True)
class MotionReport:
    """Report on a motion.

    Attributes:
        motion: Motion of the planters, with a machine speed above 0.
        release_deg: Phase of the release on the bottom arc, degrees.
        assumed: Names of the parameters that are assumptions.
    """

    motion: Motion
    release_deg: float
    assumed: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<MotionReport: {self.regime}, release at {self.release_deg:g} degrees, of {self.motion!r}>"

    @property
    def regime(self) -> Regime:
        """Regime of the ratio of chain speed to machine speed."""
        return regime_of(self.motion.ratio)

    @property
    def points(self) -> dict[str, Offset]:
        """Offset of each reported point from the hinge."""
        return {"hinge": (0.0, 0.0), "tip": self.motion.chain.tip, "guide plate": self.motion.chain.guide}

    @property
    def zero_speed(self) -> dict[str, tuple[ZeroSpeedPoint, ...]]:
        """Points of zero horizontal speed of each reported point."""
        return {name: zero_speed_points(self.motion, offset) for name, offset in self.points.items()}

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints with the jumps of the tip in position and velocity."""
        return self.motion.joints()

    @property
    def separation_s(self) -> float | None:
        """Separation time after the release, s; None in `MotionModel.PRINTED`, whose path is not continuous."""
        if self.motion.model is MotionModel.PRINTED:
            return None
        return separation_time_s(self.motion, self.motion.time_at_s(self.release_deg))

    @property
    def separation_closed_form_s(self) -> float | None:
        """Separation time from the closed form, s; None if there is none."""
        if self.motion.model is MotionModel.PRINTED:
            return None
        return separation_closed_form_s(self.motion, self.motion.time_at_s(self.release_deg))

    def record(self) -> dict[str, object]:
        """Return the results by name, in SI units, as JSON types."""
        motion = self.motion
        return {
            "model": motion.model.value,
            "speed_m_s": motion.speed_m_s,
            "frequency_per_min": motion.frequency_per_min,
            "chain_m_s": motion.chain_m_s,
            "ratio": motion.ratio,
            "regime": self.regime.value,
            "point_ratio": {name: point_ratio(motion, offset) for name, offset in self.points.items()},
            "spacing_m": motion.spacing_m,
            "depth_m": depth_m(motion),
            "zero_speed": {name: [point._asdict() for point in points] for name, points in self.zero_speed.items()},
            "joints": [joint._asdict() for joint in self.joints],
            "release_deg": self.release_deg,
            "separation_s": self.separation_s,
            "separation_closed_form_s": self.separation_closed_form_s,
            "assumed": list(self.assumed),
        }

    def text(self, further: Sequence[str] = ()) -> str:
        """Return the results as plain text.

        Args:
            further: Lines to add before the assumptions.
        """
        motion = self.motion
        lines = [
            f"chain planter, model {motion.model}: {motion.speed_m_s * _KM_H:.4g} km/h, "
            f"{motion.frequency_per_min:.4g} plants/min, chain {1000 * motion.chain_m_s:.1f} mm/s",
            f"ratio               {motion.ratio:.4f}, {self.regime}",
            f"plant spacing       {1000 * motion.spacing_m:.1f} mm",
            f"depth of the tip    {1000 * depth_m(motion):.1f} mm below the soil surface",
            "zero horizontal speed (phase on the bottom arc, vertical speed)",
            *self._zero_speed_lines(),
            "jumps of the tip at the joints (position x, y; speed x, y)",
            *self._joint_lines(),
            self._separation_line(),
            *further,
        ]
        if self.assumed:
            lines.append(f"assumed, not published: {', '.join(self.assumed)}")
        return "\n".join(lines)

    def _zero_speed_lines(self) -> Iterator[str]:
        for name, points in self.zero_speed.items():
            texts = [f"{point.phase_deg:.2f}° {_signed(point.vertical_m_s, 3)} m/s" for point in points]
            yield f"  {name:<18}{'; '.join(texts) or 'none'}"

    def _joint_lines(self) -> Iterator[str]:
        for joint in self.joints:
            position = ", ".join(_signed(1000 * each, 1) for each in joint.position_jump_m)
            velocity = ", ".join(_signed(1000 * each, 1) for each in joint.velocity_jump_m_s)
            yield f"  {joint.name:<18}{position} mm; {velocity} mm/s"

    def _separation_line(self) -> str:
        time_s = self.separation_s
        if time_s is None:
            return "separation time     none: the path of the printed equations is not continuous"
        source = "numerical" if self.separation_closed_form_s is None else "numerical and closed form"
        return f"separation time     {1000 * time_s:.1f} ms after the release at {self.release_deg:g}° ({source})"


def _signed(value: float, digits: int) -> str:
    """Return a number with its sign; a number that rounds to zero has no sign.

    >>> _signed(-1e-17, 1), _signed(0.25, 2)
    ('0.0', '+0.25')
    """
    rounded = round(value, digits)
    return f"{math.fabs(rounded):.{digits}f}" if rounded == 0.0 else f"{rounded:+.{digits}f}"
