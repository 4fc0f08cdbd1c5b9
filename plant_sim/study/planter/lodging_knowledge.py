"""Part of the report of ``planter-lodging`` on what the runs tell about the constants, and what they do not tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from controller.common.document.parts import Cell, Heading, Part, Table
from plant_sim.study.planter.lodging_posterior import LEVEL, NOT_LEARNED, Knowledge, Posterior

Posteriors = Mapping[str, tuple[Posterior, Posterior]]
"""Posteriors of lodging and of injury by data set."""

_RESPONSES: Final = ("lodging", "injury")


def knowledge_parts(posteriors: Posteriors) -> list[Part]:
    """Return the report parts on the posteriors."""
    rows: list[tuple[Cell, ...]] = []
    unknown: list[str] = []
    for data, constant in _constants(posteriors):
        prior = constant.prior
        ends = (prior.scale * prior.low, prior.scale * prior.high, constant.low, constant.high)
        rows.append((data, prior.name, *ends, constant.width, constant.learned))
        if constant.learned != "yes":
            unknown.append(f"{prior.name.partition(',')[0]} ({data}: {constant.learned})")
    numbers = "; ".join(
        f"{response}, {data}: {posterior.seedlings_per_dispersion:,.0f}"
        for data, both in posteriors.items()
        for response, posterior in zip(_RESPONSES, both, strict=True)
    )
    interval = f"{100 * LEVEL:.0f} %"
    return [
        Heading("What the runs tell"),
        "The constants above are those of the best fit. Here, all 23 runs are used and every value within wide limits "
        "is possible at first; number n of seedlings and dispersion φ of a run are not published and count as unknown. "
        "Constants that can replace each other, such as mean and standard deviation of the strength, stay uncertain "
        "together although the fit is good.",
        Table(
            "knowledge",
            f"Central {interval} intervals of the constants, before and after the runs",
            ("data", "constant", "limit", "limit ", "from", "to", "width, after to before", "learned"),
            tuple(rows),
        ),
        f"A constant counts as learned if its interval has at most {NOT_LEARNED:g} of the former width, and neither "
        "end is at a limit that was assumed. "
        + (f"Not learned: {'; '.join(unknown)}." if unknown else "All are learned by this measure.")
        + f" Seedlings n / φ that the scatter about the best model corresponds to: {numbers}. Deviations of the model "
        "itself are part of this scatter.",
    ]


def knowledge_record(posteriors: Posteriors) -> dict[str, object]:
    """Return the posteriors for the record of the study, in the units of the names."""
    return {
        data: {
            response: {
                "constants": {
                    each.prior.name: {
                        "interval": [each.low, each.high],
                        "width": each.width,
                        "learned": each.is_learned,
                    }
                    for each in posterior.constants
                },
                "seedlings_per_dispersion": posterior.seedlings_per_dispersion,
            }
            for response, posterior in zip(_RESPONSES, both, strict=True)
        }
        for data, both in posteriors.items()
    }


def _constants(posteriors: Posteriors) -> Iterator[tuple[str, Knowledge]]:
    for data, both in posteriors.items():
        for posterior in both:
            yield from ((data, constant) for constant in posterior.constants)
