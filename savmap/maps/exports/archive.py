"""Formats of several files: one zip archive, so that the whole is written or nothing."""

import zipfile
from collections.abc import Mapping
from pathlib import Path

MOMENT = (1980, 1, 1, 0, 0, 0)
"""Of every file in it: the same map gives the same bytes."""


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """A zip archive of these files, by their names in it. Raises OSError."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name, MOMENT), content, zipfile.ZIP_DEFLATED, 6)
