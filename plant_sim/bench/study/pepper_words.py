"""What the pepper paper says in words of each factor by itself, and whether trials bear it out ([P], section 3.3).

The paper shows these results as pictures only. Its words have no numbers: what "low", "high" or "a little" means here
is ours, and stands beside each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Course = NDArray[np.float64]
"""A share of the seedlings at the seven levels of a factor, rising, %."""


@dataclass(frozen=True, slots=True)
class Sentence:
    """Something the paper says.

    Attributes:
        words: What it says.
        share: Of which failures.
        meaning: What is taken to bear it out.
        holds: Tells whether a course does.
    """

    words: str
    share: str
    meaning: str
    holds: Callable[[Course], bool]


FOAM: Final = (
    Sentence("7.5 mm and less: pick failures low", "F_p", "all below 5 %", lambda p: p[:3].max() < 5),
    Sentence("7.5 mm and less: carry failures high", "F_d", "all above those from 12.5 mm on",
             lambda d: d[:3].min() > d[4:].max()),
    Sentence("15 mm and more: pick failures up", "F_p", "both above 12.5 mm", lambda p: p[5:].min() > p[4]),
    Sentence("15 mm and more: carry failures far lower", "F_d", "both less than half of 7.5 mm",
             lambda d: d[5:].max() < d[2] / 2),
    Sentence("throw failures unchanged", "F_t", "less than 5 points apart", lambda t: bool(np.ptp(t) < 5)),
)  # fmt: skip
AGE: Final = (
    Sentence("43 d and less: pick failures high", "F_p", "both above those from 52 d on",
             lambda p: p[:2].min() > p[4:].max()),
    Sentence("43 d and less: carry failures high", "F_d", "both above those from 52 d on",
             lambda d: d[:2].min() > d[4:].max()),
    Sentence("52 d and more: pick failures fall", "F_p", "mean below 49 d", lambda p: p[4:].mean() < p[3]),
    Sentence("52 d and more: carry failures fall", "F_d", "mean below 49 d", lambda d: d[4:].mean() < d[3]),
)  # fmt: skip
PRESSURE: Final = (
    Sentence("0.25 MPa and less: plugs stay in their cells", "F_p", "both above 0.45 MPa",
             lambda p: p[:2].min() > p[3]),
    Sentence("0.65 MPa and more: stems are cut", "F_p", "both above 0.45 MPa", lambda p: p[5:].min() > p[3]),
    Sentence("carry failures fluctuate, then rise a little", "F_d", "mean from 0.65 MPa on above that up to 0.35",
             lambda d: d[5:].mean() > d[:3].mean()),
    Sentence("throw failures fall fast", "F_t", "at 0.15 MPa more than twice 0.35", lambda t: t[0] > 2 * t[2]),
    Sentence("throw failures then rise a little", "F_t", "mean from 0.55 MPa on above the lower of 0.35 and 0.45",
             lambda t: t[4:].mean() > t[2:4].min()),
)  # fmt: skip

SENTENCES: Final[Mapping[str, tuple[Sentence, ...]]] = {"foam": FOAM, "age": AGE, "pressure": PRESSURE}
"""By factor."""
