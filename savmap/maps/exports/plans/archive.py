"""What formats of several files have in common: archives, JSON texts, and when they were made."""

import json
import os
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from savmap.files.texts import json_visible

FIRST_DATE = (1980, 1, 1, 0, 0, 0)
"""Of every file in an archive: the same content is the same bytes."""


def write_zip(path: Path, files: Mapping[str, bytes | str]) -> None:
    """Write files into a new archive. Raises OSError."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, FIRST_DATE)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)


def json_text(content: Mapping[str, Any]) -> str:
    """A JSON text, in which characters that do something to a terminal stand as escapes. Raises ValueError for NaN."""
    return json_visible(json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)) + "\n"


def timestamp() -> str:
    """Now, or the time of SOURCE_DATE_EPOCH where that is set: UTC as "2026-01-31T12:00:00.00Z"."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    seconds = int(epoch) if epoch.isdecimal() and len(epoch) < 12 else int(time.time())
    return time.strftime("%Y-%m-%dT%H:%M:%S.00Z", time.gmtime(seconds))
