"""Records as bytes: the very same come back, and nothing else can."""

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import pytest

from savmap.files.serialization import packed, unpacked
from savmap.pipeline.records import RowMeasurements
from savmap.types import Axis, Feature, FrameTable, RowFacts, ViewSpec
from savmap.vision.markers import MarkerTracks


def seen() -> RowMeasurements:
    rng = np.random.default_rng(3)
    features = [
        Feature(k, "pass 1 / face", "upright", "left", k, rng.normal(size=(2, 2)), rng.normal(size=(2, 2, 2)), "y", 0.1)
        for k in range(3)
    ]
    odd = Feature(
        0,
        "up",
        "lamp",
        "centre",
        0,
        np.zeros((1, 2)),
        np.eye(2)[None],
        neighbours={"left": 2},
        readings={"text:A21": 0.93},
    )
    facts = RowFacts(
        "A/1", FrameTable(np.array([0.1, 1 / 3]), ("pass 1",) * 2), {"up": ViewSpec("up", 0.5)}, {"pass 1": 1}
    )
    attitudes = {"pass 1": np.asfortranarray(rng.normal(size=(3, 3)))}
    return RowMeasurements(
        facts, {"racks": features, "lamps": [odd]}, attitudes, frozenset({"racks"}), ("a note",), MarkerTracks({}, {})
    )


def test_what_is_packed_comes_back_to_the_last_bit() -> None:
    before = seen()
    after = unpacked(packed(before), RowMeasurements)
    assert after.facts.views == before.facts.views
    assert (after.locators, after.notes, after.facts.name) == (before.locators, before.notes, "A/1")
    np.testing.assert_array_equal(after.facts.frames.stamps_s, before.facts.frames.stamps_s)
    np.testing.assert_array_equal(after.attitudes["pass 1"], before.attitudes["pass 1"])
    for name, features in before.features.items():
        assert_same(features, after.features[name])
    assert packed(after) == packed(before)


def assert_same(features: Sequence[Feature], others: Sequence[Feature]) -> None:
    for feature, other in zip(features, others, strict=True):
        for field in fields(Feature):
            np.testing.assert_array_equal(getattr(feature, field.name), getattr(other, field.name))
        assert list(feature.neighbours.items()) == list(other.neighbours.items())


def test_records_of_one_kind_stand_field_by_field() -> None:
    def feature(count: int, axis: Axis | None, neighbours: dict[str, int]) -> Feature:
        rng = np.random.default_rng(count)
        pixels, spread = rng.normal(size=(count, 2)), rng.normal(size=(count, 2, 2))
        return Feature(0, "up", "beam", "", count, pixels, spread, axis, 0.25, neighbours)

    before = (feature(1, None, {"left": 2}), feature(2, "x", {}), feature(2, "y", {"right": 1, "left": 0}))
    content = packed(before)
    after = unpacked(content, tuple)
    assert zlib.decompress(content).count(b"savmap.types.pictures") == 1
    assert_same(before, after)
    assert packed(after) == content


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "other"])
def test_damaged_bytes_are_refused(damage: str) -> None:
    whole = packed(seen())
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 64
    contents = {"cut": whole[:-20], "flipped": bytes(flipped), "empty": b"", "other": packed(ViewSpec("up", 0.0))}
    with pytest.raises(ValueError, match="not a stored RowMeasurements"):
        unpacked(contents[damage], RowMeasurements)


def test_bytes_make_nothing_but_records() -> None:
    tree = json.dumps({"record": ["savmap.files.serialization", "packed", ["y"]]}).encode()
    with pytest.raises(ValueError, match="not a record"):
        unpacked(zlib.compress(len(tree).to_bytes(8, "little") + tree), RowMeasurements)


def test_what_is_no_record_cannot_be_packed() -> None:
    @dataclass
    class Strange:
        number: int

    with pytest.raises(TypeError, match="Strange cannot be stored"):
        packed({"a": Strange(1)})
    with pytest.raises(TypeError, match="ndarray cannot be stored"):
        packed(np.array([object()]))
