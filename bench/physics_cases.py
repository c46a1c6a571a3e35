"""Ways to be wrong about what was measured of a row: cases for `physics.py`, that change its site file's content."""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROW, PLUGIN = "A", "shelves"
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
            name = f"height of the lowest edge of bay {section + 1}"
            yield case(f"height {section + 1} {times} sigma off", height_off(section, off), name, off_m=off)
    last = len(heights(row.content))
    yield case("a height typed 5 cm too high", height_off(last - 1, 0.05), f"bay {last}", off_m=0.05)
    yield case("a height typed 5 cm too low", height_off(0, -0.05), "bay 1", off_m=0.05)
    yield case("two heights swapped", heights_as(swapped), "height of the lowest edge")
    yield case("a height in cm", heights_as(lambda own: [*own[:-1], 100 * own[-1]]), "bay", "values")
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
    yield case("another row's heights", others_heights, "height of the lowest edge", "its height is not used")
    yield case("another row's length", others_length, "length")
    yield case("another row's references", others_everything, "height", "camera", "length")
    yield case("heights from the other end", heights_as(lambda own: own[::-1]), "height of the lowest edge")
    yield case("heights one bay on", heights_as(lambda own: [*own[1:], own[-1]]), "height of the lowest edge")
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
    edges = [f"bay 1 / beam 1 / {edge}" for edge in ("lower", "upper")]

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
        "length bay 1",
        "height of the lowest edge of bay 1",
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
