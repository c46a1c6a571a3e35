"""What two rows have of one rack, and beams of which an edge was measured nowhere."""

from dataclasses import replace

import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

from savmap.types import Structure
from savmap_shelves.mapping import DEEPEST_RACK_M, FRAME_SIGMA_M, UNKNOWN_M, cross_row_landmarks, with_usual_height


def thing(label: str, left: float) -> Structure:
    corners = np.array([[left, 0.0, 0], [left + 0.1, 0, 0], [left, 6, 0], [left + 0.1, 6, 0]])
    sigmas = np.array([1e-4, 0.012, 1e-4, 0.012])
    covariances = sigmas[:, None, None] ** 2 * np.eye(3)
    return Structure(f"{label} 1", label, corners, covariances, tuple("abcd"), np.zeros((0, 2), np.int64))


def test_uprights_are_shared_along_the_rack_with_its_other_face() -> None:
    (found,) = cross_row_landmarks([thing("upright", 3.6), thing("beam", 0.0)])
    assert (found.id, found.kind, found.axes, found.behind_m) == ("upright 1", "upright", ("x",), DEEPEST_RACK_M)
    assert np.isclose(found.place[0], 3.65)
    assert np.isclose(found.covariance[0, 0], 0.012**2 / 2 + 0.5e-8 + FRAME_SIGMA_M**2)


def beams_with_free_edges(*edges: str) -> list[Structure]:
    """The beams of a perfect map; these edges of one 1.2 to 1.3 m above the floor were measured nowhere, and lie below the other."""
    beams = [part for part in structures_of(surveyed_row()) if part.label == "beam"]
    vertices, covariances = beams[1].vertices.copy(), beams[1].covariances.copy()
    for edge in edges:
        own = slice(2) if edge == "lower" else slice(2, None)
        vertices[own, 1], covariances[own, 1, 1] = 1.24, 70.0**2
    beams[1] = replace(beams[1], vertices=vertices, covariances=covariances)
    return beams


@pytest.mark.parametrize("edge", ["lower", "upper"])
def test_an_edge_measured_nowhere_is_where_most_beams_have_it(edge: str) -> None:
    beams = with_usual_height(beams_with_free_edges(edge))
    np.testing.assert_allclose(beams[1].vertices[:, 1], [1.2, 1.2, 1.3, 1.3])
    assert 0.004 < np.sqrt(beams[1].covariances[0 if edge == "lower" else 2, 1, 1]) < 0.05
    assert beams[1].attributes["height_m"] == pytest.approx(0.1)


def taller(beam: Structure, by_m: float) -> Structure:
    return replace(beam, vertices=beam.vertices + np.outer([0.0, 0.0, by_m, by_m], [0.0, 1.0, 0.0]))


def test_a_section_of_beams_of_its_own_height_tells_its_hidden_edges() -> None:
    beams = [
        taller(beam, 0.04) if number != 1 and beam.attributes["bay"] == 1 else beam
        for number, beam in enumerate(beams_with_free_edges("upper"))
    ]
    own = [beam for beam in beams if beam.attributes["bay"] == 1]
    assert len(own) > 3
    assert with_usual_height(beams)[1].attributes["height_m"] == pytest.approx(0.14)


def test_an_edge_measured_nowhere_is_hardly_known_where_beams_are_of_many_heights() -> None:
    beams = beams_with_free_edges("upper")
    beams = with_usual_height([taller(beam, 0.04 * (number % 2)) for number, beam in enumerate(beams)])
    assert np.sqrt(beams[1].covariances[2, 1, 1]) > 0.015


def test_a_beam_of_which_no_edge_was_measured_is_at_no_one_place() -> None:
    beams = with_usual_height(beams_with_free_edges("lower", "upper"))
    assert np.sqrt(beams[1].covariances[:, 1, 1].max()) > 1


def test_a_beam_of_which_one_edge_was_not_even_tracked_is_left_out_where_no_other_tells_its_height() -> None:
    beams = [
        replace(beam, attributes={**beam.attributes, "height_sigma_m": UNKNOWN_M})
        for beam in beams_with_free_edges("upper")[1:2]
    ]
    assert with_usual_height(beams) == []


def test_few_beams_tell_anothers_height_roughly() -> None:
    beams = beams_with_free_edges("upper")[:2]
    _, guessed = with_usual_height(beams)
    height = beams[0].vertices[2, 1] - beams[0].vertices[0, 1]
    assert guessed.vertices[2, 1] - guessed.vertices[0, 1] == pytest.approx(height)
    assert np.sqrt(guessed.covariances[2, 1, 1]) == pytest.approx(0.25 * height, rel=0.1)


def test_a_beam_that_was_measured_stays() -> None:
    beams = beams_with_free_edges()
    assert with_usual_height(beams) == beams
