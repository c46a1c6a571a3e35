"""Ways to be wrong about a row, and how mapping it ends: `trusted` and right, `check`, or refused. Never silently wrong.

    python bench/physics.py [--rows demo 5000 5003] [--keep DIR] [--only WORDS] [--part 1/4] [--resume] [-o bench/results/physics.json]

A case changes what is said of a row: its site file's content, or which clip it names (`physics_footage.py` has more of what may be wrong
with a clip). A map is wrong where the change put an edge further from the truth than 3 of its sigmas and 1 cm. It is silent about that
unless the row ends as `check` or refused. A number as a row is the seed of a random one; another row's references are those of the next row.
The results are written after each case; `--resume` leaves those as they are that are in the output file, and `--part 2/4` runs the second of
four parts of each row's cases.
"""

import argparse
import copy
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from physics_footage import other_hand, read, without, write
from rows import footage

from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.jobs.cache import FolderCache
from savmap.jobs.scheduler import RunOptions, map_rows_of
from savmap.sim.drive.cart import drive
from savmap.sim.render.panorama import encode, frames
from savmap.sim.render.shade import renderer
from savmap.sim.scene.build import build
from savmap.sim.scene.files import load_scene
from savmap.site.job import Job
from savmap.site.load import draft_of, site_of
from savmap.site.locations import SourceMap
from savmap.types import RowMap
from savmap.types.progress import SilentMonitor

ROOT = Path(__file__).parent.parent
DEMO = ROOT / "savmap" / "demo"
ROW, PLUGIN = "A", "shelves"
WRONG_SIGMA, WRONG_M = 3.0, 0.01
TIMES = (3, 10, 30)
NOTHING = "nothing wrong"
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
    """A way to be wrong: `change` gives the site's content and the folder that its footage is in. `off_m`: by how much one reference is
    wrong. A doubt of one of the `kinds`, or a refusal, must contain one of the `words`."""

    name: str
    change: Callable[[Filmed], tuple[Content, Path]]
    words: tuple[str, ...] = ("",)
    off_m: float = np.inf
    kinds: tuple[str, ...] = ("reference",)


@dataclass(frozen=True)
class Ending:
    """How a row ended: `trusted`, `check` or `refused`, why as far as it is about the case, the largest error that the change made, m, whether
    the map told how large an error of this reference nobody would notice, and doubts about other things."""

    grade: str
    reason: str
    worst_m: float = 0.0
    told: bool = False
    others: str = ""


def given(content: Content) -> Content:
    """The row's own references, which the site's are moved into."""
    row = content["rows"][ROW]
    row["references"] = {**content.pop("references", {}), **row.get("references", {})}
    own: dict[str, Any] = row["references"]
    return own


def heights(content: Content) -> list[float]:
    """The lowest edges' heights, section by section."""
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


def length_off(metres: float) -> Callable[[Content, Content], None]:
    def change(site: Content, _: Content) -> None:
        given(site)["lengths"][0]["value"] += metres

    return change


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
        own = given(site)
        own["lengths"] = [
            *own["lengths"],
            {"between": list(between), "value": value, "sigma": 0.003, "axis": axis},
        ]

    return change


def with_point(vertex: str, value: float) -> Callable[[Content, Content], None]:
    """A surveyed place along the aisle."""

    def change(site: Content, _: Content) -> None:
        given(site)["points"] = [{"vertex": vertex, "axis": "x", "value": value, "sigma": 0.003}]

    return change


def reference_cases(row: Filmed) -> Iterator[Case]:
    """Each reference off by some sigmas and by slips of the hand."""

    def case(name: str, change: Callable[[Content, Content], None], *words: str, off_m: float = np.inf) -> Case:
        return Case(name, references_only(change), words or ("",), off_m)

    yield case(NOTHING, lambda _, __: None)
    for times in TIMES:
        yield case(f"camera height {times} sigma off", camera_off(0.02 * times), "camera height", off_m=0.02 * times)
        yield case(f"length {times} sigma off", length_off(0.003 * times), "length", off_m=0.003 * times)
        for section in range(len(heights(row.content))):
            off = 0.002 * times
            name = f"height of the lowest edge of section {section + 1}"
            yield case(f"height {section + 1} {times} sigma off", height_off(section, off), name, off_m=off)
    last = len(heights(row.content))
    yield case("a height typed 5 cm too high", height_off(last - 1, 0.05), f"section {last}", off_m=0.05)
    yield case("a height typed 5 cm too low", height_off(0, -0.05), "section 1", off_m=0.05)
    yield case("two heights swapped", heights_as(swapped), "height of the lowest edge")
    yield case("a height in cm", heights_as(lambda own: [*own[:-1], 100 * own[-1]]), "section", "values")
    yield case("heights in cm", heights_as(lambda own: [100 * value for value in own]), "height", "values")
    yield case("heights in units of 100 m", heights_as(lambda own: [value / 100 for value in own]), "height")
    for metres in (-0.5, -0.1, 0.1, 0.5):
        yield case(f"camera {metres:+.1f} m", camera_off(metres), "camera height", off_m=abs(metres))
        yield case(
            f"camera {metres:+.1f} m, no laser", camera_off(metres, laser=False), "camera height", off_m=abs(metres)
        )
    yield case(
        "length in units of 10 m",
        lambda site, _: length_off(-0.9 * given(site)["lengths"][0]["value"])(site, _),
        "length",
    )
    yield case("length to the upright before", one_bay_short, "length")
    yield case("another row's heights", others_heights, "height of the lowest edge")
    yield case("another row's length", others_length, "length")
    yield case("another row's references", others_everything, "height", "camera", "length")
    yield case("heights from the other end", heights_as(lambda own: own[::-1]), "height of the lowest edge")
    yield case("heights one section on", heights_as(lambda own: [*own[1:], own[-1]]), "height of the lowest edge")
    yield case("a camera height in feet", camera_off(2.281 * camera_height(row)), "camera height")


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

    def case(name: str, change: Callable[[Content, Content], None], *words: str) -> Case:
        return Case(name, references_only(change), words, kinds=("reference", "shape"))

    size = "another unit"
    yield case("everything in feet", all_in(FOOT_M), size)
    more = camera_height(row) * (1 / FOOT_M - 1)
    yield case("a camera height in feet, no laser", camera_off(more, laser=False), size, "camera height")
    yield case(
        "a length in feet",
        lambda site, _: length_off((1 / FOOT_M - 1) * given(site)["lengths"][0]["value"])(site, _),
        "length",
    )
    yield case("heights in feet", heights_as(lambda own: [value / FOOT_M for value in own]), "height")


def camera_height(row: Filmed) -> float:
    return float(given(copy.deepcopy(row.content))["camera_height_m"]["value"])


def more_reference_cases(row: Filmed) -> Iterator[Case]:
    """References of other kinds, given beside the usual ones, twice, or measured to the wrong edge."""
    first, last = row.survey["uprights"][0], row.survey["uprights"][-1]
    between = given(copy.deepcopy(row.content))["lengths"][0]["between"]
    length = last[1] - first[0]
    width = sum(upright[1] - upright[0] for upright in (first, last))
    beam = row.survey["sections"][0]["beams"][0]
    edges = [f"section 1 / beam 1 / {edge}" for edge in ("lower", "upper")]

    def case(name: str, change: Callable[[Content, Content], None], *words: str, off_m: float = np.inf) -> Case:
        return Case(name, references_only(change), words, off_m)

    yield case("length between inner edges", length_off(-width), "length", off_m=width)
    yield case(
        "heights of the upper edges",
        heights_as(lambda own: [value + beam[1] - beam[0] for value in own]),
        "height",
        off_m=beam[1] - beam[0],
    )
    yield case("the length given twice", with_length(between, length))
    yield case("twice, once 5 cm more", with_length(between, length + 0.05), "length", off_m=0.05)
    yield case("twice, once 50 cm more", with_length(between, length + 0.5), "length", off_m=0.5)
    yield case("a tape's length", with_length(edges, beam[1] - beam[0], "y"))
    yield case(
        "a tape's length 5 cm off",
        with_length(edges, beam[1] - beam[0] + 0.05, "y"),
        "length section 1",
        "height of the lowest edge of section 1",
        off_m=0.05,
    )
    yield case("a surveyed place", with_point("upright 2 / left", row.survey["uprights"][1][0]))
    yield case(
        "a surveyed place 10 cm off",
        with_point("upright 2 / left", row.survey["uprights"][1][0] + 0.1),
        "surveyed",
        off_m=0.1,
    )
    yield case(
        "a place from the other end", with_point("upright 2 / left", length - row.survey["uprights"][1][0]), "surveyed"
    )
    bay, pitch = ("upright 2 / left", "upright 3 / left"), row.survey["uprights"][2][0] - row.survey["uprights"][1][0]
    yield case("a bay's width", with_length(bay, pitch))
    yield case("a bay's width 5 cm off", with_length(bay, pitch + 0.05), "length", off_m=0.05)
    yield case("a bay's width 50 cm off", with_length(bay, pitch + 0.5), "length", off_m=0.5)


def clip_cases(row: Filmed) -> Iterator[Case]:
    """The references are right, but of another clip."""
    kinds = ("reference", "camera", "motion")
    anything = ("contradict", "sections were found", "no such thing", "part of the row", "the rest says", "height")

    def on_the_other_hand(row: Filmed) -> tuple[Content, Path]:
        content = copy.deepcopy(row.content)
        one = content["rows"][ROW]["passes"][0]
        one["side"] = other_hand(one["side"])
        return content, row.folder

    def first(share: float) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = content["rows"][ROW]["passes"][0]
            one["end_s"] = read(row.folder / one["video"])[-1][0] * share
            return content, row.folder

        return change

    def gap(stamped: bool) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = content["rows"][ROW]["passes"][0]
            clip = row.scratch / f"gap-{stamped}.mp4"
            write(clip, without(read(row.folder / one["video"]), stamped))
            one["video"] = str(clip)
            return content, row.folder

        return change

    yield Case("sides swapped", on_the_other_hand, anything, kinds=kinds)
    yield Case("the first half of the clip", first(1 / 2), anything, kinds=kinds)
    yield Case("the first two thirds of the clip", first(2 / 3), anything, kinds=kinds)
    yield Case("a gap, times kept", gap(stamped=True), ("frames are missing",), kinds=kinds)
    yield Case("a gap, times rewritten", gap(stamped=False), ("frames are missing", "frames seem"), kinds=kinds)


def other_clip_cases(_: Filmed) -> Iterator[Case]:
    """Clips that are not what they are given as: another row's, or filmed while the mast was moved."""
    kinds = ("reference", "camera", "motion", "support", "residuals", "repeatability", "shape")
    anything = ("contradict", "sections were found", "no such thing", "part of the row", "rest says", "height", "fit")

    def another(added: bool) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = {**row.other["rows"][ROW]["passes"][0]}
            one["video"] = str(row.other_folder / one["video"])
            passes = content["rows"][ROW]["passes"]
            passes[:] = [*passes, one] if added else [one]
            return content, row.folder

        return change

    def twice(row: Filmed) -> tuple[Content, Path]:
        content = copy.deepcopy(row.content)
        content["rows"][ROW]["passes"] *= 2
        return content, row.folder

    yield Case("another row's clip", another(added=False), anything, kinds=kinds)
    yield Case("another row's clip as a second pass", another(added=True), (*anything, "pass 2"), kinds=kinds)
    yield Case("the clip twice, as two passes", twice, (*anything, "pass 2"), kinds=(*kinds, "passes"))


def mast_cases(row: Filmed) -> Iterator[Case]:
    """The mast is raised half-way, and its height given as before. Of simulated rows alone."""

    def raised(metres: float) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = content["rows"][ROW]["passes"][0]
            clip = row.scratch / f"raised-{metres}.mp4"
            if not clip.is_file():
                render_raised(row.folder / "scene.yaml", metres, clip)
            one["video"] = str(clip)
            return content, row.folder

        return change

    if (row.folder / "scene.yaml").is_file():
        kinds = ("reference", "camera", "motion")
        yield Case("the mast raised by 30 cm half-way", raised(0.3), ("camera height", "height"), kinds=kinds)


def render_raised(scene: Path, metres: float, clip: Path) -> None:
    """A scene's footage, from a camera that stands so much higher from the middle on."""
    built = build(load_scene(scene))
    path = drive(built.scene.cart, built.scene.seed)
    share = np.arange(len(path.origins)) / len(path.origins)
    path.origins[:, 1] += metres * np.clip((share - 0.45) / 0.1, 0.0, 1.0)
    encode(frames(renderer(built), path, 2), built.scene.cart, clip)


PARTS: tuple[Callable[[Filmed], Iterator[Case]], ...] = (
    reference_cases,
    more_reference_cases,
    unit_cases,
    clip_cases,
    other_clip_cases,
    mast_cases,
)
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


def ending(case: Case, row: Filmed, output: Path, before: Mapping[str, tuple[float, float]]) -> Ending:
    """How a case ends."""
    found, reason = mapped(*case.change(row), output)
    if found is None:
        return Ending("refused", reason)
    worst = made_wrong(errors(found, row.survey), before)
    assert found.verdict is not None
    told = any(_unnoticed(note, case.words) >= case.off_m for note in found.verdict.notes)
    doubts = found.verdict.doubts
    true = "; ".join(doubt.what for doubt in doubts if doubt.kind in case.kinds)
    others = "; ".join(f"({doubt.what})" for doubt in doubts if doubt.kind not in case.kinds)
    return Ending("check" if doubts else "trusted", true, worst, told, others)


def _unnoticed(note: str, words: Sequence[str]) -> float:
    """The error of a reference that a note says nobody would notice, m."""
    if note.startswith(("one reference gives", "nothing checks")):
        return np.inf if any(word and word in note for word in words) else 0.0
    sizes = re.findall(r"of ([\d.]+) m in ([^;]+?)(?=, of |;)", note)
    return max((float(size) for size, name in sizes if any(word and word in name for word in words)), default=0.0)


def judged(case: Case, found: Ending) -> str:
    """In a word: `right`, `uncheckable` where the map says that such an error would not be noticed, or what is bad. A doubt about something
    else is no excuse for a wrong map."""
    if case.name == NOTHING:
        return "FALSE ALARM" if found.grade != "trusted" else "right"
    if found.reason and any(word in found.reason for word in case.words):
        return "right"
    if found.worst_m:
        return "uncheckable" if found.told else "SILENTLY WRONG"
    return "OTHER REASON" if found.grade != "trusted" else "right"


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


def chosen(row: Filmed, only: str, part: tuple[int, int]) -> list[Case]:
    """The cases of a row whose names contain `only`, every so many of them: `part` is (1, 4) for the first of four parts."""
    cases = [case for part in PARTS for case in part(row) if only in case.name]
    return cases[part[0] - 1 :: part[1]]


def run(
    rows: Sequence[str], folder: Path, only: str, part: tuple[int, int], done: Set[tuple[str, str]]
) -> Iterator[dict[str, Any]]:
    """All chosen cases of all rows, but those that are `done`, by row and case; printed as they end."""
    for name, other in zip(rows, [*rows[1:], rows[0]], strict=True):
        row = filmed(name, folder, other)
        output = row.scratch
        if all((name, case.name) in done for case in chosen(row, only, part)):
            continue
        whole, reason = mapped(copy.deepcopy(row.content), row.folder, output)
        if whole is None:
            raise SystemExit(f"row {name} cannot be mapped at all: {reason}")
        before = errors(whole, row.survey)
        for case in (case for case in chosen(row, only, part) if (name, case.name) not in done):
            found = ending(case, row, output, before)
            word = judged(case, found)
            print(
                f"{name:6} {case.name:36} {found.grade:8} {100 * found.worst_m:7.1f} cm  {word:15} {(found.reason or found.others)[:150]}",
                flush=True,
            )
            yield {"row": name, "case": case.name, "judged": word, **vars(found)}


def _part(text: str) -> tuple[int, int]:
    number, count = map(int, text.split("/"))
    if not 0 < number <= count:
        raise ValueError(text)
    return number, count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", nargs="+", default=["demo", "5000", "5003"])
    parser.add_argument("--keep", type=Path, help="keep footage and what was measured in this folder")
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument(
        "--part", default="1/1", type=_part, help="such as 2/4: the second of four parts of each row's cases"
    )
    parser.add_argument("--resume", action="store_true", help="keep the results that are in the output file")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "physics.json")
    arguments = parser.parse_args()
    resumed = arguments.resume and arguments.output.is_file()
    results = json.loads(arguments.output.read_text(encoding="utf-8")) if resumed else []
    with tempfile.TemporaryDirectory() as temporary:
        done = {(one["row"], one["case"]) for one in results}
        for result in run(arguments.rows, arguments.keep or Path(temporary), arguments.only, arguments.part, done):
            results.append(result)
            write_text(arguments.output, json.dumps(results, indent=2) + "\n")
    for word in ("FALSE ALARM", "OTHER REASON", "uncheckable"):
        print(f"{word.lower()}: {sum(one['judged'] == word for one in results)}")
    print(f"silently wrong: {sum(one['judged'] == 'SILENTLY WRONG' for one in results)}")


if __name__ == "__main__":
    main()
