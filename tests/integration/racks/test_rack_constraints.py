"""The shelves' constraints and descriptions."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.errors import SiteError, StructureError
from savmap.graph import SolveOptions
from savmap.graph.joint_covariance import joint_covariance
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.constraints.sharing import share_edges
from savmap_shelves.mapping import describe


@pytest.fixture(scope="module")
def small() -> made.World:
    return made.world(8, sections=3, frames=40, bridge=1)


def test_columns_rows_plane_and_origin(small: made.World) -> None:
    own = constrain(small.tracks, small.facts, made.begin(small), settings=GridSettings(small.rack.lowest))
    names = {key: name for name, key in own.keys.items()}
    columns = 2 * len(small.rack.uprights)
    rows = 2 * sum(map(len, small.rack.beams))
    ties = {axis: [r for r in own.relations if r.axis == axis and r.b is not None] for axis in "xy"}
    assert len(ties["x"]) == len(own.keys) - columns
    assert len(ties["y"]) == rows
    assert sum(r.axis == "z" for r in own.relations) == len(own.keys)
    setbacks = [r for r in own.relations if r.axis == "z" and r.value != 0]
    assert [(r.value, r.sigma) for r in setbacks] == [(-0.005, 0.01)]
    origin = next(r for r in own.relations if r.axis == "x" and r.b is None)
    assert names[origin.a].startswith("upright 1 / left")
    heights = [r for r in own.relations if r.name]
    assert [r.value for r in heights] == pytest.approx(small.rack.lowest)
    assert all("beam 1 / lower" in names[r.a] for r in heights)
    assert own.coordinates["bay 2 / beam 1 / upper"][0] == "y"


def test_number_of_heights_must_match(small: made.World) -> None:
    with pytest.raises(SiteError, match="gives 2 values, but 3 bays were found"):
        constrain(small.tracks, small.facts, made.begin(small), settings=GridSettings([0.3, 0.3]))


def test_no_grid_is_an_error(small: made.World) -> None:
    uprights = [track for track in small.tracks if track.label == "upright"]
    with pytest.raises(StructureError, match="no uprights with beams"):
        constrain(uprights, small.facts, made.begin(small))


@pytest.mark.slow
def test_beams_may_stand_back(small: made.World) -> None:
    """Beams 1 cm behind the uprights: on one plane (as published) their heights are stretched, else it is found out."""
    set_back = made.world(8, sections=3, frames=40, bridge=1, setback_m=0.01)
    published, told, found = (
        np.abs(
            made.errors(set_back, made.solved(set_back, setback=setback, options=SolveOptions(judge=False)))[1]
        ).mean()
        for setback in ((0.0, 0.0), (0.01, 0.0), (0.0, 0.01))
    )
    assert told < 0.004
    assert found < 0.006
    assert published > 2 * found


def test_corners_share_their_uprights_line(small: made.World) -> None:
    """Three corners on one edge, without the upright's own ends, tell as much along the beam as one."""
    wanted = [f"bay 1 / beam {beam} / lower left" for beam in (1, 2, 3)]
    frame = small.tracks[0].frames[0]
    base = next(track for track in small.tracks if track.name == wanted[0])
    one = replace(
        base,
        frames=np.array([frame]),
        views=base.views[:1],
        pixels=np.array([[319.5, 239.5]]),
        covariances=np.diag([0.25, 0.16])[None],
    )
    three = [replace(one, name=name, place={**base.place, "beam": beam}) for beam, name in enumerate(wanted, 1)]
    shared, worth = share_edges(three, small.facts.views, made.begin(small, attitude_deg=0.0))
    for track in shared:
        assert track.covariances[0, 0, 0] == pytest.approx(3 * 0.25, rel=0.05)
        assert track.covariances[0, 1, 1] == pytest.approx(0.16, rel=0.05)
        assert worth[track.name] == pytest.approx([1 + 1 / 3])


def test_structures(small: made.World) -> None:
    solution = made.solved(small)
    structures = {structure.id: structure for structure in describe(small.tracks, solution)}
    assert len(structures) == len(small.rack.uprights) + sum(map(len, small.rack.beams))
    upright = structures["upright 2"]
    assert upright.vertices[:, 0] == pytest.approx(np.tile(small.rack.uprights[1], 2), abs=0.03)
    assert upright.attributes["width_m"] == pytest.approx(np.ptp(small.rack.uprights[1]), abs=0.01)
    assert 1e-4 < float(upright.attributes["width_sigma_m"]) < 0.01
    beam = structures["bay 3 / beam 2"]
    assert beam.vertices[:, 1] == pytest.approx(np.repeat(small.rack.beams[2][1], 2), abs=0.02)
    assert beam.attributes["height_m"] == pytest.approx(0.1, abs=0.01)
    assert beam.vertex_labels[0] == "bay 3 / beam 2 / lower left"
    assert np.linalg.eigvalsh(beam.covariances).min() >= 0


def test_a_corner_that_was_never_seen_is_where_its_lines_meet(small: made.World) -> None:
    tracks = [track for track in small.tracks if track.name != "bay 2 / beam 2 / upper right"]
    solution = made.solved(replace(small, tracks=tracks))
    structures = {structure.id: structure for structure in describe(tracks, solution, depth_m=0.9)}
    beam = structures["bay 2 / beam 2"]
    frame = structures["upright 1"].solid
    assert beam.solid is not None
    assert frame is not None
    assert (frame.depth.tolist(), frame.assumed, beam.solid.assumed) == ([0, 0, -0.9], False, True)
    across = np.diff(frame.outline[[0, 1, 2, 3, 0]], axis=0)
    assert (np.abs(across[:, :2]).min(axis=1) < 1e-6).all(), "the outline's corners are in order"
    assert beam.vertices[3] == pytest.approx([small.rack.uprights[2, 0], small.rack.beams[1][1, 1], 0], abs=0.02)


def test_distances_leave_out_what_both_ends_share(small: made.World) -> None:
    solution = made.solved(small)
    structures = describe(small.tracks, solution)
    joint = joint_covariance({"shelves": structures}, solution)
    assert joint is not None
    checked = 0
    for structure in structures:
        name, ends, axis = ("width", (0, 1), 0) if structure.label == "upright" else ("height", (0, 2), 1)
        covariance = joint.of_difference(*(("shelves", structure, end) for end in ends))
        wanted = float(structure.attributes[f"{name}_sigma_m"])
        assert covariance[axis, axis] ** 0.5 == pytest.approx(wanted, rel=0.02, abs=1e-4), structure.id
        checked += 1
    assert checked == len(structures) > 5
    far = joint.of_difference(("shelves", structures[0], 0), ("shelves", structures[0], 2))
    assert far[1, 1] == pytest.approx(structures[0].covariances[[0, 2], 1, 1].sum()), (
        "ends that were not measured share nothing"
    )
