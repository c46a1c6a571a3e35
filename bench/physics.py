"""Ways to be wrong about a row, and how mapping it ends: `trusted` and right, `check`, or refused. Never silently wrong.

    python -m bench physics [--rows demo 5000 5003] [--parts references units passes drives cameras] [--only WORDS] [--keep DIR]

A case changes what is said of a row: its site file's content (`references`, `units`), which clips it names (`passes`), or the clip itself: there
and back, cuts, gaps, harmless changes (`drives`), and, of simulated rows, what real cameras give (`cameras`). A map is wrong where the change put an edge further from the truth than 3 of its sigmas and 1 cm. It is silent about that unless the row
ends as `check` or refused. A number as a row is the seed of a random one; another row's references are those of the next row, or of one of the
usual rows where there is no next. With `--keep`, each case's result is kept in DIR/physics.json, and is not measured again.
"""

import argparse
import copy
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bench.baseline import Figures
from bench.clip_cases import DRIVES, ClipCase, camera_cases
from bench.clips import read, write
from bench.rows import footage
from bench.seeds import is_test
from savmap.demo import SITE
from savmap.errors import SavmapError, SiteError
from savmap.files.atomic import write_text
from savmap.jobs.cache import FolderCache
from savmap.jobs.scheduler import RunOptions, map_rows_of
from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.render.panorama import encode, frames
from savmap.lab.sim.render.shade import renderer
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import load_scene
from savmap.site.job import Job
from savmap.site.load import draft_of, site_of
from savmap.site.locations import SourceMap
from savmap.types import RowMap
from savmap.types.progress import SilentMonitor
from savmap.types.verdicts import WARNINGS, WarningCode

ROW, PLUGIN = "A", "shelves"
TIMES = (3, 10, 30)
FOOT_M = 0.3048
Content = dict[str, Any]


@dataclass(frozen=True)
class Filmed:
    """A row that was filmed: the folder of its footage, its site file's content, its survey, the next row's content and folder, and a folder
    for changed clips."""

    name: str
    folder: Path
    content: Content
    survey: Mapping[str, Any]
    other: Content
    other_folder: Path
    scratch: Path


@dataclass(frozen=True)
class Case:
    """A way to be wrong: `change` gives the site's content and the folder that its footage is in. A warning of one of the `codes`, or a refusal,
    must contain one of the `words`; without words, there is to be none."""

    name: str
    change: Callable[[Filmed], tuple[Content, Path]]
    words: tuple[str, ...] = ()
    codes: Sequence[WarningCode] = ("reference-conflict", "doubtful-scale")


def given(content: Content) -> Content:
    """The row's own references, which the site's are moved into."""
    row = content["rows"][ROW]
    row["references"] = {**content.pop("references", {}), **row.get("references", {})}
    own: dict[str, Any] = row["references"]
    return own


def heights(content: Content) -> list[float]:
    """The lowest edges' heights, bay by bay."""
    values: list[float] = content["rows"][ROW]["plugins"][PLUGIN]["lowest_beam_bottom_height_m"]["values"]
    return values


def references_only(change: Callable[[Content, Content], None]) -> Callable[[Filmed], tuple[Content, Path]]:
    """A case of the references alone: `change(site, other site)` alters the site's content in place."""

    def changed(row: Filmed) -> tuple[Content, Path]:
        content = copy.deepcopy(row.content)
        given(content)
        change(content, row.other)
        return content, row.folder

    return changed


def camera_off(metres: float, laser: bool = True) -> Callable[[Content, Content], None]:
    def change(site: Content, _: Content) -> None:
        given(site)["camera_height_m"]["value"] += metres
        if not laser:
            given(site)["lengths"] = []

    return change


def length_as(change: Callable[[float], float]) -> Callable[[Content, Content], None]:
    def changed(site: Content, _: Content) -> None:
        length = given(site)["lengths"][0]
        length["value"] = change(length["value"])

    return changed


def height_off(section: int, metres: float) -> Callable[[Content, Content], None]:
    def change(site: Content, _: Content) -> None:
        heights(site)[section] += metres

    return change


def heights_as(order: Callable[[list[float]], list[float]]) -> Callable[[Content, Content], None]:
    def change(site: Content, _: Content) -> None:
        heights(site)[:] = order(heights(site))

    return change


def swapped(values: list[float]) -> list[float]:
    """The two neighbours that differ most are swapped."""
    at = int(np.argmax(np.abs(np.diff(values))))
    return [*values[:at], values[at + 1], values[at], *values[at + 2 :]]


def others_heights(site: Content, other: Content) -> None:
    values = heights(other)
    heights(site)[:] = [values[number % len(values)] for number in range(len(heights(site)))]


def others_length(site: Content, other: Content) -> None:
    row = copy.deepcopy(other)
    given(site)["lengths"][0]["value"] = given(row)["lengths"][0]["value"]


def others_everything(site: Content, other: Content) -> None:
    row = copy.deepcopy(other)
    others_heights(site, other)
    others_length(site, other)
    given(site)["camera_height_m"] = given(row)["camera_height_m"]


def one_bay_short(site: Content, _: Content) -> None:
    between = given(site)["lengths"][0]["between"]
    given(site)["lengths"][0]["between"] = [between[0], f"upright {len(heights(site))} / right"]


def with_length(between: Sequence[str], value: float, axis: str = "x") -> Callable[[Content, Content], None]:
    """One more length, of a laser or a tape."""

    def change(site: Content, _: Content) -> None:
        more = {"between": list(between), "value": value, "sigma": 0.003, "axis": axis}
        given(site)["lengths"] = [*given(site)["lengths"], more]

    return change


def with_point(vertex: str, value: float) -> Callable[[Content, Content], None]:
    """A surveyed place along the aisle."""

    def change(site: Content, _: Content) -> None:
        given(site)["points"] = [{"vertex": vertex, "axis": "x", "value": value, "sigma": 0.003}]

    return change


def case(name: str, change: Callable[[Content, Content], None], *words: str) -> Case:
    """A case of the references alone."""
    return Case(name, references_only(change), words)


def reference_cases(row: Filmed) -> Iterator[Case]:
    """Each reference off by some sigmas and by slips of the hand, of other kinds, given twice, or measured to the wrong edge."""
    yield Case("nothing wrong", references_only(lambda _, __: None), codes=tuple(WARNINGS))
    for times in TIMES:
        yield case(f"camera height {times} sigma off", camera_off(0.02 * times), "camera height")
        yield case(f"length {times} sigma off", length_as((0.003 * times).__add__), "length")
        for section in range(len(heights(row.content))):
            off = 0.002 * times
            name = f"height of the lowest edge of bay {section + 1}"
            yield case(f"height {section + 1} {times} sigma off", height_off(section, off), name)
    last = len(heights(row.content))
    yield case("a height typed 5 cm too high", height_off(last - 1, 0.05), f"bay {last}")
    yield case("a height typed 5 cm too low", height_off(0, -0.05), "bay 1")
    yield case("two heights swapped", heights_as(swapped), "height of the lowest edge")
    yield case("a height in cm", heights_as(lambda values: [*values[:-1], 100 * values[-1]]), "bay", "values")
    yield case("heights in cm", heights_as(lambda values: [100 * value for value in values]), "height", "values")
    yield case("heights in units of 100 m", heights_as(lambda values: [value / 100 for value in values]), "height")
    for metres in (-0.5, -0.1, 0.1, 0.5):
        yield case(f"camera {metres:+.1f} m", camera_off(metres), "camera height")
        yield case(f"camera {metres:+.1f} m, no laser", camera_off(metres, laser=False), "camera height")
    yield case("length in units of 10 m", length_as(lambda value: 0.1 * value), "length")
    yield case("length to the upright before", one_bay_short, "length")
    yield case("another row's heights", others_heights, "height of the lowest edge", "its height is not used")
    yield case("another row's length", others_length, "length")
    yield case("another row's references", others_everything, "height", "camera", "length")
    yield case("heights from the other end", heights_as(lambda values: values[::-1]), "height of the lowest edge")
    yield case("heights one bay on", heights_as(lambda values: [*values[1:], values[-1]]), "height of the lowest edge")
    yield case("a camera height in feet", camera_off(2.281 * camera_height(row)), "camera height")
    first, last = row.survey["uprights"][0], row.survey["uprights"][-1]
    between = given(copy.deepcopy(row.content))["lengths"][0]["between"]
    length = last[1] - first[0]
    width = sum(upright[1] - upright[0] for upright in (first, last))
    beam = row.survey["sections"][0]["beams"][0]
    height = beam[1] - beam[0]
    edges = [f"bay 1 / beam 1 / {edge}" for edge in ("lower", "upper")]

    yield case("length between inner edges", length_as(lambda value: value - width), "length")
    upper = heights_as(lambda values: [value + height for value in values])
    yield case("heights of the upper edges", upper, "height")
    yield case("the length given twice", with_length(between, length))
    yield case("twice, once 5 cm more", with_length(between, length + 0.05), "length")
    yield case("twice, once 50 cm more", with_length(between, length + 0.5), "length")
    yield case("a tape's length", with_length(edges, height, "y"))
    words = ("length bay 1", "height of the lowest edge of bay 1")
    yield case("a tape's length 5 cm off", with_length(edges, height + 0.05, "y"), *words)
    x = row.survey["uprights"][1][0]
    yield case("a surveyed place", with_point("upright 2 / left", x))
    yield case("a surveyed place 10 cm off", with_point("upright 2 / left", x + 0.1), "surveyed")
    yield case("a place from the other end", with_point("upright 2 / left", length - x), "surveyed")
    bay, pitch = ("upright 2 / left", "upright 3 / left"), row.survey["uprights"][2][0] - row.survey["uprights"][1][0]
    yield case("a bay's width", with_length(bay, pitch))
    yield case("a bay's width 5 cm off", with_length(bay, pitch + 0.05), "length")
    yield case("a bay's width 50 cm off", with_length(bay, pitch + 0.5), "length")


def all_in(unit_m: float) -> Callable[[Content, Content], None]:
    """Everything in another unit: nothing contradicts anything."""

    def change(site: Content, _: Content) -> None:
        own = given(site)
        own["camera_height_m"]["value"] /= unit_m
        for length in own["lengths"]:
            length["value"] /= unit_m
        heights(site)[:] = [value / unit_m for value in heights(site)]

    return change


def unit_cases(row: Filmed) -> Iterator[Case]:
    """References in feet."""
    size = "metres"
    yield case("everything in feet", all_in(FOOT_M), size)
    more = camera_height(row) * (1 / FOOT_M - 1)
    yield case("a camera height in feet, no laser", camera_off(more, laser=False), size, "camera height")
    yield case("a length in feet", length_as(lambda value: value / FOOT_M), "length")
    yield case("heights in feet", heights_as(lambda values: [value / FOOT_M for value in values]), "height")


def camera_height(row: Filmed) -> float:
    return float(given(copy.deepcopy(row.content))["camera_height_m"]["value"])


FOOTAGE: Sequence[WarningCode] = ("bad-panorama", "stretched-pictures", "lens-seam", "missing-frames", "camera-motion")
"""The codes of warnings about the footage."""
ANYTHING = ("contradict", "bays were found", "no such thing", "part of the row", "the rest says", "height", "fit")


def with_passes(passes: Callable[[list[Content], Content], list[Content]]) -> Callable[[Filmed], tuple[Content, Path]]:
    """A case of which clips show the row: of its passes and another row's."""

    def changed(row: Filmed) -> tuple[Content, Path]:
        content, other = copy.deepcopy(row.content), {**row.other["rows"][ROW]["passes"][0]}
        other["video"] = str(row.other_folder / other["video"])
        content["rows"][ROW]["passes"] = passes(content["rows"][ROW]["passes"], other)
        return content, row.folder

    return changed


def pass_cases(row: Filmed) -> Iterator[Case]:
    """The references are right, but of another clip; in simulated rows the mast is raised half-way, and its height given as before."""
    second, every = (*ANYTHING, "pass 2", "passes 1 and 2"), tuple(WARNINGS)
    yield Case("another row's clip", with_passes(lambda _, other: [other]), ANYTHING, every)
    yield Case(
        "another row's clip as a second pass", with_passes(lambda passes, other: [*passes, other]), second, every
    )
    yield Case("the clip twice, as two passes", with_passes(lambda passes, _: 2 * passes), second[:-1], every)
    if (row.folder / "scene.yaml").is_file():
        video = row.scratch / "raised.mp4"
        if not video.is_file():
            render_raised(row.folder / "scene.yaml", 0.3, video)
        codes = tuple(code for code, kind in WARNINGS.items() if not kind.of_elements and code != "incomplete-map")
        raised = with_passes(lambda passes, _: [{**passes[0], "video": str(video)}])
        yield Case("the mast raised by 30 cm half-way", raised, ("camera height", "height"), codes)


def changed_clip(clip: ClipCase) -> Case:
    """A case of the first pass's clip alone."""

    def changed(row: Filmed) -> tuple[Content, Path]:
        content = copy.deepcopy(row.content)
        first, following = content["rows"][ROW]["passes"][0], row.other["rows"][ROW]["passes"][0]
        frames, other = read(row.folder / first["video"]), read(row.other_folder / following["video"])
        video = row.scratch / f"{re.sub('[^a-z0-9]+', '-', clip.name.lower())}.mp4"
        write(video, clip.change(frames, other), clip.streams, clip.degrees)
        part = (
            {}
            if clip.part is None
            else dict(zip(("start_s", "end_s"), np.multiply(clip.part, frames[-1][0]).tolist(), strict=True))
        )
        content["rows"][ROW]["passes"] = [{"video": str(video), "side": clip.side(first["side"]), **part}]
        return content, row.folder

    return Case(clip.name, changed, clip.words, tuple(WARNINGS) if clip.words else FOOTAGE)


def render_raised(scene: Path, metres: float, clip: Path) -> None:
    """A scene's footage, from a camera that stands so much higher from the middle on."""
    built = build(load_scene(scene))
    path = drive(built.scene.cart, built.scene.seed)
    share = np.arange(len(path.origins)) / len(path.origins)
    path.origins[:, 1] += metres * np.clip((share - 0.45) / 0.1, 0.0, 1.0)
    encode(frames(renderer(built), path, 2), built.scene.cart, clip)


DEMO = SITE.parent
WRONG_SIGMA, WRONG_M = 3.0, 0.01
ROWS = ("demo", "5000", "5003")
WORDS = ("right", "SILENTLY WRONG", "FALSE ALARM", "OTHER REASON", "uncheckable")


@dataclass(frozen=True)
class Unchanged:
    """How a row is mapped without any change: its errors, as `errors` gives them, and its warnings about elements that are wrong indeed, by
    kind and ids."""

    errors: Mapping[str, tuple[float, float]]
    warnings: Set[tuple[str, str]]

    @classmethod
    def of(cls, row: RowMap, survey: Mapping[str, Any]) -> "Unchanged":
        """From the row's map."""
        assert row.verdict is not None
        found = errors(row, survey)
        wrong = [label for label, (error, sigma) in found.items() if _is_wrong(error, sigma)]
        warnings = {
            (warning.code, name)
            for warning in row.verdict.warnings
            for name in warning.subjects
            if any(label.startswith(f"{name} / ") for label in wrong)
        }
        return cls(found, warnings)


@dataclass(frozen=True)
class Ending:
    """How a row ended: `trusted`, `check` or `refused`, why as far as it is about the case, the largest error that the change made, m, whether
    the map told that such an error would stay hidden, and warnings about other things, other than the unchanged row's."""

    grade: str
    reason: str
    worst_m: float = 0.0
    told: bool = False
    others: str = ""


PARTS: Mapping[str, Callable[[Filmed], Iterator[Case]]] = {
    "references": reference_cases,
    "units": unit_cases,
    "passes": pass_cases,
    "drives": lambda _: map(changed_clip, DRIVES),
    "cameras": lambda row: map(changed_clip, camera_cases(row.folder / "poses.json")),
}
"""What may be wrong: each part gives the cases for a row."""


def mapped(content: Content, folder: Path, output: Path) -> tuple[RowMap | None, str]:
    """A row's map by its rack alone, or why there is none."""
    content = {
        **content,
        "plugins": {PLUGIN: content.get("plugins", {}).get(PLUGIN, {})},
        "rows": {ROW: content["rows"][ROW]},
    }
    try:
        job = Job(site_of(draft_of(content, SourceMap("case"), folder)), folder / "case", [PLUGIN], output)
        return map_rows_of(job, RunOptions(jobs=0), SilentMonitor(), FolderCache(output)).rows[ROW], ""
    except SavmapError as error:
        return None, str(error)


def errors(row: RowMap, survey: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Errors of uprights' edges along the aisle and of beams' heights, with their standard deviations, m, by vertex."""
    found = {}
    for structure in row.structures[PLUGIN]:
        for label, vertex, covariance in zip(
            structure.vertex_labels, structure.vertices, structure.covariances, strict=True
        ):
            words = label.replace(" /", "").split()
            try:
                if words[0] == "upright":
                    truth, axis = survey["uprights"][int(words[1]) - 1][("left", "right").index(words[2])], 0
                else:
                    truth, axis = (
                        survey["sections"][int(words[1]) - 1]["beams"][int(words[3]) - 1][words[4] == "upper"],
                        1,
                    )
            except (IndexError, ValueError):
                continue
            found[label] = float(vertex[axis] - truth), float(np.sqrt(covariance[axis, axis]))
    return found


def made_wrong(after: Mapping[str, tuple[float, float]], before: Mapping[str, tuple[float, float]]) -> float:
    """The largest error beyond its sigmas, m, among vertices that had none before."""
    worst = [
        abs(error)
        for label, (error, sigma) in after.items()
        if _is_wrong(error, sigma) and not _is_wrong(*before.get(label, (0.0, 1.0)))
    ]
    return max(worst, default=0.0)


def _is_wrong(error: float, sigma: float) -> bool:
    return abs(error) > max(WRONG_SIGMA * sigma, WRONG_M)


def ending(case: Case, row: Filmed, output: Path, before: Unchanged) -> Ending:
    """How a case ends."""
    found, reason = mapped(*case.change(row), output)
    if found is None:
        return Ending("refused", reason)
    worst = made_wrong(errors(found, row.survey), before.errors)
    assert found.verdict is not None
    told = worst <= max((part.unchecked_m or 0.0 for part in found.structures[PLUGIN]), default=0.0)
    warnings = [
        warning
        for warning in found.verdict.warnings
        if not warning.subjects or any((warning.code, name) not in before.warnings for name in warning.subjects)
    ]
    true = "; ".join("; ".join((warning.line, *warning.details)) for warning in warnings if warning.code in case.codes)
    others = "; ".join(f"({warning.line})" for warning in warnings if warning.code not in case.codes)
    return Ending(found.verdict.grade, true, worst, told, others)


def judged(case: Case, found: Ending) -> str:
    """In a word: `right`, `uncheckable` where the map says that such an error would stay hidden, or what is bad. A warning about something
    else is no excuse for a wrong map."""
    if not case.words and found.reason:
        return "FALSE ALARM"
    if found.reason and any(word in found.reason for word in case.words):
        return "right"
    if found.worst_m:
        return "uncheckable" if found.told else "SILENTLY WRONG"
    return "OTHER REASON" if found.grade == "refused" or found.reason or found.others else "right"


def filmed(name: str, folder: Path, other: str) -> Filmed:
    """A row's site file and survey; a number is the seed of a random one."""
    place, next_place = (DEMO if one == "demo" else folder / f"row-{one}" for one in (name, other))
    for one in (name, other):
        if one != "demo":
            footage(int(one), 40, folder / f"row-{one}")
    content, following = (yaml.safe_load((at / "site.yaml").read_text(encoding="utf-8")) for at in (place, next_place))
    survey = json.loads((place / "survey.json").read_text(encoding="utf-8"))["rows"][ROW]
    scratch = folder / "physics" / name
    scratch.mkdir(parents=True, exist_ok=True)
    return Filmed(name, place, content, survey, following, next_place, scratch)


def cases_of(given: argparse.Namespace, folder: Path, done: Set[tuple[str, str]]) -> Iterator[dict[str, Any]]:
    """The cases that are asked for of all rows, but those that are `done`, by row and case; printed as they end."""
    rows = given.rows
    others = [*rows[1:], rows[0]] if len(rows) > 1 else [next(name for name in ROWS if name not in rows)]
    for name, other in zip(rows, others, strict=True):
        row = filmed(name, folder, other)
        every = (case for part in given.parts for case in PARTS[part](row))
        cases = [case for case in every if given.only in case.name and (name, case.name) not in done]
        if not cases:
            continue
        unchanged, reason = mapped(copy.deepcopy(row.content), row.folder, row.scratch)
        if unchanged is None:
            raise SiteError(f"row {name} cannot be mapped at all: {reason}")
        before = Unchanged.of(unchanged, row.survey)
        for case in cases:
            end = ending(case, row, row.scratch, before)
            word, why = judged(case, end), (end.reason or end.others)[:150]
            print(f"{name:6} {case.name:36} {end.grade:8} {100 * end.worst_m:7.1f} cm  {word:15} {why}", flush=True)
            yield {"row": name, "case": case.name, "judged": word, **vars(end)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--rows", nargs="+", default=ROWS)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=("references", "units", "passes"))
    parser.add_argument("--only", default="", help="cases whose name contains this")


def run(given: argparse.Namespace) -> Figures:
    """How many cases end in which way."""
    if any(name.isdigit() and is_test("rows", int(name)) for name in given.rows):
        raise SiteError(f"{given.rows}: rows of the test set are not shown one by one; choose others")
    folder = given.keep
    file = folder / "physics.json"
    results = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    done = {(result["row"], result["case"]) for result in results}
    for result in cases_of(given, folder, done):
        results.append(result)
        write_text(file, json.dumps(results, indent=2) + "\n")
    chosen = [result["judged"] for result in results if result["row"] in given.rows and given.only in result["case"]]
    return {"total": {"cases": len(chosen), **{word.lower(): chosen.count(word) for word in WORDS}}}
