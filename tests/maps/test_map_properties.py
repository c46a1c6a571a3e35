"""Maps of any names and numbers: what is written is read, and written again is the same bytes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from savmap.maps.map_file import map_of, map_text
from savmap.types import (
    CrossRowMatch,
    FrameTable,
    Measured,
    Placement,
    ReferenceUse,
    RowMap,
    SiteMap,
    Structure,
    Trajectory,
    ViewSpec,
)

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
METRES = st.floats(-1e5, 1e5)
FIGURES = st.floats(-1e9, 1e9)
Draw = Callable[[st.SearchStrategy[Any]], Any]


@st.composite
def structures(draw: Draw) -> Structure:
    count = draw(st.integers(1, 4))
    roots = draw(arrays(np.float64, (count, 3, 3), elements=st.floats(-10, 10)))
    ends = st.lists(st.tuples(st.integers(0, count - 1), st.integers(0, count - 1)), max_size=3)
    measured = st.builds(Measured, FIGURES, st.floats(0, 1e6))
    return Structure(
        draw(TEXTS),
        draw(TEXTS),
        draw(arrays(np.float64, (count, 3), elements=METRES)),
        roots @ roots.transpose(0, 2, 1),
        tuple(draw(TEXTS) for _ in range(count)),
        np.array(draw(ends), np.int64).reshape(-1, 2),
        draw(st.dictionaries(TEXTS, st.one_of(FIGURES, st.integers(-(10**9), 10**9), TEXTS, measured), max_size=3)),
    )


@st.composite
def rows(draw: Draw, name: str) -> RowMap:
    count = draw(st.integers(0, 4))
    located = draw(st.lists(st.integers(0, count - 1), unique=True)) if count else []
    turns = draw(
        st.lists(st.tuples(*(4 * [st.floats(-1, 1)])).filter(lambda q: np.linalg.norm(q) > 0.1), min_size=4, max_size=4)
    )
    poses = np.tile(np.eye(4), (len(located), 1, 1))
    if located:
        poses[:, :3, :3] = Rotation.from_quat(turns[: len(located)]).as_matrix()
        poses[:, :3, 3] = draw(arrays(np.float64, (len(located), 3), elements=METRES))
    sigma = draw(arrays(np.float64, (len(located), 3), elements=st.floats(0, 1e5)))
    views = st.builds(
        ViewSpec, TEXTS, st.floats(-360, 360), st.floats(-90, 90), st.floats(-180, 180), st.floats(20, 170)
    )
    uses = st.builds(ReferenceUse, TEXTS, FIGURES, st.floats(1e-12, 1e3), FIGURES, TEXTS)
    return RowMap(
        name,
        FrameTable(
            draw(arrays(np.float64, (count,), elements=st.floats(0, 1e6))), tuple(draw(TEXTS) for _ in range(count))
        ),
        {view.name: view for view in draw(st.lists(views, max_size=2))},
        Trajectory(np.array(sorted(located), np.int64), poses, sigma),
        draw(st.dictionaries(TEXTS, st.lists(structures(), max_size=2).map(tuple), max_size=2)),
        tuple(draw(st.lists(uses, max_size=2))),
        draw(st.dictionaries(TEXTS, st.one_of(FIGURES, TEXTS, st.integers(-(10**9), 10**9)), max_size=3)),
    )


@st.composite
def maps(draw: Draw) -> SiteMap:
    names = draw(st.lists(TEXTS, max_size=2, unique=True))
    placed = st.builds(Placement, METRES, METRES, st.floats(-360, 360), st.just(np.diag([0.01, 0.02, 0.3])))
    axes = arrays(np.float64, (3,), elements=st.one_of(st.floats(-10, 10), st.just(float("nan"))))
    ties = st.builds(CrossRowMatch, TEXTS, TEXTS, TEXTS, TEXTS, axes, axes.map(np.abs))
    return SiteMap(
        {name: draw(rows(name)) for name in names},
        draw(st.dictionaries(TEXTS, TEXTS, max_size=2)),
        draw(st.dictionaries(TEXTS, TEXTS, max_size=2)),
        {name: draw(placed) for name in names},
        tuple(draw(st.lists(ties, max_size=2))),
    )


@pytest.mark.slow
@settings(max_examples=60)
@given(maps())
def test_any_map_that_is_written_is_read(site: SiteMap) -> None:
    text = map_text(site)
    read = map_of(text, "here")
    assert map_text(read) == text
    assert (list(read.rows), read.failed, read.made_by) == (sorted(site.rows), site.failed, site.made_by)
    for name, row in site.rows.items():
        other = read.rows[name]
        assert other.views.keys() == row.views.keys()
        assert other.frames.passes == row.frames.passes
        np.testing.assert_allclose(other.trajectory.world_from_rig, row.trajectory.world_from_rig, atol=1e-5, rtol=1e-9)
        for plugin, group in row.structures.items():
            for one, back in zip(group, other.structures[plugin], strict=True):
                assert (back.id, back.label, back.vertex_labels) == (one.id, one.label, one.vertex_labels)
                np.testing.assert_allclose(back.vertices, one.vertices, atol=1e-5)
                np.testing.assert_array_equal(back.edges, one.edges)
                assert back.attributes.keys() == one.attributes.keys()
