"""Files that people write, almost sound: each is used, or refused in a line. Hypothesis changes sound ones at some of their nodes."""

import contextlib
import copy
import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from savmap.demo import SITE
from savmap.errors import CONTROLS, SavmapError
from savmap.lab.sim.scene.files import load_scene, row_frame
from savmap.lab.train.data.sets import read_set
from savmap.maps.map_file import map_of, map_text, read_map
from savmap.maps.run_record import read_log
from savmap.maps.survey import read_survey
from savmap.report.page import page_text
from savmap.report.site_report import plugins_of_map, report_for
from savmap.site.job import job_for
from savmap.site.layout import placements
from savmap.site.load import problems_in, read_draft, sound_part
from savmap.site.preflight import footage, settings_problems, tells_scale
from savmap.site.references import calibration_of, references_of
from savmap.types import FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory, ViewSpec

SCENE = Path(__file__).parents[2] / "examples" / "scenes" / "short-row.yaml"
CLASSES = ("upright", "beam")
VALUES = st.one_of(
    st.sampled_from(["", ".", "/", "null", "yes", "NaN", "1e999", "99:99:99", "\x1b[2J", "a\x00b", "\ud800", "x" * 300, "<script>", "left", "A"]),
    st.sampled_from([0, -1, 255, 2**63, 10**30, 1e-9, 1e300, float("inf"), float("nan"), True, None, [], {}, [[[1]]], {"a": 1}]),
    st.text(max_size=12),
    st.integers(),
    st.floats(),
)  # fmt: skip


def paths(tree: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths of all nodes but the root."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from paths(value, (*at, key))


def edited(tree: Any, edits: list[tuple[int, Any]]) -> Any:
    """A tree with some nodes replaced, removed, repeated, renamed or wrapped."""
    tree = copy.deepcopy(tree)
    for number, value in edits:
        nodes = list(paths(tree))
        *above, key = nodes[number % len(nodes)]
        parent = tree
        for step in above:
            parent = parent[step]
        match random.Random(number).randrange(6):
            case 0:
                del parent[key]
            case 1 if isinstance(parent, list):
                parent.insert(key, copy.deepcopy(parent[key]))
            case 1:
                parent[str(value)[:99]] = parent.pop(key)
            case 2:
                parent[key] = [parent[key], value]
            case _:
                parent[key] = value
    return tree


def made_map() -> SiteMap:
    """A row of two uprights and a beam, and one of a sign."""
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 2, 0], [0, 2, 0]])
    spread, ring = np.tile(1e-4 * np.eye(3), (4, 1, 1)), np.array([[0, 1], [1, 2], [2, 3], [3, 0]])

    def structure(name: str, label: str, shift: float, **attributes: Any) -> Structure:
        labels = tuple(f"{name} / {corner}" for corner in ("lower left", "lower right", "upper right", "upper left"))
        return Structure(name, label, corners + np.array([shift, 0.0, 0.0]), spread, labels, ring, attributes)

    path = Trajectory(np.arange(3), np.tile(np.eye(4), (3, 1, 1)), np.full((3, 3), 0.01))
    table, views = FrameTable(np.arange(4) / 15, ("pass 1",) * 4), {"face": ViewSpec("face", 90.0)}
    posts = [structure(f"upright {number}", "upright", 2.7 * number) for number in range(2)]
    rack = (*posts, structure("bay 1 / beam 1", "beam", 0.1, bay=1, beam=1))
    sign = structure("sign 1", "sign", 1.0, text="A21-03", kind="plate")
    rows = {"A": RowMap("A", table, views, path, {"shelves": rack}, (), {"frames": 4, "note 1": "a remark"})}
    rows["B"] = RowMap("B", table, views, path, {"signs": (sign,)}, (), {})
    return SiteMap(rows, {"savmap": "0"}, {"C": "no such file"}, {"A": Placement(0.0, 0.0, 0.0, np.eye(3))})


def use_site(path: Path) -> None:
    draft = read_draft(path)
    if problems_in(draft):
        sound_part(draft)
    job = job_for(path, None, path.parent / "out")
    placements(job.site)
    [str(problem) for problem in (*settings_problems(job.site, job.plugins, job.places), *footage(job))]
    for row in job.site.rows:
        tells_scale(job.site, row, job.plugins)
        references_of(job.site.row_references(row))
        calibration_of(job.site.row_calibration(row))


def use_scene(path: Path) -> None:
    for place in load_scene(path).rows.values():
        row_frame(place)


def use_map(path: Path) -> None:
    site = read_map(path)
    text = map_text(site)
    assert map_text(map_of(text, "again")) == text
    assert set(CONTROLS.findall(text + page_text(report_for(site, plugins_of_map(site))))) <= {"\n"}


def use_survey(path: Path) -> None:
    site = made_map()
    assert set(CONTROLS.findall(page_text(report_for(site, plugins_of_map(site), read_survey(path))))) <= {"\n"}


def use_run(path: Path) -> None:
    site = made_map()
    page_text(report_for(site, plugins_of_map(site), None, read_log(path)))


def use_labels(path: Path) -> None:
    for place in (path.parent / "a.png", path.parent / "images" / "a.png", path.parent / "masks" / "a.png"):
        place.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(place), np.zeros((32, 64), np.uint8))
    for sample in read_set(path, CLASSES).samples:
        sample.load()


def _yaml(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


SHAPE = {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [[1, 1, 20, 1, 20, 20]], "iscrowd": 0}
RUN = {"status": "mapped", "seconds": {"solved": 1.5}, "used": 4}
COCO = {
    "images": [{"id": 1, "file_name": "a.png", "width": 64, "height": 32}],
    "annotations": [SHAPE, {**SHAPE, "id": 2, "segmentation": {"size": [32, 64], "counts": [10, 20, 2018]}, "iscrowd": 1}],
    "categories": [{"id": 1, "name": "upright"}, {"id": 2, "name": "beam"}],
}  # fmt: skip
KINDS: dict[str, tuple[Callable[[], Any], Callable[[Path], None]]] = {
    "site.yaml": (lambda: {**_yaml(SITE), "video": str(SITE.parent / "aisle-dev.mp4")}, use_site),
    "scene.yaml": (lambda: _yaml(SCENE), use_scene),
    "map.json": (lambda: json.loads(map_text(made_map())), use_map),
    "survey.json": (lambda: _yaml(SITE.parent / "survey.json"), use_survey),
    "run.json": (lambda: {"format": "savmap-run", "version": 1, "rows": {"A": RUN}, "wall_s": 2.0}, use_run),
    "coco.json": (lambda: COCO, use_labels),
    "dataset.json": (lambda: {"format": "savmap-dataset", "version": 1, "classes": [*CLASSES], "renderer": "x"}, use_labels),
}  # fmt: skip
"""By the file's name: a sound tree, and what is done with the file."""


def written(tree: Any, path: Path) -> Path:
    text = json.dumps(tree)
    if path.suffix == ".yaml":
        with contextlib.suppress(yaml.YAMLError, ValueError):  # JSON is YAML, too
            text = yaml.safe_dump(tree, sort_keys=False)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return path


@pytest.mark.parametrize("name", KINDS)
def test_sound_files_are_used(tmp_path: Path, name: str) -> None:
    make, use = KINDS[name]
    use(written(make(), tmp_path / name))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", KINDS)
def test_broken_files_are_refused_in_a_line_or_used(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    make, use = KINDS[name]
    sound = make()

    @settings(max_examples=40, phases=[Phase.generate])  # fmt: skip
    @given(st.lists(st.tuples(st.integers(0, 1 << 30), VALUES), min_size=1, max_size=3))
    def each(edits: list[tuple[int, Any]]) -> None:
        path = written(edited(sound, edits), tmp_path_factory.mktemp("broken") / name)
        try:
            use(path)
        except SavmapError as error:
            line = str(error)
            assert 0 < len(line.strip()) < 6000

    each()
