"""Photographs that are not redistributed: fetched by address into a folder, and known by their digest.

An entry names the file: "repository" (owner/name on GitHub), "commit", "path", "sha256". In the folder it is SHA256.EXTENSION.
"""

import hashlib
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import SavmapError

PHOTOS = Path.home() / ".cache" / "savmap" / "photos"
WIDEST_PX = 1280
_TIMEOUT_S = 60


class PhotoMissingError(SavmapError):
    """A photograph that is neither in the folder nor to be had from its address."""


def photo(entry: Mapping[str, Any], folder: Path = PHOTOS) -> NDArray[np.uint8]:
    """The photograph (h, w, 3) RGB of an entry, from the folder, or from its address into the folder.

    Raises PhotoMissingError with the address where it cannot be had or is another file than it was.
    """
    path = folder / f"{entry['sha256']}{Path(entry['path']).suffix.lower()}"
    if not path.is_file():
        _fetch(entry, path)
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise PhotoMissingError(f"{path}: is damaged or another file; delete it, it is fetched again")
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if picture is None:
        raise PhotoMissingError(f"{path}: cannot be read as a picture")
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)


def scaled(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A photograph (H, W, 3) as it was labelled: at most 1280 px wide."""
    height, width = image.shape[:2]
    if width <= WIDEST_PX:
        return image
    size = WIDEST_PX, round(height * WIDEST_PX / width)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def address(entry: Mapping[str, Any]) -> str:
    """Where an entry's file is found."""
    return f"https://raw.githubusercontent.com/{entry['repository']}/{entry['commit']}/{quote(entry['path'])}"


def _fetch(entry: Mapping[str, Any], path: Path) -> None:
    where = address(entry)
    try:
        with urllib.request.urlopen(where, timeout=_TIMEOUT_S) as answer:
            content = answer.read()
    except OSError as error:
        raise PhotoMissingError(f"{where}: cannot be fetched ({error}); put the file there yourself: {path}") from error
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise PhotoMissingError(f"{where}: is another file now than it was (its digest is not {entry['sha256']})")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.part")
    partial.write_bytes(content)
    partial.replace(path)
