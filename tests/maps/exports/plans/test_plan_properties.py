"""Maps of any names and numbers: plans of them are written, or refused in one line."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_map_properties import METRES, maps

from savmap.errors import SavmapError
from savmap.plugin.manager import exporters
from savmap.types import Alignment, SiteMap, Solid, Structure

PLANS = ("nav2", "lif", "geojson")
ALIGNMENTS = st.builds(
    Alignment,
    METRES,
    METRES,
    st.floats(-180, 180),
    st.just(np.diag([0.01, 0.02, 0.3])),
    st.floats(-100, 100),
    st.none() | st.tuples(st.floats(-85, 85), st.floats(-180, 180)),
)


def with_solids(site: SiteMap, depth: tuple[float, float, float]) -> SiteMap:
    def filled(structure: Structure) -> Structure:
        solid = Solid(structure.vertices, np.array(depth), assumed=True) if len(structure.vertices) > 2 else None
        return replace(structure, solid=solid)

    rows = {
        name: replace(row, structures={plugin: tuple(map(filled, group)) for plugin, group in row.structures.items()})
        for name, row in site.rows.items()
    }
    return replace(site, rows=rows)


@pytest.mark.slow
@settings(max_examples=40)
@given(maps(), st.tuples(st.floats(0.01, 2), st.floats(-2, 2), st.floats(-2, 2)), st.none() | ALIGNMENTS)
def test_any_map_is_written_or_refused_in_one_line(
    site: SiteMap, depth: tuple[float, float, float], alignment: Alignment | None
) -> None:
    filled = replace(with_solids(site, depth), alignment=alignment)
    for name in PLANS:
        with tempfile.TemporaryDirectory() as folder:
            path, refusal = Path(folder) / "a", ""
            try:
                exporters()[name](filled, path)
            except SavmapError as error:
                refusal = str(error)
            assert "\n" not in refusal
            assert refusal or path.stat().st_size > 0
