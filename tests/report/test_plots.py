"""Pictures are written whole, the same each time, and show what they were given."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.evaluation import Evaluation, Score
from savmap.report.drawing import Drawing, Kind, Role, Tone
from savmap.report.plots import write_box_plot, write_face_view, write_plan_view
from savmap.types import FrameTable, RowMap, Trajectory


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


@pytest.mark.parametrize("writer", [write_face_view, write_plan_view])
def test_svg_shows_captions_and_one_legend_entry_a_look(writer: Any, tmp_path: Path) -> None:
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        writer(DRAWINGS, row(20), tmp_path / "view.svg")
    text = (tmp_path / "view.svg").read_text()
    assert text.count(">survey: posts<") == text.count(">map: posts<") == 1
    assert ">map, off by more than 5 cm or spurious: posts<" in text
    assert ">map: spots<" in text
    assert ">1<" in text
    assert ">2<" in text
    assert (">camera, there<" in text) == (">camera, back<" in text) == (writer is write_plan_view)


@pytest.mark.parametrize(("x", "whole"), [(8.5, True), (-1.4, True), (12.0, False)])
def test_no_fixture_is_cut_through(x: float, whole: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    shown: list[tuple[float, float]] = []
    monkeypatch.setattr("savmap.report.plots.save", lambda figure, path: shown.append(figure.axes[0].get_xlim()))
    write_plan_view([*DRAWINGS[:2], drawing("line", "mapped", "fixture", x)], row(20), tmp_path / "plan.png")
    left, right = shown[0]
    assert (left < x and x + 1 < right) == whole


def test_unequal_scales_are_told(tmp_path: Path) -> None:
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        write_plan_view(
            [drawing("polygon", "mapped", "structure", x) for x in (0.0, 60.0)], row(20), tmp_path / "a.svg"
        )
        write_face_view([drawing("polygon", "mapped", "structure", x) for x in (0.0, 2.0)], row(20), tmp_path / "b.svg")
    assert "times that along x" in (tmp_path / "a.svg").read_text()
    assert "times that along x" not in (tmp_path / "b.svg").read_text()


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_pictures_are_the_same_bytes_each_time(tmp_path: Path, ending: str) -> None:
    for name in ("one", "two"):
        write_plan_view(DRAWINGS, row(20), tmp_path / f"{name}.{ending}")
    assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()


@pytest.mark.parametrize("frames", [0, 1])
@pytest.mark.parametrize("drawings", [[], DRAWINGS[-1:], DRAWINGS[:1]])
def test_little_to_show_is_no_error(tmp_path: Path, frames: int, drawings: list[Drawing]) -> None:
    write_face_view(drawings, row(frames), tmp_path / "face.png")
    write_plan_view(drawings, row(frames), tmp_path / "plan.png")
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


def test_reports_are_imported_without_matplotlib() -> None:
    code = "import sys, savmap.report.plots; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
