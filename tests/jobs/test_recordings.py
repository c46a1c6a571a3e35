"""In which recording a pass's times are."""

from pathlib import Path

from savmap.pipeline.measure import recordings
from savmap.site.model import Pass


def test_passes_of_one_video_are_one_recording(tmp_path: Path) -> None:
    video, folder = tmp_path / "aisle.mp4", tmp_path / "pictures"
    folder.mkdir()
    passes = [
        Pass(video=video, start_s=0, end_s=60),
        Pass(video=video, start_s=50, fps=5),
        Pass(video=folder, fps=5),
        Pass(video=folder, fps=10),
    ]
    found = recordings(passes)
    assert list(found) == ["pass 1", "pass 2", "pass 3", "pass 4"]
    assert found["pass 1"] == found["pass 2"] == video
    assert len(set(found.values())) == 3


def test_a_video_at_a_url_is_not_looked_for() -> None:
    one = Pass.model_validate({"video": "memory://bucket/aisle.mp4"})
    assert recordings([one, one])["pass 1"] == one.video
