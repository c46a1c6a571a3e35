"""How long a strip is of which an end was never seen."""

import numpy as np
import pytest

from savmap.types import Structure
from savmap_lights.open_ends import common_length


def strips(*lengths: float) -> list[Structure]:
    ends = [np.array([[3.0 * k, 6, 1], [3.0 * k + length, 6, 1]]) for k, length in enumerate(lengths)]
    labels, edges = ("end 0", "end 1"), np.array([[0, 1]])
    return [Structure(f"light {k}", "light", own, np.zeros((2, 3, 3)), labels, edges) for k, own in enumerate(ends)]


def test_most_strips_have_one_length() -> None:
    assert common_length(strips(1.5, 1.51, 1.5, 1.49, 4.5)) == pytest.approx(1.5)


def test_strips_that_differ_or_are_few_have_none() -> None:
    assert common_length(strips(1.5, 1.5, 1.5)) is None
    assert common_length(strips(1.5, 1.5, 1.5, 1.5, 2.0, 2.4)) is None
