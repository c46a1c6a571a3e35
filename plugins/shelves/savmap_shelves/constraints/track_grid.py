"""Which lines of the rack's grid tracks lie on: columns are edges of uprights, rows edges of beams."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from savmap.types import Track

Column = tuple[int, str]
Row = tuple[int, int, str]


@dataclass(frozen=True)
class TrackGrid:
    """Names of the tracks in each column (upright, side) and row (bay, beam, edge)."""

    columns: Mapping[Column, tuple[str, ...]]
    rows: Mapping[Row, tuple[str, ...]]

    @property
    def sections(self) -> tuple[int, ...]:
        """Bays that have beams, in order."""
        return tuple(sorted({section for section, _, _ in self.rows}))


def grid_of(tracks: Sequence[Track]) -> TrackGrid:
    """Tracks sorted into columns and rows by their place; feet and parts of edges are left out."""
    columns: dict[Column, list[str]] = {}
    rows: dict[Row, list[str]] = {}
    for track in tracks:
        if is_foot(track) or is_part(track):
            continue
        columns.setdefault(column_of(track), []).append(track.name)
        if track.label == "beam":
            rows.setdefault(row_of(track), []).append(track.name)
    return TrackGrid(
        {key: tuple(columns[key]) for key in sorted(columns)}, {key: tuple(rows[key]) for key in sorted(rows)}
    )


def is_foot(track: Track) -> bool:
    """Whether a track is where an upright stands on the floor."""
    return track.place.get("end") == "foot"


def is_part(track: Track) -> bool:
    """Whether a track is of the parts of an edge, by which its shape is measured once the map is solved."""
    return track.place.get("end") == "part"


def column_of(track: Track) -> Column:
    """The upright's edge that a track lies on."""
    if track.label == "upright":
        return int(track.place["upright"]), str(track.place["side"])
    return corner_column(int(track.place["bay"]), str(track.place["side"]))


def corner_column(section: int, side: str) -> Column:
    """The upright's edge that beams of a bay end at: on the left, the right edge of the bay's left upright."""
    return (section, "right") if side == "left" else (section + 1, "left")


def row_of(track: Track) -> Row:
    """The beam's edge that a corner lies on."""
    return int(track.place["bay"]), int(track.place["beam"]), str(track.place["edge"])
