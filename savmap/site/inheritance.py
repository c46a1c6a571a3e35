"""What a site file leaves out, filled in before it is checked: passes take what their row and the site say."""

from collections.abc import Mapping
from typing import Any

INHERITED = ("video", "fps")
DIRECTIONS = {"left": "+x", "right": "-x"}


def completed(content: object) -> object:
    """A site's content with its passes' video, rate and views filled in from their row or the site, and rows' names as
    text.

    What is not as it should be is left as it is, for the checks that follow.
    """
    if not isinstance(content, Mapping) or not isinstance(content.get("rows"), Mapping):
        return content
    return {**content, "rows": {_text(name): _completed_row(row, content) for name, row in content["rows"].items()}}


def side_from_direction(one: object) -> object:
    """A pass's content with its side, where only its direction is given. Raises ValueError where the two contradict one
    another."""
    if not isinstance(one, Mapping) or one.get("direction") not in DIRECTIONS.values():
        return one
    side = next(side for side, direction in DIRECTIONS.items() if direction == one["direction"])
    if one.get("side") is None:
        return {**one, "side": side}
    if one["side"] in DIRECTIONS and one["side"] != side:
        raise ValueError(
            f"a face on the {one['side']} is passed towards {DIRECTIONS[one['side']]}, not {one['direction']}; "
            "correct `side` or `direction`"
        )
    return one


def without_video(schema: dict[str, Any]) -> None:
    """A pass's JSON Schema for files, in which the video may stand with the row or the site."""
    schema["required"] = [key for key in schema.get("required", []) if key != "video"]
    if not schema["required"]:
        del schema["required"]


def _completed_row(row: object, site: Mapping[Any, Any]) -> object:
    if not isinstance(row, Mapping) or not isinstance(row.get("passes"), list | tuple):
        return row
    return {**row, "passes": [_completed_pass(one, row, site) for one in row["passes"]]}


def _completed_pass(one: object, row: Mapping[Any, Any], site: Mapping[Any, Any]) -> object:
    if not isinstance(one, Mapping):
        return one
    levels = (site, row, one)
    found = {key: level[key] for level in levels for key in INHERITED if level.get(key) is not None}
    views = [level["views"] for level in levels if isinstance(level.get("views"), Mapping)]
    named = {name: view for own in views for name, view in own.items()}
    return {**levels[-1], **found, **({"views": named} if named else {})}


def _text(name: object) -> object:
    return str(name) if isinstance(name, int) and not isinstance(name, bool) else name
