"""Long recordings: the passes found in drawn ones, what is written for a person to confirm, and what is refused."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from drawn import Face, Woven, aisles, alongside, block, cart, filmed, pictures, recording

from savmap.apps.split.find import find, split
from savmap.apps.split.frame_pairs import sample_stamps
from savmap.apps.split.passes import find_passes
from savmap.apps.split.records import DetectedPass, SplitResult, SplitSettings
from savmap.apps.split.site_rows import add_to_site
from savmap.cli.app import main
from savmap.errors import OutputError, SiteError, StructureError, VideoError
from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.scene.files import Cart
from savmap.site.load import load_site
from savmap.video.motion import FramePair, motion_of

pytestmark = pytest.mark.slow

ONE = DetectedPass(12.5, 70.25, 180.0, 40.0, ("left",), 0.9, 0.0)


def looked(faces: list[Face], one: Cart) -> SplitResult:
    """What is found in glances of a drive, twice a second, without a video."""
    path = drive(one, 1)
    chosen = np.arange(0, len(path.stamps_s) - 1, 4)
    pairs = np.stack([chosen, chosen + 1], axis=1).ravel()
    seen = pictures(faces, type(path)(path.stamps_s[pairs], path.origins[pairs], path.world_from_rig[pairs]), one.width)
    step = 1 / one.fps
    pairs_ = [FramePair(float(path.stamps_s[i]), step, *seen[2 * k : 2 * k + 2]) for k, i in enumerate(chosen)]
    return find_passes([motion_of(pair) for pair in pairs_], SplitSettings())


def test_all_passes_are_found_within_a_second(woven: Woven) -> None:
    truth = alongside(woven.path)
    found = woven.found.passes
    assert len(found) == len(truth) == 3
    for one, (start, end) in zip(found, truth, strict=True):
        assert (one.start_s, one.end_s) == pytest.approx((start, end), abs=0.6)
        assert one.sides == ("left", "right")
        assert one.way_deg == pytest.approx(-70, abs=3)
        assert one.confidence > 0.7
    assert [one.heading_deg for one in found] == [0.0, 180.0, 0.0]
    assert [one.stood_s > 3 for one in found] == [False, True, False]


def test_few_frames_are_decoded_and_all_repeats(woven: Woven) -> None:
    frames = len(woven.path.stamps_s)
    assert woven.found.frames_decoded < 0.6 * frames
    assert abs(woven.found.frames - frames) <= 1
    assert woven.found.frame_pairs > frames / 8 * 0.9
    again = find(woven.file)
    assert again.passes == woven.found.passes
    np.testing.assert_array_equal(again.travel_deg, woven.found.travel_deg)


def test_sparse_key_frames_cost_more_but_find_the_same(woven: Woven, tmp_path: Path) -> None:
    file, path = recording(tmp_path, aisles(1), cart([(-3, 1.5), (11, 1.5)]), key_every=250)
    (one,), ((start, end),) = find(file).passes, alongside(path)
    assert (one.start_s, one.end_s) == pytest.approx((start, end), abs=0.6)


def test_going_back_in_an_aisle_begins_another_pass() -> None:
    found = looked(aisles(1), cart([(-2, 1.5), (6.5, 1.5), (1.0, 1.5), (11.0, 1.5)])).passes
    assert [one.heading_deg for one in found] == [0.0, 180.0, 0.0]
    assert all(one.sides == ("left", "right") for one in found)


def test_a_cut_to_another_aisle_begins_another_pass(tmp_path: Path) -> None:
    """Half of the first aisle, and then at once half of the second, in the same direction."""
    one, two = (drive(cart([(-2.0, z), (16.0, z)]), 1) for z in (1.5, 6.1))
    half = len(one.stamps_s) // 2
    parts = [
        np.concatenate([a[:half], b[half:]])
        for a, b in ((one.origins, two.origins), (one.world_from_rig, two.world_from_rig))
    ]
    file = filmed(tmp_path, aisles(2, 14.0), cart([(-2.0, 1.5), (16.0, 1.5)]), type(one)(one.stamps_s, *parts))
    first, second = find(file).passes
    assert first.end_s == pytest.approx(half / 8, abs=0.8)
    assert second.start_s == pytest.approx(half / 8, abs=0.8)


def test_a_bare_wall_is_no_structure() -> None:
    faces = [*block((-7, 15), (-8, 3.0), 0.05), *block((0, 8), (-1.6, 0))]
    (one,) = looked(faces, cart([(-2.5, 1.5), (10.5, 1.5)])).passes
    assert one.sides == ("left",)


def test_the_way_along_the_rows_ends_is_no_pass() -> None:
    first, last = (-2.0, 1.5), (-2.0, 4 * 4.6 + 1.5)
    found = looked(aisles(5), cart([first, (11.0, 1.5), (11.0, 4 * 4.6 + 1.5), last])).passes
    assert [one.heading_deg for one in found] == [0.0, 180.0]


def test_cart_that_stands_or_crosses_a_hall_has_no_pass() -> None:
    hall = block((-30, 30), (-30, 30), 0.6)
    assert not looked(hall, cart([(0, 0), (0.2, 0)], stops=[(0.1, 20.0)])).passes
    assert len(looked(hall, cart([(-8, 0), (8, 0)])).passes) <= 1


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ([0.0, 1.0, 2.0], [0, 1, 2]),
        ([0.0, 0.5, 1.0, 1.5, 2.0, 2.5], [0, 1, 2]),
        ([0.0, 2.0], [0, 1, 2]),
        ([0.0], [0, 1, 2]),
    ],
)
def test_samples_are_at_key_frames_and_between_far_ones(keys: list[float], expected: list[float]) -> None:
    assert sample_stamps(keys, 3.0, 1.0) == pytest.approx(expected)


def test_the_site_file_holds_the_passes_and_is_not_overwritten(woven: Woven, tmp_path: Path) -> None:
    output, sheet = tmp_path / "site.yaml", tmp_path / "sheet.png"
    assert [row_pass.sides for row_pass in split(woven.file, output, sheet=sheet).passes] == [("left", "right")] * 3
    site = load_site(output)
    assert list(site.rows) == [f"pass-{n}-{side}" for n in (1, 2, 3) for side in ("left", "right")]
    drive_ = site.rows["pass-2-right"].passes[0]
    assert drive_.side == "right"
    assert drive_.video.resolve() == woven.file
    assert (drive_.start_s, drive_.end_s) == (woven.found.passes[1].start_s, woven.found.passes[1].end_s)
    picture = cv2.imread(str(sheet))
    assert picture.shape[0] == 240 + 3 * 208
    assert picture.shape[1] == 320 + 3 * 400
    with pytest.raises(OutputError, match="--into"):
        split(woven.file, output)


@pytest.mark.parametrize("ending", ["", "\n", "\n\n# the end\n", "\njoint: false\n"])
def test_rows_are_added_and_the_site_file_is_else_unchanged(tmp_path: Path, ending: str) -> None:
    path = tmp_path / "site.yaml"
    text = "# mine\nplugins: {shelves: {}}\nrows:\n    A:   # kept\n        passes: [{video: a.mp4}]" + ending
    path.write_text(text, encoding="utf-8")
    for _ in range(2):
        add_to_site([ONE], tmp_path / "films" / "long.mp4", path)
    written = path.read_text(encoding="utf-8")
    assert written.startswith(text[: text.index("}]") + 2])
    assert all(line in written.splitlines() for line in text.splitlines())
    site = load_site(path)
    assert list(site.rows) == ["A", "pass-1-left", "pass-2-left"]
    assert site.rows["pass-2-left"].passes[0].video == tmp_path / "films/long.mp4"
    assert site.joint == ("joint" not in ending)


def test_rows_are_added_after_the_comments_of_the_last_one(tmp_path: Path) -> None:
    row = "  A:\n    passes:\n      - video: a.mp4\n        # side: left\n    # place: {x_m: 0}\n  # B is to come\n"
    text = f"references: {{camera_height_m: {{value: 3}}}}\nrows:\n{row}plugins: {{}}\n"
    (tmp_path / "site.yaml").write_text(text, encoding="utf-8")
    add_to_site([ONE], tmp_path / "b.mp4", tmp_path / "site.yaml")
    before, after = (tmp_path / "site.yaml").read_text(encoding="utf-8").split("  # found by `savmap split`")
    assert before.endswith("    # place: {x_m: 0}\n")
    assert after.endswith("  # B is to come\nplugins: {}\n")


def test_rows_within_braces_are_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("rows: {A: {passes: [{video: a.mp4}]}}\n", encoding="utf-8")
    with pytest.raises(SiteError, match="braces"):
        add_to_site([ONE], tmp_path / "long.mp4", path)
    assert yaml.safe_load(path.read_text(encoding="utf-8")) == {"rows": {"A": {"passes": [{"video": "a.mp4"}]}}}


def test_recordings_without_a_pass_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    file, _ = recording(tmp_path, block((-30, 30), (-30, 30)), cart([(0, 0), (0.2, 0)], stops=[(0.1, 4.0)]))
    with pytest.raises(StructureError, match="no pass was found"):
        find(file)
    monkeypatch.setattr("sys.argv", ["savmap", "split", str(file), "-o", str(tmp_path / "site.yaml")])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 7
    assert "no pass was found" in capsys.readouterr().err
    assert not (tmp_path / "site.yaml").exists()


def test_what_is_no_recording_is_refused(tmp_path: Path, woven: Woven) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((64, 128, 3), np.uint8))
    with pytest.raises(VideoError, match="folder of pictures"):
        find(tmp_path)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(woven.file.read_bytes()[:2000])
    with pytest.raises(VideoError, match=r"cut\.mp4"):
        find(cut)
    with pytest.raises(OutputError, match=r"\.png"):
        split(woven.file, tmp_path / "site.yaml", sheet=tmp_path / "sheet.gif")
    assert not (tmp_path / "site.yaml").exists()


def test_passes_are_json_numbers(woven: Woven) -> None:
    assert json.loads(json.dumps([vars(one) for one in woven.found.passes]))
