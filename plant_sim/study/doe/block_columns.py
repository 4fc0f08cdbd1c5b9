"""Columns of a model matrix for blocks."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray


def block_columns(labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Return the columns of blocks, one less than there are labels; the last label is -1 in all of them.

    With this coding the constant of the model is the mean of the blocks, each of equal weight.

    >>> block_columns(["a", "b", "c"]).tolist()
    [[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]
    """
    distinct = list(dict.fromkeys(labels))
    coding = np.vstack([np.eye(len(distinct) - 1), -np.ones((1, len(distinct) - 1))])
    return np.asarray(coding[[distinct.index(label) for label in labels]], dtype=np.float64)
