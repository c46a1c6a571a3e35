"""A job that updates an earlier map: what is wrong with that is told before anything is mapped, and no reference is needed."""

from pathlib import Path

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.jobs import cache_keys
from savmap.jobs.tasks import mapped_rows, request_for
from savmap.maps.map_file import write_map
from savmap.site.job import Job, job_for
from savmap.site.preflight import require_ready
from savmap.types import FrameTable, RowMap, SiteMap, Trajectory

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
VIDEO = Path(__file__).parents[2] / "savmap" / "demo" / "aisle-dev.mp4"


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    rows = {name: RowMap(name, FrameTable(np.zeros(0), ()), {}, path, {}, ()) for name in ("A", "B")}
    write_map(SiteMap(rows, {}), tmp_path / "before" / "map.json")
    return tmp_path / "before"


def job(earlier: Path, source: Path = VIDEO, row: str | None = None, output: str = "out") -> Job:
    return job_for(source, ["lights"], earlier.parent / output, against=earlier, against_row=row)


def test_a_pass_along_a_mapped_row_needs_no_reference(earlier: Path) -> None:
    require_ready(job(earlier))
    request = request_for(job(earlier), "1")
    assert list(request.against) == ["A", "B"]


def test_a_row_is_named_by_an_option_or_by_a_site_file(earlier: Path) -> None:
    assert list(mapped_rows(job(earlier, row="B"), "1")) == ["B"]
    assert list(mapped_rows(job(earlier, EXAMPLE), "A")) == ["A"]
    assert list(mapped_rows(job(earlier, EXAMPLE, "B"), "A")) == ["B"]
    assert list(mapped_rows(job(earlier, EXAMPLE), "another")) == ["A", "B"]
    assert mapped_rows(job_for(EXAMPLE, None, earlier.parent / "out"), "A") == {}


def test_a_row_that_the_map_has_not_is_refused(earlier: Path) -> None:
    with pytest.raises(SiteError, match=r"--row C: .*map.json has no such row; it has A, B"):
        require_ready(job(earlier, row="C"))


def test_the_map_is_not_written_over(earlier: Path) -> None:
    with pytest.raises(
        SiteError, match=r"--against: .*before/map.json: lies where this run writes its map; choose another -o"
    ):
        require_ready(job(earlier, output="before"))


def test_what_is_no_map_is_refused(earlier: Path) -> None:
    with pytest.raises(SiteError, match=r"--against: .*site.yaml"):
        require_ready(job(EXAMPLE / "site.yaml", output="out"))
    (earlier.parent / "none").mkdir()
    with pytest.raises(SiteError, match=r"--against: .*none/map.json.*; give a map.json or its folder"):
        require_ready(job(earlier.parent / "none"))


def test_options_that_do_not_go_together_are_refused(earlier: Path) -> None:
    with pytest.raises(SiteError, match="--trajectory and --against: give one of them"):
        job_for(VIDEO, ["lights"], Path("out"), earlier=earlier / "map.json", against=earlier)
    with pytest.raises(
        SiteError, match="--row A: says which row of an earlier map is filmed; give that with --against"
    ):
        job_for(VIDEO, ["lights"], Path("out"), against_row="A")


def test_a_known_path_is_that_of_a_map_or_its_folder(earlier: Path) -> None:
    for given in (earlier, earlier / "map.json"):
        assert job_for(VIDEO, ["lights"], Path("out"), earlier=given).earlier == earlier / "map.json"


def test_a_solution_depends_on_the_map_and_a_measurement_does_not(earlier: Path) -> None:
    measured = {"1": cache_keys.measurement_key(job(earlier), "1")}
    assert cache_keys.measurement_key(job(earlier, row="A"), "1") == measured["1"]
    before = cache_keys.solution_key(job(earlier), measured)
    assert cache_keys.solution_key(job(earlier, row="A"), measured) != before
    (earlier / "map.json").write_text((earlier / "map.json").read_text(encoding="utf-8") + " ", encoding="utf-8")
    assert cache_keys.solution_key(job(earlier), measured) != before
