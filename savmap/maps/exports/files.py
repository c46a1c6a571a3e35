"""JSON texts of exports, when they were made, and archives of several files."""

import json
import os
import stat
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from savmap.files.texts import json_visible

MOMENT = (1980, 1, 1, 0, 0, 0)
"""Of every file in an archive: the same map gives the same bytes."""
READABLE = stat.S_IFREG | 0o644
"""Of every file in it, for programs that unpack Unix permissions too."""


def json_text(content: Mapping[str, Any]) -> str:
    """A JSON text, in which characters that do something to a terminal stand as escapes. Raises ValueError for NaN."""
    return json_visible(json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)) + "\n"


def timestamp() -> str:
    """Now, or the time of SOURCE_DATE_EPOCH where that is set: UTC as "2026-01-31T12:00:00.00Z"."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    seconds = int(epoch) if epoch.isdecimal() and len(epoch) < 12 else int(time.time())
    return time.strftime("%Y-%m-%dT%H:%M:%S.00Z", time.gmtime(seconds))


def write_archive(path: Path, files: Mapping[str, bytes | str]) -> None:
    """A zip archive of these files, by their names in it: either all is written or nothing. Raises OSError."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            member = zipfile.ZipInfo(name, MOMENT)
            member.external_attr = READABLE << 16
            archive.writestr(member, content, zipfile.ZIP_DEFLATED, 6)
