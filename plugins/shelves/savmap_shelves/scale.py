"""Whether a rack's sizes are those of any rack: in feet, hardly any is."""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.types import MapWarning, Structure
from savmap_shelves.mapping import sections_of, uprights_of

PLAUSIBLE_M = {
    "uprights {} wide": (0.025, 0.22),
    "beams {} high": (0.02, 0.28),
    "uprights {} apart": (0.4, 6.5),
}
"""What racks have, half of their elements at least: from light shelving to heavy racks for long goods. In feet, hardly
any rack has all three."""


def implausible_scale(structures: Sequence[Structure]) -> Iterator[MapWarning]:
    """A warning where most sizes are those of no rack: what gives the scale is far off, whatever the pictures say."""
    uprights, beams = uprights_of(structures), [section.beams for section in sections_of(structures)]
    sizes = (
        np.diff(uprights.intervals, axis=1),
        np.concatenate([np.zeros((0, 1)), *(np.diff(group.intervals, axis=1) for group in beams)]),
        np.diff(uprights.intervals.mean(axis=1)),
    )
    usual = [float(np.median(values)) if values.size else None for values in sizes]
    odd = [
        text.format(f"{size:.2f} m")
        for (text, (least, most)), size in zip(PLAUSIBLE_M.items(), usual, strict=True)
        if size is not None and not least < size < most
    ]
    if odd:
        yield MapWarning("doubtful-scale", figure=odd[0], details=("no rack has such sizes", *odd[1:]))
