"""Steps between beams that are too wide for their bay: a beam between may be hidden."""

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from savmap.types import Floats

FAR, LEAST_STEPS, EVEN, AMID = 1.6, 3, 1.5, 0.15
"""A step may hide a beam if all of these hold. It is `FAR` times the median of the bay's other steps. There are `LEAST_STEPS` others, the greatest
at most `EVEN` times the least. The bays beside, or beyond a passage, have beams in it, farther than a share `AMID` of it from its ends. 60 simulated
rows have no such step."""


def wide_steps(sections: Sequence[Floats]) -> Iterator[tuple[int, int, float]]:
    """Steps of a bay that are too wide, where the bays beside have beams: the numbers of the bay and of the lower beam, from 0, and the
    bay's median step.

    bays: heights (m,) of the beams, from the bottom. A beam in the shade behind goods may show in no frame. A passage or a pallet place is
    no such step: it goes through the bays beside too, or is one of several.
    """
    for number, levels in enumerate(sections):
        steps = np.diff(levels)
        for k, step in enumerate(steps.tolist()):
            others = np.delete(steps, k)
            if len(others) < LEAST_STEPS or others.max() > EVEN * others.min():
                continue
            usual = float(np.median(others))
            low, high = levels[k] + AMID * step, levels[k + 1] - AMID * step
            beside = [*_beside(sections, number, float(levels[k + 1]))]
            if step > FAR * usual and beside and all(((other > low) & (other < high)).any() for other in beside):
                yield number, k, usual


def _beside(sections: Sequence[Floats], number: int, height: float) -> Iterator[Floats]:
    """The nearest bay on either side that has a beam below a height: through a passage there is nothing to compare with."""
    for side in (reversed(sections[:number]), sections[number + 1 :]):
        yield from islice((levels for levels in side if (levels < height).any()), 1)
