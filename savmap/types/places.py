"""Where a pass lies in a row of an earlier map."""

from dataclasses import dataclass

from savmap.types.common import Floats, array_record


@dataclass(frozen=True, eq=False)
@array_record
class RowPlace:
    """A pass laid into a mapped `row`: (x, y) of the row are `scale` times those of the pass, and `shift_m` (2,), with
    the covariance (3, 3) of scale and shift. `pairs`: plugin, id in the pass and id in the map of what is in both, from
    left to right; `scatter_m`: how far pairs are off, about; `score`: the log-likelihood against that of no row;
    `height_sigma_m`: the usual standard deviation of a height in the row's map, where one was measured."""

    row: str
    scale: float
    shift_m: Floats
    covariance: Floats
    pairs: tuple[tuple[str, str, str], ...]
    scatter_m: float
    score: float
    height_sigma_m: float = float("nan")

    @property
    def ends(self) -> str:
        """The first and the last element of the row that the pass shows, in words."""
        return f"{self.row}: {self.pairs[0][2]} to {self.pairs[-1][2]}"
