"""Rounds of training and mapping, with made-up networks and maps: what is kept, and what is not done again."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from savmap.errors import SavmapError, SiteError, StructureError
from savmap.lab.adapt import rounds, run
from savmap.lab.adapt.labels import SETS, LabelSets
from savmap.lab.adapt.records import Adapted, AdaptOptions, State
from savmap.lab.adapt.rounds import Adaptation
from savmap.lab.commands import adapted_lines
from savmap.lab.train import TrainedNetwork, TrainingPlan
from savmap.maps.map_file import write_map
from savmap.site.job import Job
from savmap.site.model import Row, Site
from savmap.types import FrameTable, MapWarning, RowMap, SiteMap, Trajectory, Verdict
from savmap.types.progress import NoteCollector

from .filmed_wall import BOXES, CLASSES, quad


def map_of(count: int) -> SiteMap:
    """A map with so many structures."""
    frames, path = FrameTable(np.zeros(1), ("pass 1",)), Trajectory(np.arange(1), np.eye(4)[None])
    structures = {"posts": tuple(quad(name) for name in list(BOXES)[:count])}
    return SiteMap({"A": RowMap("A", frames, {}, path, structures, ())}, {})


@dataclass
class Works:
    """Stands for training and mapping: IoU after each round, and what mapping gives each time, a number of structures or an error."""

    iou: list[float]
    maps: list[int | SavmapError]
    before: float = 0.5
    elsewhere: Sequence[float] = (0.8, 0.8, 0.8)
    jobs: list[Job] = field(default_factory=list)
    trained: list[TrainingPlan] = field(default_factory=list)
    teachers: list[TrainingPlan] = field(default_factory=list)

    def train(self, plan: TrainingPlan, progress: object) -> TrainedNetwork:
        teaches = plan.output.stem == rounds.TEACHER
        (self.teachers if teaches else self.trained).append(plan)
        after = 0.1 if teaches else self.iou[len(self.trained) - 1]
        for file in (plan.output, plan.integers):
            file.write_text(f"network {len(self.teachers)}")
        scores = {"before": self.before, "after": after, "int8": after}
        iou = {when: {"iou": dict.fromkeys(CLASSES, value)} for when, value in scores.items()}
        number = len(self.trained) - 1
        there = (0.8, *self.elsewhere)
        others = {when: {"iou": dict.fromkeys(CLASSES, there[number + (when != "before")])} for when in iou}
        sets = {path.name: iou if path.name == "held-out" else others for path in plan.held_out}
        return TrainedNetwork(plan, (plan.output, plan.integers), {"scores": sets})

    def map(self, job: Job, options: object, monitor: object) -> Any:
        self.jobs.append(job)
        outcome = self.maps[len(self.jobs) - 1]
        if isinstance(outcome, SavmapError):
            raise outcome
        write_map(map_of(outcome), job.output / "map.json")
        return SimpleNamespace(site_map=map_of(outcome), failed_rows={})

    def label(self, job: Job, plugin: str, site_map: SiteMap, count: int, folder: Path, monitor: object) -> Any:
        for name in SETS:
            (folder / name / "images").mkdir(parents=True, exist_ok=True)
            (folder / name / "images" / "a.jpg").touch()
        return LabelSets(*(folder / name for name in SETS))


@contextmanager
def meter(doing: str) -> Iterator[Any]:
    yield lambda done, line: None


def adaptation(folder: Path, others: Path | None = None, **options: Any) -> Adaptation:
    (folder / "adapted").mkdir(parents=True, exist_ok=True)
    lengths = [{"between": ["post 1 / left", "post 9 / right"], "value": 2.0, "sigma": 0.01}]
    site = Site(rows={"A": Row(passes=[{"video": folder / "a.mp4"}], references={"lengths": lengths})})
    job = Job(site, folder / "site.yaml", ["posts"], folder)
    return Adaptation(
        job,
        "posts",
        CLASSES,
        AdaptOptions(**options),
        (),
        folder / "adapted",
        NoteCollector(),
        meter,
        others,
    )


def adapted(
    works: Works,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    others: Path | None = None,
    **options: Any,
) -> Adapted:
    monkeypatch.setattr(rounds, "train", works.train)
    monkeypatch.setattr(rounds, "distilled", lambda network, source, folder, *rest: folder)
    monkeypatch.setattr(rounds, "map_job_into", works.map)
    monkeypatch.setattr(rounds, "write_labels", works.label)
    monkeypatch.setattr(run, "_agreement", lambda work, model, number: dict.fromkeys(CLASSES, 0.4))
    work = adaptation(folder, others, **options)
    for name in ("first.onnx", "first.int8.onnx"):
        (folder / name).write_text(name)
    write_map(map_of(2), folder / "map.json")
    first = State(folder / "first.int8.onnx", folder / "first.onnx", folder / "map.json", map_of(2))
    results, state = run._rounds(work, first)
    return run._finished(work, first, state, results)


def test_rounds_go_on_while_they_are_better(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    works = Works([0.6, 0.7], [2, 3])
    done = adapted(works, tmp_path, monkeypatch)
    assert [one.kept for one in done.rounds] == [True, True]
    assert (done.structures_before, done.structures_after) == (2, 3)
    assert works.trained[1].init == works.teachers[1].init == tmp_path / "adapted" / "round-1" / "posts.onnx"
    used = works.jobs[1].site.plugin_config("A", "posts")["model"]
    assert used == str(tmp_path / "adapted" / "round-2" / "posts.int8.onnx")
    assert (tmp_path / "adapted" / "posts.int8.onnx").read_text() == "network 2"
    report = json.loads((tmp_path / "adapted" / "report.json").read_text())
    assert report["iou"] == {"before": {"post": 0.4, "plank": 0.4}, "after": {"post": 0.7, "plank": 0.7}}
    assert any(line.endswith("adapted/posts.int8.onnx}}") for line in adapted_lines(done))


def test_teacher_learns_from_the_map_and_the_network_from_the_teacher(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    works = Works([0.6], [2])
    done = adapted(works, tmp_path, monkeypatch, rounds=1, steps=10)
    (teacher,), (student,), folder = works.teachers, works.trained, tmp_path / "adapted" / "round-1"
    assert (teacher.data, teacher.choose_by, teacher.steps) == ([folder / "views"], [folder / "choice"], 4)
    assert (student.data, student.choose_by) == ([folder / "distilled-views"], [folder / "distilled-choice"])
    assert (student.init, student.steps) == (teacher.init, 6)
    assert (teacher.replay_every, student.replay_every) == (4, 1)
    assert teacher.one_site
    assert student.one_site
    assert done.rounds[0].iou_after == dict.fromkeys(CLASSES, 0.6)


def test_no_better_network_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = adapted(Works([0.5], []), tmp_path, monkeypatch)
    assert [(one.kept, one.structures_after) for one in done.rounds] == [(False, None)]
    assert "agrees no better" in done.rounds[0].why
    assert "the network stays as it is" in list(adapted_lines(done))
    assert not (tmp_path / "adapted" / "posts.onnx").exists()


@pytest.mark.parametrize(("elsewhere", "kept"), [((0.9, 0.81), True), ((0.796, 0.796), True), ((0.9, 0.7), False)])
def test_a_second_round_may_lose_what_the_first_gained_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elsewhere: Sequence[float], kept: bool
) -> None:
    works = Works([0.6, 0.7], [2, 2], elsewhere=elsewhere)
    done = adapted(works, tmp_path, monkeypatch, others=tmp_path / "other-places", rounds=2)
    assert [one.kept for one in done.rounds] == [True, kept]


@pytest.mark.parametrize(("elsewhere", "kept"), [(0.85, True), (0.797, True), (0.7, False)])
def test_network_that_forgets_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elsewhere: float, kept: bool
) -> None:
    works = Works([0.6], [2], elsewhere=[elsewhere])
    done = adapted(works, tmp_path, monkeypatch, others=tmp_path / "other-places", rounds=1)
    assert done.rounds[0].kept is kept
    assert kept or done.rounds[0].why == "the network does worse on pictures of other places"
    assert any(f"on other places 0.800 before, {elsewhere:.3f} after" in line for line in adapted_lines(done))
    report = json.loads((tmp_path / "adapted" / "report.json").read_text())
    assert report["other places"]["before"] == dict.fromkeys(CLASSES, 0.8)
    assert report["rounds"][0]["others_after"] == dict.fromkeys(CLASSES, elsewhere)


def test_forgetting_that_is_not_measured_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = adapted_lines(adapted(Works([0.6], [2]), tmp_path, monkeypatch, rounds=1))
    assert any("other places: not measured" in line for line in lines)


def test_poorer_map_ends_the_rounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = adapted(Works([0.6, 0.7], [3, 2]), tmp_path, monkeypatch)
    assert [one.kept for one in done.rounds] == [True, False]
    assert done.rounds[1].why == "the new map has fewer structures that nothing warns of"
    assert (tmp_path / "adapted" / "posts.onnx").read_text() == "network 1"
    assert done.structures_after == 3


def test_structures_that_are_doubted_do_not_count(tmp_path: Path) -> None:
    """Three, one of them doubted, are no more than two that nothing warns of."""
    site_map = map_of(3)
    row = site_map.rows["A"]
    name = row.structures["posts"][0].id
    verdict = Verdict((MapWarning("uncertain-element", (name,)), MapWarning("lens-seam")))
    doubted = replace(site_map, rows={"A": replace(row, verdict=verdict)})
    counts = [
        (state.structures("posts", CLASSES), state.sound("posts", CLASSES))
        for state in (State(tmp_path, tmp_path, tmp_path, one) for one in (map_of(2), doubted))
    ]
    assert counts == [(2, 2), (3, 2)]


@pytest.mark.parametrize(
    ("mapped", "sound", "why"),
    [
        (2, 396, "the network agrees better with the map"),
        (2, 395, "the new map has fewer structures that nothing warns of"),
        (1, 400, "fewer rows can be mapped with the new network"),
    ],
)
def test_one_in_a_hundred_structures_is_chance_but_no_row(
    mapped: int, sound: int, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def state(rows: int, sound: int) -> Any:
        site_map = SimpleNamespace(rows=dict.fromkeys(range(rows)))
        return SimpleNamespace(model=tmp_path, site_map=site_map, structures=lambda *_: 400, sound=lambda *_: sound)

    monkeypatch.setattr(rounds, "_state_of", lambda *_, **__: state(mapped, sound))
    scores = {"held-out": {"before": {"post": 0.5}, "after": {"post": 0.6}}}
    result, _ = rounds._judged(adaptation(tmp_path), 1, tmp_path, state(2, 400), scores, None)
    assert (result.why, result.kept) == (why, sound == 396)


def test_row_that_is_lost_ends_the_rounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = adapted(Works([0.6], [StructureError("row A: too few posts")]), tmp_path, monkeypatch)
    assert done.rounds[0].why == "the site cannot be mapped with the new network: row A: too few posts"
    assert done.kept is None


def test_missing_reference_does_not_end_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    works = Works([0.6], [SiteError("row A: reference to 'post 9'"), 3])
    done = adapted(works, tmp_path, monkeypatch, rounds=1)
    assert done.kept is not None
    assert [len(one.site.row_references("A").lengths) for one in works.jobs] == [1, 0]
    assert works.jobs[0].token != works.jobs[1].token


@pytest.mark.parametrize(("steps", "trainings"), [(7, 0), (8, 2)])
def test_finished_rounds_are_not_played_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int, trainings: int
) -> None:
    first = adapted(Works([0.6, 0.7], [2, 3]), tmp_path, monkeypatch, steps=7)
    again = Works([0.6, 0.7], [2, 3])
    second = adapted(again, tmp_path, monkeypatch, steps=steps)
    assert len(again.trained) == len(again.jobs) == trainings
    assert [replace(one) for one in second.rounds] == list(first.rounds)
    assert second.structures_after == 3


def test_map_without_outlines_teaches_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rounds, "map_job_into", Works([], [0]).map)
    work, network = adaptation(tmp_path), tmp_path / "first.onnx"
    network.write_text("first.onnx")
    with pytest.raises(StructureError, match=r"first/map.json: has no outlines of `posts` \(.*\) to learn from"):
        run.first_state(work, network, network, network, tmp_path / "map.json")
