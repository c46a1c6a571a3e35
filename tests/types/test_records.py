"""Records that hold arrays: read-only, compared by identity, with a short `repr`, also after a pickle or a file."""

import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, is_dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import savmap
from savmap.files.serialization import packed, unpacked
from savmap.types import (
    CloseUp,
    CrossRowLandmark,
    CrossRowMatch,
    Detection,
    Drawing,
    Feature,
    FilmedPanorama,
    FindingTable,
    FlatParts,
    FoundObject,
    FrameTable,
    Panorama,
    PlanePatch,
    Planes,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)

PACKAGES = ("types", "geometry", "video", "vision", "split", "assembly", "maps")
SPEC = ViewSpec("face", 90.0, width=8, height=6)


def feature() -> Feature:
    return Feature(3, "face", "post", "left", 1, np.array([[1.0, 2.0]]), np.eye(2)[None])


def structure() -> Structure:
    return Structure("post 1", "post", np.zeros((2, 3)), np.zeros((2, 3, 3)), ("foot", "head"), np.array([[0, 1]]))


def row_map() -> RowMap:
    frames = FrameTable(np.array([0.0, 0.5]), ("pass 1", "pass 1"))
    trajectory = Trajectory(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.ones((2, 3)))
    return RowMap("A", frames, {"face": SPEC}, trajectory, {"posts": (structure(),)}, ())


def filmed() -> FilmedPanorama:
    half = np.full((4, 8), 128, np.uint8)
    return FilmedPanorama(0, 0.0, Planes(np.zeros((8, 16), np.uint8), half, half, np.eye(3, 4)))


MADE: dict[str, Callable[[], object]] = {
    "panorama": lambda: Panorama(0, 0.0, np.zeros((4, 8, 3), np.uint8)),
    "view": lambda: View(SPEC, 0, 0.0, np.zeros((6, 8, 3), np.uint8)),
    "feature": feature,
    "structure": structure,
    "row map": row_map,
    "site map": lambda: SiteMap({"A": row_map()}, {"savmap": "0"}),
    "match": lambda: CrossRowMatch("A", "B", "post 1", "post 2", np.zeros(3), np.ones(3)),
}


def array_classes() -> list[type]:
    """All dataclasses of these packages with a field that is an array."""
    root = Path(savmap.__file__).parent
    names = [
        ".".join(("savmap", *path.relative_to(root).with_suffix("").parts))
        for package in PACKAGES
        for path in sorted((root / package).rglob("*.py"))
    ]
    classes = {
        value
        for name in names
        for value in vars(import_module(name)).values()
        if isinstance(value, type) and is_dataclass(value) and value.__module__ == name
    }
    return sorted(
        (
            kind
            for kind in classes
            if any(str(own).startswith("numpy.ndarray") for own in kind.__annotations__.values())
        ),
        key=lambda kind: (kind.__module__, kind.__name__),
    )


@pytest.mark.parametrize("kind", array_classes(), ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_classes_with_arrays_are_array_records(kind: type) -> None:
    parameters = kind.__dataclass_params__  # type: ignore[attr-defined]
    if parameters.frozen:  # the others are working memory of one function
        assert not parameters.eq
        assert kind.__repr__.__name__ == "short_repr"


@pytest.mark.parametrize("name", MADE)
def test_equality_is_identity(name: str) -> None:
    record, other = MADE[name](), MADE[name]()
    assert record == record
    assert record != other
    assert len({record, other}) == 2


def test_arrays_cannot_be_written() -> None:
    record = feature()
    with pytest.raises(ValueError, match="read-only"):
        record.pixels[0, 0] = 5.0
    with pytest.raises(ValueError, match="read-only"):
        replace(record, score=0.5).covariance[0] = 0.0
    with pytest.raises(FrozenInstanceError):
        record.frame = 4  # type: ignore[misc]


def test_image_of_planes_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        filmed().image[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        filmed().planes.luma[0, 0] = 1


def test_callers_array_stays_writeable_and_is_not_copied() -> None:
    image = np.zeros((4, 8, 3), np.uint8)
    record = Panorama(0, 0.0, image)
    image[0, 0, 0] = 7
    assert image.flags.writeable
    assert np.shares_memory(record.image, image)
    assert record.image[0, 0, 0] == 7


def test_image_of_a_view_is_one_object() -> None:
    """Inference is remembered by a picture's identity."""
    view = View(SPEC, 0, 0.0, np.zeros((6, 8, 3), np.uint8))
    assert view.image is view.image


@pytest.mark.parametrize("name", MADE)
def test_repr_is_short(name: str) -> None:
    assert len(repr(MADE[name]())) < 700


def test_repr_gives_dtype_and_shape() -> None:
    assert "pixels=float64(1, 2), covariance=float64(1, 2, 2)" in repr(feature())
    assert repr(Trajectory(np.arange(9), np.tile(np.eye(4), (9, 1, 1)))) == (
        "Trajectory(frames=int64(9,), world_from_rig=float64(9, 4, 4), sigma_m=None)"
    )
    assert "passes=<tuple of 5>" in repr(FrameTable(np.zeros(5), ("pass 1",) * 5))


def test_pickled_records_stay_read_only() -> None:
    record = pickle.loads(pickle.dumps(feature()))
    np.testing.assert_array_equal(record.pixels, feature().pixels)
    assert not record.pixels.flags.writeable
    assert not pickle.loads(pickle.dumps(filmed())).planes.luma.flags.writeable


@pytest.mark.parametrize("name", ["feature", "structure", "row map", "match"])
def test_stored_records_come_back_read_only(name: str) -> None:
    record = MADE[name]()
    found = unpacked(packed(record), type(record))
    assert repr(found) == repr(record)
    assert packed(found) == packed(record)
    assert all(not own.flags.writeable for own in vars(found).values() if isinstance(own, np.ndarray))


def test_view_specs_are_equal_by_value() -> None:
    assert replace(SPEC) == SPEC
    assert len({SPEC, replace(SPEC)}) == 1


NAN, MASK = float("nan"), np.ones((6, 8), np.bool_)
FRONT = PlanePatch("front", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: ViewSpec("up", NAN), "an angle of view `up` is not finite"),
        (lambda: ViewPlan((SPEC,), 2 * np.eye(3)), "world_from_rig is not a rotation"),
        (lambda: ViewPlan((SPEC,), travel=2), "travel is 2"),
        (lambda: Detection("post", NAN, MASK, MASK.astype(np.float32)), "its score is not finite"),
        (lambda: replace(FRONT, origin=np.full(3, NAN)), "a number of `front` is not finite"),
        (lambda: replace(FRONT, up=np.eye(3)[0]), "right and up of `front` are not orthonormal"),
        (lambda: FoundObject("post 1", "post", np.full((3, 3), NAN), 1.0), "a corner of `post 1` is not finite"),
        (lambda: FlatParts("post 1", "y", (FRONT,)), "`front` is not parallel to the others, across y"),
        (lambda: FlatParts("post 1", "z", (FRONT,), NAN), "proud_m must be finite"),
        (lambda: FlatParts("post 1", "z", (FRONT,), 0.0, 0.0), "proud_sigma_m positive"),
        (lambda: Solid(np.full((3, 3), NAN), np.ones(3), True), "outline or depth is not finite"),
        (lambda: CrossRowLandmark("post 1", "post", np.full(3, NAN), np.eye(3)), "`post 1` is not finite"),
        (lambda: Drawing("point", np.full((1, 3), NAN), "mapped", "fixture", "posts"), "a point of `posts`"),
        (lambda: CloseUp("post 1", "post 1", np.zeros((2, 3))), "it has no width or no height"),
        (lambda: FindingTable("A table", "A", (), ()), "a name is small letters and -"),
    ],
)
def test_records_refuse_numbers_that_cannot_be(make: Callable[[], object], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        make()
