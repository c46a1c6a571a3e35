"""A pipe above a rack, in the evidence of a face: it is no beam where no post reaches it and the beams below end with the row."""

import numpy as np
import pytest
from seen_faces import LEVELS, POSTS, WHOLE, is_whole, seen

from savmap_shelves.evidence import Grid, absent_beams, expected_grid

PIPE = np.array([4.2, 4.32])
TRACKED = Grid(POSTS, [np.vstack([LEVELS, PIPE]), LEVELS, np.vstack([LEVELS, PIPE])])
ALONG = (1, (-9.0, 18.0), (4.2, 4.32), 0.5)
FAINTLY = (0, (-0.1, 8.3), (4.0, 4.5), 0.3)
Change = tuple[int, tuple[float, float], tuple[float, float], float]


def test_a_pipe_above_the_posts_that_goes_on_beyond_the_row_is_no_beam() -> None:
    found = expected_grid(seen(ALONG), TRACKED)
    assert is_whole(found)
    assert found is not None
    assert [thing.outline[0, 1] for thing in absent_beams(TRACKED, found)] == pytest.approx([PIPE[0]] * 2)


def test_a_girder_that_no_post_reaches_is_no_beam_though_it_ends_with_the_row() -> None:
    assert is_whole(expected_grid(seen(ALONG, (1, (-9.0, 0.0), (4.1, 4.4), 0.0)), TRACKED))


def test_a_beam_that_posts_reach_stays_beside_a_girder_at_the_very_same_height() -> None:
    ends, reached = (1, (-9.0, 0.0), (4.1, 4.4), 0.0), (0, (5.4, 8.2), (4.0, 4.5), 0.9)
    found = expected_grid(seen(ALONG, ends, reached), TRACKED)
    assert found is not None
    assert [len(levels) for levels in found.sections] == [3, 3, 4]


def test_where_a_pipe_alone_was_tracked_the_beams_are_found() -> None:
    found = expected_grid(seen(ALONG), Grid(POSTS, [PIPE[None]] * 3))
    assert found is not None
    assert all(len(levels) >= 3 for levels in found.sections)


def test_a_pipe_before_the_posts_tops_is_no_beam() -> None:
    assert is_whole(expected_grid(seen(ALONG, (0, (-0.1, 8.3), (3.9, 4.26), 0.9)), TRACKED))


def test_a_pipe_is_not_found_where_it_was_not_tracked() -> None:
    assert expected_grid(seen(ALONG), WHOLE) is None


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param([(0, (-0.1, 8.3), (3.9, 4.4), 0.9)], id="posts reach it"),
        pytest.param([(1, (-9.0, 0.0), (4.1, 4.4), 0.0)], id="it ends with the row"),
        pytest.param(
            [(1, (-9.0, 18.0), (low, high), 0.8) for low, high in LEVELS.tolist()[1:]], id="beams below go on"
        ),
    ],
)
def test_a_level_above_stays_where_something_tells_otherwise(changes: list[Change]) -> None:
    found = expected_grid(seen(ALONG, FAINTLY, *changes), TRACKED)
    sections = (found or TRACKED).sections[::2]
    assert all(np.isclose(levels, PIPE, atol=0.03).all(axis=1).any() for levels in sections)


def test_a_girder_before_the_posts_that_was_not_tracked_is_no_beam() -> None:
    assert expected_grid(seen((1, (-9.0, 18.0), (3.8, 3.92), 0.9)), WHOLE) is None
