"""Report on the falls at a motion and the quality of planting, as text and as a JSON record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from plant_sim.planter.contact import drop
from plant_sim.planter.falls import FallTable
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.parameters import Planter
from plant_sim.planter.quality import Share, injury_share, lodging_share
from plant_sim.planter.scatter import Ground
from plant_sim.planter.verdict import LODGED_DEG, FallVerdict, verdict_of

_KM_H = 3.6
_NONE: Final = 0.005
"""Share below which a verdict is not listed in the text."""
_NAMES: Final[Mapping[Ground, str]] = {Ground.RIGID: "rigid ground", Ground.SOIL: "bench soil"}


@dataclass(frozen=True)
class FallReport:
    """Report on the falls and the quality of planting at a motion.

    Attributes:
        planter: Parameters of the planter.
        motion: Motion of the planters.
        release_deg: Position of the opener on the bottom arc, degrees.
        tables: Stored tables of falls of the planter; a ground without a stored table is omitted.
    """

    planter: Planter
    motion: Motion
    release_deg: float
    tables: Mapping[Ground, FallTable]

    @property
    def equations(self) -> tuple[Share, Share]:
        """Lodging and injury according to equations 10 and 11, for cabbage blocks only."""
        setting = self.motion.speed_m_s * _KM_H, self.motion.frequency_per_min, self.planter.grip.clamp_n
        return lodging_share(*setting), injury_share(*setting)

    def record(self) -> dict[str, object]:
        """Return the results by name, in SI units, as JSON types."""
        lodging, injury = self.equations
        scatter, clamp_n = self.planter.scatter, self.planter.grip.clamp_n
        return {
            "grip": self._grip_record(),
            "falls": {ground.value: self._ground_record(ground) for ground in Ground} if self._is_rigid else None,
            "cabbage_blocks": {
                "lodging_equation_10": lodging._asdict(),
                "injury_equation_11": injury._asdict(),
                "sticking": scatter.stick_share_at(clamp_n),
                "injured": scatter.injured_share_at(clamp_n),
            },
        }

    def lines(self) -> list[str]:
        """Return the results as lines of plain text."""
        lodging, injury = self.equations
        beyond = "; beyond the tested levels" if lodging.extrapolated else ""
        lines = self._fall_lines() if self._is_rigid else ["falls               only simulated in model rigid"]
        return [
            *lines,
            self._grip_line(),
            f"cabbage blocks      lodging {100 * lodging.value:.2f} % (eq. 10), injury {100 * injury.value:.2f} % "
            f"(eq. 11) at {self.planter.grip.clamp_n:g} N{beyond}; not valid for pepper plugs",
        ]

    def _grip_record(self) -> dict[str, object]:
        """Return the grip from the conveyor to the opener; the largest acceleration is that of the arcs."""
        grip, block = self.planter.grip, self.planter.block
        return {
            "clamp_n": grip.clamp_n,
            "compression_m": grip.compression_m,
            "holds": grip.holds(block, self.motion.chain_m_s * self.motion.omega_rad_s),
            "crushed_share_of_printed_range": grip.crushed_share(),
            "free_s": grip.free_s,
            "open_s": grip.open_s(block),
            "clearance_m": grip.clearance_m(block),
        }

    def _grip_line(self) -> str:
        grip, block = self.planter.grip, self.planter.block
        holds = "holds" if self._grip_record()["holds"] else "does not hold"
        return (
            f"grip                {grip.clamp_n:g} N {holds} the block, "
            f"compressed by {1000 * grip.compression_m:.1f} mm; "
            f"free {1000 * grip.free_s:.1f} ms, open {1000 * grip.open_s(block):.1f} ms after the opener, "
            f"{1000 * grip.clearance_m(block):.1f} mm clearance on each side"
        )

    @property
    def _is_rigid(self) -> bool:
        return self.motion.model is MotionModel.RIGID

    def _ground_record(self, ground: Ground) -> dict[str, object]:
        fall = drop(self.planter, getattr(self.planter, ground), self.motion, opener_deg=self.release_deg)
        shares, is_inside = self._shares(ground)
        return {
            "verdict": verdict_of(fall.tilt_deg, fall.pushed_m).value,
            "tilt_deg": fall.tilt_deg,
            "pushed_m": fall.pushed_m,
            "settled": fall.rested or abs(fall.tilt_deg) >= LODGED_DEG,
            "shares": None if shares is None else {verdict.value: share for verdict, share in shares.items()},
            "shares_inside_table": is_inside,
        }

    def _shares(self, ground: Ground) -> tuple[dict[FallVerdict, float] | None, bool]:
        """Return the shares of the verdicts from the table of falls, and whether the table covers the motion."""
        if ground not in self.tables:
            return None, False
        at = self.motion.ratio, self.release_deg, self.motion.frequency_per_min
        return self.tables[ground].verdict_shares_at(*at)

    def _fall_lines(self) -> Iterator[str]:
        yield f"falls, opener at {self.release_deg:g}°"
        for ground in Ground:
            record = self._ground_record(ground)
            shares, is_inside = self._shares(ground)
            listed = "no table of these parameters; --falls DIR simulates it"
            if shares is not None:
                parts = [f"{100 * share:.0f} % {verdict}" for verdict, share in shares.items() if share > _NONE]
                listed = "; ".join([*parts, *([] if is_inside else ["outside the table, nearest point of it"])])
            unsettled = "" if record["settled"] else ", not at rest"
            yield f"  {_NAMES[ground]:<18}default block: {record['verdict']}{unsettled}"
            yield f"  {'':<18}random blocks: {listed}"
        stick = 100 * self.planter.scatter.stick_share_at(self.planter.grip.clamp_n)
        yield f"  {'':<18}sticking to a plate: {stick:.1f} % more lodge (bench soil)"
