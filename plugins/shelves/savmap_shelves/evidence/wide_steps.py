"""Steps from beam to beam that are too wide for their section: one between may be hidden."""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.types import Floats

FAR, LEAST_STEPS, EVEN, AMID = 1.6, 3, 1.5, 0.15
"""A step from beam to beam may hide one where it is so many times the usual of at least so many others of its section, the greatest of which is at most
`EVEN` times the least, and the sections beside have beams in it, not within this share of it at its ends: 60 simulated rows have no such step."""


def wide_steps(sections: Sequence[Floats]) -> Iterator[tuple[int, int, float]]:
    """Two beams of a section far further apart than its others, where the sections beside go on: the numbers of the section and of the lower beam, and the
    section's usual step. `sections`: heights (m,) from the bottom. One that stands in the shade behind goods may show in no frame. A passage or a
    pallet's place goes through the sections beside, too, or is in one of several."""
    for number, levels in enumerate(sections):
        steps = np.diff(levels)
        beside = [sections[k] for k in (number - 1, number + 1) if 0 <= k < len(sections)]
        for k, step in enumerate(steps.tolist()):
            others = np.delete(steps, k)
            if len(others) < LEAST_STEPS or others.max() > EVEN * others.min() or not beside:
                continue
            usual = float(np.median(others))
            low, high = levels[k] + AMID * step, levels[k + 1] - AMID * step
            if step > FAR * usual and all(((other > low) & (other < high)).any() for other in beside):
                yield number, k, usual
