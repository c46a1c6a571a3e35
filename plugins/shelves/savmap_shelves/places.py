"""Which edges of the rack a track lies on, by its place."""

from savmap.types import Track

Column = tuple[int, str]
Row = tuple[int, int, str]


def is_foot(track: Track) -> bool:
    """Whether a track is where an upright stands on the floor."""
    return track.place.get("end") == "foot"


def column_of(track: Track) -> Column:
    """The upright's edge a track lies on: a beam ends at the right edge of its section's left upright and so on."""
    if track.label == "upright":
        return int(track.place["upright"]), str(track.place["side"])
    section = int(track.place["section"])
    return (section, "right") if track.place["side"] == "left" else (section + 1, "left")


def row_of(track: Track) -> Row:
    """The beam's edge a corner lies on."""
    return int(track.place["section"]), int(track.place["beam"]), str(track.place["edge"])
