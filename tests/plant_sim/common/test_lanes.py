"""Compiled lanes compared with their plain form, which computes with numpy arrays."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.common.compiled import compiled_and_cached
from plant_sim.common.lanes import joined, lanes, pair, root, select, split, truths, unpacked


def combined(a: float, b: float, c: float, d: float) -> Any:
    """Apply every operation at least once; return 16 numbers and 4 truth values."""
    x, y = lanes(a, b, c, d), pair(c, a)
    quotients = (1.0 + x * 3.0) / (y - 0.5 * x)
    magnitudes = root(abs(-quotients))
    shut = (x <= y) & (magnitudes > 1.0) | (quotients < -2.0)
    chosen = select(shut, 0.0, select(x >= 0.25, magnitudes, 1.0))
    low, high = split(joined(quotients, magnitudes))
    return unpacked(quotients), unpacked(chosen), unpacked(low), unpacked(high), truths(shut)


compiled_combined = compiled_and_cached(combined)

numbers = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 0.25, 1.0, float("inf"), float("nan")])


@settings(derandomize=True)
@given(numbers, numbers, numbers, numbers)
def test_compiled_lanes_are_bit_identical_to_arrays(a: float, b: float, c: float, d: float) -> None:
    with np.errstate(all="ignore"):
        expected = combined(a, b, c, d)
    assert repr(compiled_combined(a, b, c, d)) == repr(expected)
