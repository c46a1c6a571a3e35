"""Where the site file says that rows stand in the site's frame, and which rows it aligns the site by.

With `layout`, rows stand in a line at right angles to themselves. Its first row runs along the layout's x axis, on its
z = 0; the others follow towards +z. A face looks towards +z (heading 0) or back (heading 180), in turns: the gap in
front of a face is an aisle, the one behind it a rack. A row that is turned round has its origin at the far end, hence
needs its length.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from savmap.errors import SiteError
from savmap.files.validation import Location
from savmap.site.model import Site
from savmap.site.sections import AlignLine, AlignPoint, AlignSection, LayoutSection, PlaceSection
from savmap.types import Placement


def placements(site: Site) -> dict[str, Placement]:
    """The place of every row that has one, before anything was seen: the row's own `place`, else from the site's
    `layout`.

    Raises SiteError where `layout` does not fit the rows.
    """
    for location, text in misplaced(site.layout, with_places(site)):
        raise SiteError(f"{'.'.join(map(str, location))}: {text}")
    regular = _regular(site, site.layout) if site.layout else {}
    places = {name: row.place for name, row in site.rows.items() if row.place is not None}
    given = {name: _placement(place.x_m, place.z_m, place.heading_deg, place) for name, place in places.items()}
    return {name: {**regular, **given}[name] for name in site.rows if name in regular or name in given}


def with_places(site: Site) -> dict[str, bool]:
    """Rows by name, and whether each has a place of its own."""
    return {name: row.place is not None for name, row in site.rows.items()}


def misplaced(layout: LayoutSection | None, rows: Mapping[str, bool]) -> Iterator[tuple[Location, str]]:
    """What in `layout` does not fit the rows: the key, and what is wrong with it. rows: whether each has a place of its
    own."""
    if layout is None:
        return
    names = f"the site's rows are {', '.join(rows)}"
    named: list[tuple[Location, str]] = [
        *((("layout", "rows", n), name) for n, name in enumerate(layout.rows or ()) if name is not None),
        *((("layout", "lengths_m", name), name) for name in layout.lengths_m),
    ]
    yield from ((location, f"there is no row `{name}`; {names}") for location, name in named if name not in rows)
    twice = {name for name in layout.rows or () if name is not None and (layout.rows or ()).count(name) > 1}
    yield from ((("layout", "rows"), f"row `{name}` is given twice") for name in sorted(twice))
    for number, name in enumerate(_order(layout, rows)):
        if not rows.get(name, True) and _looks_back(layout, number) and _length(layout, name) is None:
            text = f"row `{name}` is turned round, so that its origin is at its far end: give `length_m`"
            yield ("layout",), text


def misaligned(align: AlignSection | None, rows: Iterable[str]) -> Iterator[tuple[Location, str]]:
    """What in `align` does not fit the rows: the key, and what is wrong with it."""
    names = list(rows)
    parts: Sequence[tuple[str, Sequence[AlignPoint | AlignLine]]] = ()
    if align is not None:
        parts = (("points", align.points), ("lines", align.lines))
    for kind, entries in parts:
        for number, entry in enumerate(entries):
            location = ("align", kind, number)
            if entry.row is None and len(names) > 1:
                yield location, f"say which `row` it is in; the site's rows are {', '.join(names)}"
            elif entry.row is not None and entry.row not in names:
                yield (*location, "row"), f"there is no row `{entry.row}`; the site's rows are {', '.join(names)}"


def _order(layout: LayoutSection, rows: Iterable[str]) -> tuple[str, ...]:
    """Names of rows in order; empty for a face that is not mapped."""
    return tuple(name or "" for name in (rows if layout.rows is None else layout.rows))


def _looks_back(layout: LayoutSection, number: int) -> bool:
    return (number % 2 == 1) == (layout.begins_with == "aisle")


def _length(layout: LayoutSection, name: str) -> float | None:
    return layout.lengths_m.get(name, layout.length_m)


def _regular(site: Site, layout: LayoutSection) -> dict[str, Placement]:
    site_from_layout = _placement(layout.x_m, layout.z_m, layout.heading_deg, layout).site_from_row
    placements: dict[str, Placement] = {}
    depth = 0.0
    for number, name in enumerate(_order(layout, site.rows)):
        back = _looks_back(layout, number)
        if name and site.rows[name].place is None:
            x_m = (_length(layout, name) or 0.0) if back else 0.0
            origin = site_from_layout @ np.array([x_m, 0.0, depth, 1.0])
            heading_deg = layout.heading_deg + (180.0 if back else 0.0)
            placements[name] = _placement(float(origin[0]), float(origin[2]), heading_deg, layout)
        depth += layout.rack_m if back else layout.aisle_m
    return placements


def _placement(x_m: float, z_m: float, heading_deg: float, sigmas: PlaceSection | LayoutSection) -> Placement:
    covariance = np.diag(np.square([sigmas.sigma_m, sigmas.sigma_m, sigmas.sigma_deg]))
    return Placement(x_m, z_m, 180 - (180 - heading_deg) % 360, covariance)
