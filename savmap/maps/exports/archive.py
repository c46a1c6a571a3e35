"""Formats of several files: one zip archive, so that the whole is written or nothing."""

import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path

MOMENT = (1980, 1, 1, 0, 0, 0)
"""Of every file in it: the same map gives the same bytes."""

READABLE = stat.S_IFREG | 0o644
"""Of every file in it, for programs that unpack Unix permissions too."""


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """A zip archive of these files, by their names in it. Raises OSError."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            member = zipfile.ZipInfo(name, MOMENT)
            member.external_attr = READABLE << 16
            archive.writestr(member, content, zipfile.ZIP_DEFLATED, 6)
