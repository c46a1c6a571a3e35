"""The command line: one clear line and the documented exit code for what a user gets wrong."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parent.parent / "examples" / "aisle-dev"


def savmap(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from savmap.cli import main; main()", *(str(argument) for argument in arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["map"], 3, "site.yaml: no such site file"),
        (["map", "text.mp4"], 4, "not a video"),
        (["map", "empty.mp4"], 4, "empty"),
        (["map", "none.mp4"], 4, "no such file"),
        (["map", "text.mp4", "--plugins", "shelfs"], 5, "did you mean `shelves`"),
        (["map", "text.mp4", "--camera-height", "3050"], 3, "metres are expected"),
        (["map", "text.mp4", "--side", "up"], 3, "`left` or `right`"),
        (["map", EXAMPLE / "site.yaml", "-o", "file/out"], 9, "nothing can be written there"),
        (["map", "late.yaml"], 4, "late.yaml"),
        (["map", "model.yaml"], 6, "no such model file"),
        (["evaluate", "none.json", EXAMPLE / "survey.json"], 9, "none.json"),
        (["evaluate", EXAMPLE / "survey.json", EXAMPLE / "survey.json"], 9, "is not a map"),
        (["simulate", "none.yaml"], 3, "none.yaml"),
        (["map", "--frobnicate"], 2, "No such option"),
    ],
)
def test_mistakes_get_one_line_and_their_code(tmp_path: Path, arguments: list[object], code: int, words: str) -> None:
    (tmp_path / "text.mp4").write_text("not a video", encoding="utf-8")
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "file").touch()
    video = EXAMPLE / "aisle-dev.mp4"
    late = f"plugins: {{shelves: {{}}}}\nrows: {{A: {{passes: [{{video: {video}, start_s: 900}}]}}}}\n"
    (tmp_path / "late.yaml").write_text(late, encoding="utf-8")
    model = f"plugins: {{shelves: {{model: none.onnx}}}}\nrows: {{A: {{passes: [{{video: {video}}}]}}}}\n"
    (tmp_path / "model.yaml").write_text(model, encoding="utf-8")
    result = savmap(*arguments, folder=tmp_path)
    words = words if words != "late.yaml" else "aisle-dev.mp4"
    assert result.returncode == code, result.stderr
    assert words in result.stderr.replace("\n", " ")
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out" / "map.json").exists()


def test_help_and_plugins_answer(tmp_path: Path) -> None:
    assert "map" in savmap("--help", folder=tmp_path).stdout
    listed = savmap("plugins", folder=tmp_path).stdout
    assert "upright, beam" in listed
    assert "lights.onnx" in listed
