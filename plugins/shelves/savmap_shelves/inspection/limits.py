"""Limits of an inspection of racks, with their sources.

EN 15635 and EN 15620 were not at hand: the figures are those that handbooks quote of them, and, for bent uprights, DGUV
Information 208-043, section 4.2.
"""

from typing import Annotated

from pydantic import Field

from savmap.plugin.inspection import UNVERIFIED, InspectionLimits, Limit

Metres = Annotated[float, Field(gt=0, lt=100)]
Least = Annotated[float, Field(ge=0, lt=10)]


class LoadUnit(InspectionLimits):
    """A load unit, such as a pallet with its goods: its size as it stands in a bay, metres."""

    name: str
    """What it is called in tables."""
    width_m: Metres
    """Along the aisle, with what hangs over the pallet."""
    height_m: Metres
    """With the pallet."""
    across: Annotated[int, Field(gt=0, le=20)] | None = None
    """How many stand beside one another. Default: as many as the bay takes."""
    levels: tuple[Annotated[int, Field(ge=0)], ...] = ()
    """The levels, from 0 on the floor, that must take it: a slot that does not is a finding."""


class Clearance(InspectionLimits):
    """What must be free around a load unit, metres, on load levels up to a height above the floor."""

    up_to_m: Metres
    """The highest load level that it holds for."""
    beside_m: Least
    """Between loads, and between a load and an upright."""
    above_m: Least
    """Between a load and the beam above it."""
    source: str = f"EN 15620, class 400; {UNVERIFIED}"
    """Where these numbers come from."""


class ShelvesLimits(InspectionLimits):
    """Limits of an inspection of racks."""

    lean_permille: Limit = Limit(
        amber=5.0, red=10.0, source=f"EN 15635: 5 mm in 1 m along the aisle, red at twice that; {UNVERIFIED}"
    )
    """Out of plumb of an upright along the aisle, mm in 1 m."""
    out_of_plumb_permille: Limit = Limit(
        amber=1000 / 350, red=2000 / 350, source=f"EN 15620: height / 350, red at twice that; {UNVERIFIED}"
    )
    """The same of a new rack: where a drawing is given, both hold."""
    bow_permille: Limit = Limit(
        amber=5.0,
        red=10.0,
        source=f"EN 15635: 5 mm under 1 m of straight edge along the aisle, pro rata, red at twice that; {UNVERIFIED}",
    )
    """How far an upright's middle lies beside the line between its ends, along the aisle, mm in 1 m of its height."""
    sag_share: Limit = Limit(
        amber=1 / 200, red=2 / 200, source=f"EN 15620: a beam's span / 200, red at twice that; {UNVERIFIED}"
    )
    """Sag of a beam, as a share of its span."""
    bay_width_mm: Limit = Limit(
        amber=3.0, red=6.0, source=f"EN 15620, class 400: clear entry +- 3 mm, red at twice that; {UNVERIFIED}"
    )
    """Clear width of a bay less the drawing's."""
    lowest_beam_mm: Limit = Limit(
        amber=10.0, red=20.0, source=f"EN 15620: lowest beam +- 10 mm, red at twice that; {UNVERIFIED}"
    )
    """Top of the lowest beam above the floor, less the drawing's."""
    beam_height_mm: Limit = Limit(
        amber=5.0, red=10.0, source=f"EN 15620: further beams +- 5 mm or height / 500, red at twice that; {UNVERIFIED}"
    )
    """Top of another beam above that of the lowest, less the drawing's."""
    beam_height_share: Annotated[float, Field(ge=0, lt=0.1)] = 1 / 500
    """Of that height: where it is more than the amber limit, it takes its place, and twice it that of the red one."""
    load_units: tuple[LoadUnit, ...] = ()
    """What the bays must take."""
    clearances: tuple[Clearance, ...] = (
        Clearance(up_to_m=3.0, beside_m=0.075, above_m=0.075),
        Clearance(up_to_m=6.0, beside_m=0.075, above_m=0.1),
        Clearance(up_to_m=9.0, beside_m=0.075, above_m=0.125),
        Clearance(up_to_m=99.0, beside_m=0.1, above_m=0.15),
    )
    """What must be free around loads, by height, the lowest first."""
