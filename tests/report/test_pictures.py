"""Pictures are written whole, the same each time, and show what they were given."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from savmap.errors import OutputError
from savmap.report.picture import write_box_plot, write_row_view
from savmap.report.row_views import row_view
from savmap.types import Drawing, Evaluation, FrameTable, Kind, Picture, Role, RowMap, Score, Tone, Trajectory


def row(frames: int) -> RowMap:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 0, 3] = np.linspace(0, 8, frames)
    poses[:, 2, 3] = 1.6
    table = FrameTable(np.arange(frames) / 15.0, tuple("there" if k < frames / 2 else "back" for k in range(frames)))
    return RowMap("A", table, {}, Trajectory(np.arange(frames), poses), {}, ())


def drawing(kind: Kind, role: Role, tone: Tone, x: float = 0.0, caption: str = "") -> Drawing:
    square = np.array([[x, 0.0, 0], [x + 1, 0, 0], [x + 1, 2, 0], [x, 2, 0]])
    count = {"polygon": 4, "line": 2, "point": 1}[kind]
    return Drawing(kind, square[:count], role, tone, "posts" if tone == "structure" else "spots", caption=caption)


DRAWINGS = [
    drawing("polygon", "survey", "structure", 0.0),
    drawing("polygon", "mapped", "structure", 0.0, "1"),
    drawing("polygon", "off", "structure", 7.0, "2"),
    drawing("line", "survey", "fixture", 3.0),
    drawing("line", "mapped", "fixture", 3.0),
    drawing("point", "off", "fixture", 50.0),
]


@pytest.mark.parametrize("picture", ["face", "plan"])
def test_svg_shows_captions_and_one_legend_entry_a_style(picture: Picture, tmp_path: Path) -> None:
    write_row_view(row(20), DRAWINGS, picture, tmp_path / "view.svg")
    text = (tmp_path / "view.svg").read_text()
    assert text.count(">survey: posts<") == text.count(">map: posts<") == 1
    assert ">map, off by more than 5 cm or spurious: posts<" in text
    assert ">map: spots<" in text
    assert ">1<" in text
    assert ">2<" in text
    assert (">camera, there</text>" in text) == (">camera, back</text>" in text) == (picture == "plan")


def test_svg_has_no_variables_and_is_sound_xml(tmp_path: Path) -> None:
    odd = replace(row(20), name="<A> & \x07 \ud800")
    write_row_view(odd, DRAWINGS, "plan", tmp_path / "plan.svg")
    text = (tmp_path / "plan.svg").read_text()
    assert "Row <A> & \\x07 \\ud800: plan" in "".join(ElementTree.fromstring(text).itertext())
    assert "var(" not in text
    assert "calc(" not in text


@pytest.mark.parametrize(("x", "whole"), [(8.5, True), (-1.4, True), (12.0, False)])
def test_no_fixture_is_cut_through(x: float, whole: bool) -> None:
    figure = row_view(row(20), [*DRAWINGS[:2], drawing("line", "mapped", "fixture", x)], "plan")
    left, right = figure.frame[0] / 1000, (figure.frame[0] + figure.frame[2]) / 1000
    assert (left < x and x + 1 < right) == whole


def test_unequal_scales_are_told(tmp_path: Path) -> None:
    for name, places in (("long", (0.0, 60.0)), ("short", (0.0, 2.0))):
        drawings = [drawing("polygon", "mapped", "structure", x) for x in places]
        write_row_view(row(20), drawings, "plan" if name == "long" else "face", tmp_path / f"{name}.svg")
    assert "times that along x" in (tmp_path / "long.svg").read_text()
    assert "times that along x" not in (tmp_path / "short.svg").read_text()


def test_a_stretched_grid_has_the_metres_of_its_axis() -> None:
    plain = row_view(row(20), DRAWINGS, "face")
    ratio = plain.frame[3] / plain.frame[2]
    stretched = row_view(row(20), DRAWINGS, "face", least_ratio=2 * ratio)
    assert stretched.frame[3] == 2 * plain.frame[3]
    assert row_view(row(20), DRAWINGS, "face", least_ratio=ratio / 2).frame == plain.frame
    heights = [
        {label.text: label.y for label in figure.labels if label.style == "tick y"} for figure in (plain, stretched)
    ]
    assert heights[1]["2 m"] == 2 * heights[0]["2 m"] == -4000


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_pictures_are_the_same_bytes_each_time(tmp_path: Path, ending: str) -> None:
    for name in ("one", "two"):
        write_row_view(row(20), DRAWINGS, "plan", tmp_path / f"{name}.{ending}")
    assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()


def test_a_picture_has_the_colours_of_what_it_shows(tmp_path: Path) -> None:
    write_row_view(row(20), DRAWINGS, "face", tmp_path / "face.png")
    pixels = np.asarray(Image.open(tmp_path / "face.png").convert("RGB")).reshape(-1, 3)
    for colour, least in (((255, 212, 59), 500), ((18, 53, 91), 500), ((197, 15, 31), 500), ((23, 33, 43), 100)):
        assert (pixels == colour).all(axis=1).sum() > least  # survey, map, off, text


@pytest.mark.parametrize("frames", [0, 1])
@pytest.mark.parametrize("drawings", [[], DRAWINGS[-1:], DRAWINGS[:1]])
def test_little_to_show_is_no_error(tmp_path: Path, frames: int, drawings: list[Drawing]) -> None:
    write_row_view(row(frames), drawings, "face", tmp_path / "face.png")
    write_row_view(row(frames), drawings, "plan", tmp_path / "plan.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["face.png", "plan.png"]


SOME = {"width": np.array([0.01]), "gap": np.linspace(-0.1, 0.1, 200)}


@pytest.mark.parametrize("errors", [{}, {"width": np.zeros(0)}, SOME])
def test_box_plot(tmp_path: Path, errors: dict[str, np.ndarray]) -> None:
    score = Score(errors, missing={"post": 1}, spurious={"post": 0})
    write_box_plot(Evaluation({"A": score, "B": score}), tmp_path / "box.png")
    assert (tmp_path / "box.png").read_bytes().startswith(b"\x89PNG")


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="written as"):
        write_box_plot(Evaluation({}), tmp_path / "box.bmp")
    assert not list(tmp_path.iterdir())


def test_a_drawing_without_points_is_refused() -> None:
    with pytest.raises(ValueError, match=r"posts must be \(n, 3\)"):
        Drawing("line", np.zeros((0, 3)), "mapped", "structure", "posts")
