"""Survey files are read strictly; what a row holds is left to the plugins."""

import json
from pathlib import Path
from typing import Any

import pytest

from savmap.errors import OutputError
from savmap.maps.survey import read_survey, write_survey
from savmap.types import Survey

GOOD: dict[str, Any] = {"format": "savmap-survey", "version": 1, "units": "m", "rows": {"A": {"things": [1, 2]}}}


def write(path: Path, **changes: Any) -> Path:
    path.write_text(json.dumps({key: value for key, value in {**GOOD, **changes}.items() if value is not None}))
    return path


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write_survey(Survey(GOOD["rows"]), tmp_path / "survey.json")
    assert read_survey(tmp_path / "survey.json") == Survey(GOOD["rows"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "savmap-map"}, "is a map, not a survey"),
        ({"format": "savmap-run"}, "is the record of a run, not a survey"),
        ({"format": ["savmap-map"]}, "is not a survey"),
        ({"format": None}, "is not a survey"),
        ({"version": 2}, "version 2; this program reads version 1"),
        ({"units": "ft"}, r"`units`: input should be 'm' \(it is 'ft'\)"),
        ({"units": None}, "`units` is missing"),
        ({"rows": {}}, "`rows`: at least 1 entry is expected"),
        ({"rows": {"A": [1]}}, r"`rows\.A`: a section with keys is expected"),
        ({"rows": {"A": {"things": [1, {"far": [-1e7]}]}}}, r"`rows`: -1e\+07 is too large"),
        ({"colour": "red"}, "unknown key `colour`: allowed here are format"),
    ],
)
def test_wrong_surveys_are_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = write(tmp_path / "survey.json", **changes)
    with pytest.raises(OutputError, match=message) as caught:
        read_survey(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_list_is_not_a_survey(tmp_path: Path) -> None:
    (tmp_path / "survey.json").write_text("[]")
    with pytest.raises(OutputError, match="is not a survey"):
        read_survey(tmp_path / "survey.json")
