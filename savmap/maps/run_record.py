"""What the last run into a folder did with each row, and how it ended: run.json, apart from the map, which does not
depend on how long the run took."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from savmap.errors import OutputError
from savmap.files.atomic import read_json, sha256, write_text
from savmap.files.texts import json_visible
from savmap.files.validation import checked

LOG = "run.json"
Seconds = Annotated[float, Field(ge=0, le=1e9)]
Count = Annotated[int, Field(ge=0, le=10**9)]


class FootageFile(BaseModel):
    """What a pass was filmed into: the file's name, or a folder's, and the size of its pictures, pixels (0: not
    known)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    width: Count = 0
    height: Count = 0


class RowRun(BaseModel):
    """One row: mapped now, kept from an earlier run, or failed (and why). `seconds` on the clock by stage (decode, aim,
    render, segment, extract, track, solve, ...), of frames `used` and `skipped`, the worker's largest memory in MB, the
    plugins that failed in it, without which it was mapped, and its `footage` by pass."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    status: Literal["mapped", "kept", "failed"]
    error: str = ""
    seconds: dict[str, Seconds] = {}
    used: Count = 0
    skipped: Count = 0
    peak_mb: Seconds = 0.0
    plugins_failed: dict[str, str] = {}
    footage: dict[str, FootageFile] = {}


class RunLog(BaseModel):
    """All rows of a run by name, its whole time on the clock, how many workers there were, when it `ended` (UTC, ISO
    8601), and how: with the map of all rows, with a map that is `incomplete` (rows or plugins failed in it), or with no
    map at all (and why). `earlier_map`: the SHA-256 of the map.json that a run that failed found in its folder, and
    left there."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    format: Literal["savmap-run"] = "savmap-run"
    version: Literal[1] = 1
    status: Literal["mapped", "incomplete", "failed"] = "mapped"
    error: str = ""
    earlier_map: str = ""
    rows: dict[str, RowRun]
    wall_s: Seconds = 0.0
    jobs: int = 1
    ended: str = ""


def write_log(log: RunLog, path: Path) -> None:
    """Write run.json, whole or not at all. Raises OutputError."""
    write_text(path, json_visible(log.model_dump_json(indent=1)) + "\n")


def read_log(path: Path) -> RunLog:
    """A run.json. Raises OutputError with one line."""
    return checked(RunLog, read_json(path), str(path))


def failed_since(map_file: Path) -> RunLog | None:
    """The record of the last run into a map's folder, where that failed and left the map of an earlier one there; None
    where all is well, and where nothing tells."""
    try:
        log = read_log(map_file.parent / LOG)
        return log if log.status == "failed" and log.earlier_map == sha256(map_file) else None
    except OutputError:
        return None
