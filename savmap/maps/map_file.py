"""A SiteMap as map.json and back. The same map always gives the same bytes.

Coordinates are rounded to 0.01 mm, standard deviations to 0.001 mm, covariances to six digits, quaternions to nine
decimals.
"""

import json
import os
import re
from contextlib import suppress
from pathlib import Path

from savmap.errors import OutputError
from savmap.files.atomic import read_json, write_text
from savmap.files.texts import json_of, json_visible
from savmap.files.urls import where
from savmap.files.validation import checked
from savmap.maps.schema import FORMAT, VERSION, MapFile, require_format
from savmap.types import SiteMap

NUMBER_LIST = re.compile(r"\[\n\s*([-+.\deE,\s]+?)\s*\n\s*\]")


def map_in(source: Path) -> Path:
    """A map file, or that of a folder."""
    return source / "map.json" if os.path.isdir(source) else source  # no error for names that no file can have


def require_other(output: Path | None, *maps: Path) -> None:
    """Raise OutputError where something else would be written over a map that is read."""
    for path in maps if output is not None else ():
        with suppress(OSError, ValueError):  # names that no file can have are told where they are written
            if os.path.samefile(str(output), path):
                raise OutputError(f"{output}: is the map itself; choose another file")


def write_map(site: SiteMap, path: str | Path) -> None:
    """Write map.json, whole or not at all. Raises OutputError."""
    write_text(where(path), map_text(site))


def read_map(path: Path) -> SiteMap:
    """The map in a map.json. Raises OutputError with one line: file, place, problem."""
    try:
        return _site_map(read_json(path), str(path))
    except OutputError as error:
        if os.path.exists(path):
            raise
        raise OutputError(f"{error}: there is no map; `savmap map` makes one") from None


def map_of(text: str, where: str) -> SiteMap:
    """The map in a text that was read at `where`. Raises OutputError as `read_map` does."""
    try:
        return _site_map(json_of(text), where)
    except ValueError as error:
        raise OutputError(f"{where}: is not JSON ({error})") from error


def map_text(site: SiteMap) -> str:
    """The text of map.json: keys sorted, numbers rounded, arrays of numbers on one line. Raises OutputError on NaN."""
    content = MapFile.of(site).model_dump(by_alias=True)
    try:
        text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False)
    except ValueError as error:
        raise OutputError(f"the map holds a number that is not finite ({error}); it was not written") from error
    return json_visible(NUMBER_LIST.sub(lambda match: "[" + " ".join(match[1].split()) + "]", text)) + "\n"


def _site_map(content: object, path: str) -> SiteMap:
    require_format(content, path, "map", FORMAT, VERSION)
    return checked(MapFile, content, path).made()
