"""What a site or a row says for all its passes, and what a pass says itself."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from savmap.site.model import Pass, Site


def site(one: dict[str, Any], row: dict[str, Any] | None = None, **of_site: Any) -> Site:
    return Site.model_validate({**of_site, "rows": {"A": {"passes": [one], **(row or {})}}})


def test_the_nearest_word_counts() -> None:
    whole = {"video": "site.mp4", "fps": 5}
    assert site({}, **whole).rows["A"].passes[0].footage == (Path("site.mp4"), 0.0, None, 5.0, None)
    assert site({}, {"fps": 7}, **whole).rows["A"].passes[0].fps == 7
    own = site({"fps": 9, "video": "own.mp4"}, {"fps": 7}, **whole).rows["A"].passes[0]
    assert (own.fps, own.video) == (9, Path("own.mp4"))
    assert site({"video": "a.mp4"}).rows["A"].passes[0].rate == 15


def test_a_video_must_be_named_somewhere() -> None:
    with pytest.raises(ValidationError, match=r"rows\.A\.passes\.0\.video"):
        site({})


def test_views_are_laid_over_one_another_by_name() -> None:
    face, up, other = ({"yaw_deg": yaw} for yaw in (10.0, 20.0, 30.0))
    found = site({"video": "a.mp4", "views": {"face": other}}, {"views": {"ceiling": up}}, views={"face": face})
    assert {name: view.yaw_deg for name, view in found.rows["A"].passes[0].views.items()} == {
        "face": 30.0,
        "ceiling": 20.0,
    }


def test_rows_override_calibration_key_by_key_and_appearance() -> None:
    found = site(
        {"video": "a.mp4"},
        {"calibration": {"front_deg": 90}, "appearance": False},
        calibration={"panorama": True, "front_deg": 10},
        appearance=True,
    )
    assert found.row_calibration("A").front_deg == 90
    assert found.row_calibration("A").panorama is not None
    assert found.row_appearance("A") is False
    assert site({"video": "a.mp4"}, appearance=True).row_appearance("A") is True


@pytest.mark.parametrize(("direction", "side"), [("+x", "left"), ("-x", "right")])
def test_direction_says_on_which_hand_the_face_is(direction: str, side: str) -> None:
    assert Pass.model_validate({"video": "a.mp4", "direction": direction}).side == side
    with pytest.raises(ValidationError, match=f"a face on the {side} is passed towards"):
        Pass.model_validate({"video": "a.mp4", "side": side, "direction": "-x" if direction == "+x" else "+x"})


def test_every_picture_of_a_folder_is_taken_unless_a_rate_is_given(tmp_path: Path) -> None:
    """At 15 a second every second one was left out without a word."""
    for given, rate in ({}, 30), ({"fps": 5}, 5):
        (taken,) = site({"video": str(tmp_path), **given}).rows["A"].passes
        assert (taken.rate, taken.clip.fps) == (rate, rate)
