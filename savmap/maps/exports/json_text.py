"""JSON texts of exports, and when they were made."""

import json
import os
import time
from collections.abc import Mapping
from typing import Any

from savmap.files.texts import json_visible


def json_text(content: Mapping[str, Any]) -> str:
    """A JSON text, in which characters that do something to a terminal stand as escapes. Raises ValueError for NaN."""
    return json_visible(json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)) + "\n"


def timestamp() -> str:
    """Now, or the time of SOURCE_DATE_EPOCH where that is set: UTC as "2026-01-31T12:00:00.00Z"."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    seconds = int(epoch) if epoch.isdecimal() and len(epoch) < 12 else int(time.time())
    return time.strftime("%Y-%m-%dT%H:%M:%S.00Z", time.gmtime(seconds))
