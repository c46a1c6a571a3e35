"""Rays hit the faces they should, and masks say the class of what is there."""

import pickle
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from savmap.lab.commands import simulate as simulate_command
from savmap.lab.scenes import FACES, Box, Material
from savmap.lab.sim.render.raycast import Caster, RayCasterMissingError
from savmap.lab.sim.scene.files import Scene
from savmap.lab.sim.simulate import simulate

PAINT = Material((0.5, 0.5, 0.5))
CLASSES = ("upright", "beam")


def boxes() -> list[Box]:
    turn = np.diag([-1.0, 1.0, -1.0])
    return [
        Box(np.array([0.0, 1.0, -0.1]), np.array([0.1, 2.0, 0.2]), PAINT, face_labels={"+z": "upright"}),
        Box(np.array([0.0, 1.0, 4.1]), np.array([1.0, 0.1, 0.2]), PAINT, turn, face_labels={"+z": "beam"}),
    ]


def test_known_points_get_the_face_the_distance_and_the_label() -> None:
    caster = Caster(boxes())
    directions = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [0, -1.0, -1.95]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = caster.cast(np.array([0.0, 1.0, 2.0]), directions)
    assert hits.box.tolist() == [0, 1, -1, -1]
    assert [FACES[face] for face in hits.face[:2]] == ["+z", "+z"]
    np.testing.assert_allclose(hits.distance[:2], 2.0, atol=1e-6)
    assert np.isinf(hits.distance[2:]).all()
    np.testing.assert_allclose(hits.normal[:2], [[0, 0, 1], [0, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(hits.point[1], [0, 1, 4], atol=1e-6)
    assert caster.labels(hits, CLASSES).tolist() == [1, 2, 0, 0]
    assert caster.labels(hits, ("beam",)).tolist() == [0, 1, 0, 0]


def test_flanks_are_background_or_a_class_of_their_own() -> None:
    caster = Caster(boxes())
    hits = caster.cast(np.array([2.0, 1.0, -0.1]), np.array([[-1.0, 0.0, 0.0]]))
    assert FACES[hits.face[0]] == "+x"
    assert caster.labels(hits, CLASSES).tolist() == [0]
    assert caster.labels(hits, (*CLASSES, "upright_side")).tolist() == [3]


def test_every_face_of_a_turned_box_is_named_in_its_own_axes() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    box = Box(np.array([1.0, 2.0, 3.0]), np.array([0.2, 0.4, 0.6]), PAINT, turn)
    outward = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=float) @ turn.T
    hits = Caster([box]).cast(box.center + 5 * outward, -outward)
    assert hits.face.tolist() == list(range(6))
    np.testing.assert_allclose(hits.normal, outward, atol=1e-9)


def test_blocked_segments_end_at_their_reach() -> None:
    caster = Caster(boxes())
    start, ray = np.tile([0.0, 1.0, 2.0], (2, 1)), np.tile([0.0, 0.0, -1.0], (2, 1))
    assert caster.blocked(start, ray, np.array([1.9, 2.1])).tolist() == [False, True]


def test_a_caster_survives_pickling() -> None:
    caster = pickle.loads(pickle.dumps(Caster(boxes())))
    assert caster.cast(np.array([0.0, 1.0, 2.0]), np.array([[0.0, 0.0, -1.0]])).box.tolist() == [0]


def test_without_embreex_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(RayCasterMissingError, match="`sim` extra"):
        Caster(boxes())


def test_without_embreex_nothing_is_begun(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, scene_with: Callable[..., Scene]
) -> None:
    def begun(*_: object) -> None:
        raise AssertionError

    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    monkeypatch.setattr("savmap.lab.sim.simulate.build", begun)
    with pytest.raises(RayCasterMissingError, match="`sim` extra"):
        simulate(scene_with(), tmp_path / "out")
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_with().model_dump(mode="json")), encoding="utf-8")
    with pytest.raises(RayCasterMissingError, match="`sim` extra"):
        simulate_command(tmp_path / "scene.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists()
