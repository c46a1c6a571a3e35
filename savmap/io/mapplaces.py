"""Where rows stand in the site's frame, and what ties them together, as map.json has it and back."""

from typing import Any

import numpy as np

from savmap.io.mapnumbers import FIGURE, SIGMA, UPPER, rounded, significant, symmetric
from savmap.io.mapschema import PlacementEntry, TieEntry
from savmap.types import Floats, Placement, Tie


def placement_entry(own: Placement) -> dict[str, Any]:
    """A row's place."""
    x, z, heading = rounded((own.x_m, own.z_m, own.heading_deg), FIGURE)
    covariance = [significant(value) for value in own.covariance[UPPER]]
    return {"x_m": x, "z_m": z, "heading_deg": heading, "covariance": covariance}


def placement(own: PlacementEntry) -> Placement:
    """And back."""
    return Placement(own.x_m, own.z_m, own.heading_deg, symmetric(own.covariance))


def tie_entry(own: Tie) -> dict[str, Any]:
    """A thing that two rows see; null for what it does not tell."""
    names = {"row_a": own.row_a, "row_b": own.row_b, "id_a": own.id_a, "id_b": own.id_b}
    return {**names, "residual_m": _known(own.residual_m), "sigma_m": _known(own.sigma_m)}


def tie(own: TieEntry) -> Tie:
    """And back."""
    residual, sigma = (np.array(values, dtype=np.float64) for values in (own.residual_m, own.sigma_m))
    return Tie(own.row_a, own.row_b, own.id_a, own.id_b, residual, sigma)


def _known(values: Floats) -> list[float | None]:
    return [None if np.isnan(value) else rounded([value], SIGMA)[0] for value in values]
