"""What an earlier run kept, believed only where it is what a run keeps: a file that was forged or spoilt is done
again."""

import logging
from collections.abc import Callable, Collection, Mapping
from typing import TypeVar

import numpy as np

from savmap.files.serialization import unpacked
from savmap.jobs.cache import StoredRecord
from savmap.pipeline.measure import RowMeasurements
from savmap.types import Feature, RowFacts, RowMap, SiteMap
from savmap.vision.markers import MarkerTracks

log = logging.getLogger("savmap")
Record = TypeVar("Record")


def kept_map(row: str, content: bytes) -> StoredRecord[RowMap] | None:
    """A row's map; None where the bytes hold none of that row that could be written to map.json and read again."""
    return _believed(row, content, RowMap, _require_map)


def kept_measurements(row: str, content: bytes, plugins: Collection[str]) -> StoredRecord[RowMeasurements] | None:
    """What was measured in a row; None where the bytes hold nothing of that row and its plugins."""
    return _believed(row, content, RowMeasurements, lambda name, record: _require_measured(name, record, plugins))


def _believed(
    row: str, content: bytes, kind: type[Record], require_sound: Callable[[str, Record], None]
) -> StoredRecord[Record] | None:
    try:
        record = unpacked(content, kind)
        require_sound(row, record)
    except Exception as error:  # whatever bytes that nobody vouches for may do
        log.warning("row %s: what an earlier run kept cannot be used, and is done again: %s", row, error)
        return None
    return StoredRecord(kind, record, content)


def _require_map(row: str, record: RowMap) -> None:
    from savmap.maps.map_file import map_of, map_text  # loads the JSON Schema's library, which few runs need

    _require(record.name == row, f"it is of row {record.name}")
    map_of(map_text(SiteMap({row: record}, {})), f"row {row}")


def _require_measured(row: str, record: RowMeasurements, plugins: Collection[str]) -> None:
    facts = record.facts
    _require(isinstance(facts, RowFacts) and facts.name == row, "it is of another row")
    _require(isinstance(record.marks, MarkerTracks), "its markers are none")
    _require(set(record.features) == set(plugins), "it is of other plugins")
    items = [item for features in record.features.values() for item in features]
    _require(all(isinstance(item, Feature) for item in items), "its features are none")
    _require(all(0 <= item.frame < len(facts.frames) for item in items), "a feature is of a frame that is not there")
    _require(all(item.view in facts.views for item in items), "a feature is of a view that is not there")
    sound = isinstance(record.attitudes, Mapping) and all(_is_turn(turn) for turn in record.attitudes.values())
    _require(sound, "an attitude is no rotation")
    _require(isinstance(record.failed, Mapping) and isinstance(record.locators, frozenset), "its plugins are no names")


def _is_turn(turn: object) -> bool:
    return isinstance(turn, np.ndarray) and turn.shape == (3, 3) and bool(np.isfinite(turn).all())


def _require(condition: bool, fault: str) -> None:
    if not condition:
        raise ValueError(fault)
