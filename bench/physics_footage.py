"""Wrong footage: does a map that cannot be right ever end as `trusted`?

    python bench/physics_footage.py SITE.yaml [SITE.yaml ...] [--case NAME ...] [--map all|quiet|none] [-o bench/results/physics_footage.json]

Each site's first row is mapped from clips made of its own video: there and back, cuts, gaps, other packings, and harmless changes.
The footage is looked at first, without networks, as `savmap map` does; where that says nothing (`--map quiet`, the default), or in any
case (`all`), the row is mapped and compared with the survey beside the site file. A case is right where it ends as expected: refused or
`check` for the true reason, or `trusted` with every edge within 3 standard deviations and a centimetre. The last line counts those that
end `trusted` and wrong.
"""

import argparse
import json
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

import savmap
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.geometry import pinhole
from savmap.geometry.sphere import panorama_pixels_from_rays, rays_from_panorama_pixels
from savmap.pipeline.trust.footage import require_course, require_panoramas
from savmap.site.load import load_site
from savmap.types import Doubt, Floats, Structure
from savmap.video.footage.watch import PassWatch, Steps
from savmap.video.reader import Clip, panoramas, preview_frames

ROOT = Path(__file__).parent.parent
Image = NDArray[np.uint8]
Frames = list[tuple[float, Image]]
"""Times (s) and RGB pictures."""
SIGMAS, SLACK_M = 3.0, 0.01


@dataclass(frozen=True)
class Case:
    """A way to change a row's clip. `words`: a pattern of the true reason, where it is to be caught; "" where the map is to be trusted.
    `either`: it may also be trusted, if it is right. `side`, `part`: the
    hand and the part of the clip (shares) that the site file says. `new_way`: the rig goes in another direction of its panorama."""

    name: str
    change: Callable[[Frames, Frames], Frames]
    words: str = ""
    either: bool = False
    side: Callable[[str], str] = field(default=lambda side: side)
    part: tuple[float, float] | None = None
    new_way: bool = False
    container: Mapping[str, Any] = field(default_factory=dict)


def again(frames: Frames, pictures: Sequence[Image]) -> Frames:
    """Pictures at the rate of the clip."""
    step = frames[1][0] - frames[0][0]
    return [(index * step, picture) for index, picture in enumerate(pictures)]


def of(change: Callable[[Image], Image]) -> Callable[[Frames, Frames], Frames]:
    """A change of every picture."""
    return lambda frames, _: [(stamp, change(picture)) for stamp, picture in frames]


def ordered(order: Callable[[list[Image]], list[Image]]) -> Callable[[Frames, Frames], Frames]:
    """A change of the pictures' order and number."""
    return lambda frames, _: again(frames, order([picture for _, picture in frames]))


def sampled(picture: Image, rays: Floats) -> Image:
    """The panorama's values (h, w, 3) in directions (h, w, 3)."""
    pixels = panorama_pixels_from_rays(rays, len(picture)).astype(np.float32)
    return np.asarray(cv2.remap(picture, pixels, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint8)  # type: ignore[call-overload] # fmt: skip


def rays_of(width: int, height: int, wide: float) -> Floats:
    """Rays (height, width, 3) of an equirectangular picture `wide` radians wide."""
    longitude = wide * ((np.arange(width) + 0.5) / width - 0.5)
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    return np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.sin(longitude), -np.sin(latitude), np.cos(latitude) * np.cos(longitude)
        ),
        axis=-1,
    )


def turned(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Callable[[Image], Image]:
    """As by a camera that is turned."""
    rotation = pinhole.rig_from_view(yaw, pitch, roll)

    def change(picture: Image) -> Image:
        height = len(picture)
        x, y = np.meshgrid(np.arange(2 * height), np.arange(height))
        return sampled(picture, rays_from_panorama_pixels(np.dstack([x, y]).astype(float), height) @ rotation.T)

    return change


def eyes(width: float, above: bool) -> Callable[[Image], Image]:
    """Two eyes' pictures in one, `width` radians wide each."""

    def change(picture: Image) -> Image:
        height = len(picture)
        size = (2 * height, height // 2) if above else (height, height)
        both = [sampled(picture, rays_of(*size, width) @ pinhole.rig_from_view(eye, 0, 0).T) for eye in (-1.2, 1.2)]
        return np.vstack(both) if above else np.hstack(both)

    return change


def two_fisheyes(picture: Image) -> Image:
    """Two lenses of 200 degrees, back to back."""
    height = len(picture)
    x, y = np.meshgrid(*2 * [(np.arange(height) + 0.5) / height * 2 - 1])
    radius = np.hypot(x, y)
    angle = radius * np.radians(100)
    rays = np.dstack([np.sin(angle) * x / radius, np.sin(angle) * y / radius, np.cos(angle)])
    lenses = [sampled(picture, rays @ pinhole.rig_from_view(turn, 0, 0).T) for turn in (0.0, 180.0)]
    return np.asarray(np.hstack([np.where(radius[..., None] < 1, lens, 0) for lens in lenses]), np.uint8)


def ordinary(picture: Image) -> Image:
    """A flat picture of 100 degrees."""
    height = len(picture)
    x, y = np.meshgrid((np.arange(2 * height) + 0.5) / height - 1, (np.arange(height) + 0.5) / height - 0.5)
    return sampled(picture, np.dstack([1.2 * x, 1.2 * y, np.ones_like(x)]))


def lit(gain: float, noise: float = 0.0) -> Callable[[Image], Image]:
    """As by another exposure, with noise."""
    rng = np.random.default_rng(4)
    return lambda picture: np.clip(
        picture * gain + (rng.normal(0, noise, picture.shape) if noise else 0.0), 0, 255
    ).astype(np.uint8)


def patched(picture: Image) -> Image:
    """With a tripod's patch and a logo below."""
    copy = picture.copy()
    copy[int(0.88 * len(copy)) :] = 20
    cv2.putText(copy, "CAMERA", (len(copy) // 2, int(0.97 * len(copy))), 0, len(copy) / 500, (255, 255, 255), 4)
    return copy


def seamed(picture: Image) -> Image:
    """Two lenses of different exposure."""
    gain = np.where(np.abs(np.arange(picture.shape[1]) / picture.shape[1] - 0.5) < 0.25, 0.8, 1.1)
    return np.clip(picture * gain[None, :, None], 0, 255).astype(np.uint8)


def smeared_lens(centre_deg: float, wide_deg: float, sigma: float) -> Callable[[Image], Image]:
    """A smear on a lens: a part of the panorama around a longitude is dull and blurred in all frames."""

    def change(picture: Image) -> Image:
        height, width = picture.shape[:2]
        blurred = cv2.GaussianBlur(picture, (0, 0), sigma * height / 1000)
        x, y = (np.arange(width) + 0.5) / width * 360 - 180, (np.arange(height) + 0.5) / height * 180 - 90
        away = np.hypot((x[None, :] - centre_deg + 180) % 360 - 180, y[:, None]) / wide_deg
        share = np.clip(2 - 2 * away, 0, 1)[..., None]
        return np.asarray(np.clip((1 - share) * picture + share * (0.7 * blurred + 50), 0, 255), np.uint8)

    return change


def out_of_focus(picture: Image) -> Image:
    """The whole panorama blurred by a three hundredth of its height."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), len(picture) / 300), np.uint8)


def cropped(share: float) -> Callable[[Image], Image]:
    """Cut above and below by a share of the height, and stretched to 2:1 again."""

    def change(picture: Image) -> Image:
        height, width = picture.shape[:2]
        cut = round(share * height)
        return np.asarray(cv2.resize(picture[cut : height - cut], (width, height), interpolation=cv2.INTER_AREA))

    return change


def from_middle(change: Callable[[Image], Image]) -> Callable[[Frames, Frames], Frames]:
    """A change from the middle of the clip on."""
    return lambda frames, _: [
        (stamp, change(picture) if index >= len(frames) // 2 else picture)
        for index, (stamp, picture) in enumerate(frames)
    ]


def without(frames: Frames, stamped: bool) -> Frames:
    """Without a sixth of the frames, in the middle; `stamped`: the others keep their times."""
    middle, count = len(frames) // 2, len(frames) // 6
    kept = [*frames[:middle], *frames[middle + count :]]
    return kept if stamped else again(frames, [picture for _, picture in kept])


def u_turn(pictures: list[Image]) -> list[Image]:
    """To the end, round, and back."""
    turning = [turned(angle)(pictures[-1]) for angle in range(20, 180, 20)]
    return [*pictures, *turning, *map(turned(180), pictures[::-1])]


def smeared(pictures: list[Image]) -> list[Image]:
    """With one frame that shows nothing."""
    grey = np.random.default_rng(3).integers(0, 255, pictures[0].shape, dtype=np.uint8)
    return [*pictures[: len(pictures) // 2], grey, *pictures[len(pictures) // 2 + 1 :]]


def other_hand(side: str) -> str:
    return "left" if side == "right" else "right"


BACK = "goes back the way it came"
CASES = (
    Case("as it is", of(lambda picture: picture)),
    Case("turned by 70 degrees", of(turned(70)), new_way=True),
    Case("pitched by 15 degrees", of(turned(0, 15, 5)), new_way=True),
    Case(
        "upside down",
        of(turned(0, 0, 180)),
        "upside down|no building|no structure|tilted|contradict|sections were found",
        True,
        new_way=True,
    ),
    Case("reversed", ordered(lambda p: p[::-1]), side=other_hand),
    Case(
        "reversed, side as it was",
        ordered(lambda p: p[::-1]),
        "contradict|not on the|side|heights|sections were found|reference|rest says",
    ),
    Case(
        "mirrored",
        of(lambda p: p[:, ::-1]),
        "contradict|heights|sections were found|reference|rest says|residual",
        new_way=True,
    ),
    Case("there and back", ordered(lambda p: [*p, *p[::-1]]), BACK),
    Case("there and a third back", ordered(lambda p: [*p, *p[::-1][: len(p) // 3]]), BACK),
    Case("there, round and back", ordered(u_turn), f"{BACK}|turned away"),
    Case(
        "hesitates",
        ordered(lambda p: [*p[: len(p) // 2], *p[len(p) // 2 - 6 : len(p) // 2][::-1], *p[len(p) // 2 - 6 :]]),
        BACK,
        True,
    ),
    Case(
        "turns away at the end",
        ordered(lambda p: [*p, *[turned(a)(p[-1]) for a in range(15, 106, 15)]]),
        "turned away",
        True,
    ),
    Case("stands for ten frames", ordered(lambda p: [*p[: len(p) // 2], *[p[len(p) // 2]] * 10, *p[len(p) // 2 :]])),
    Case(
        "stands most of the time",
        ordered(lambda p: [*p[: len(p) // 2], *[p[len(p) // 2]] * 2 * len(p), *p[len(p) // 2 :]]),
        "stands for",
        True,
    ),
    Case("every frame twice", ordered(lambda p: [one for one in p for _ in (0, 1)])),
    Case("gap, times kept", lambda frames, _: without(frames, True), "frames are missing"),
    Case("gap, times rewritten", lambda frames, _: without(frames, False), "frames are missing"),
    Case(
        "three frames missing",
        ordered(lambda p: [*p[: len(p) // 2], *p[len(p) // 2 + 3 :]]),
        "frames are missing",
        True,
    ),
    Case(
        "cut to another row",
        lambda frames, other: again(frames, [p for _, p in [*frames[: len(frames) // 2], *other[5:25]]]),
        "a cut|after a cut",
    ),
    Case("cut, camera turned round", from_middle(turned(180)), "a cut|after a cut"),
    Case("turned by 90 degrees half-way", from_middle(turned(90)), "a cut|after a cut|turned away"),
    Case("turned by 20 degrees half-way", from_middle(turned(20)), "a cut|after a cut|turned away", True),
    Case("cropped and stretched", of(cropped(0.08)), "whole equirectangular|no panorama|contradict|rest says|fit"),
    Case("smear on a lens, left", of(smeared_lens(-90, 50, 8.0)), "seen|measured|fit|support|part|sections", True),
    Case("smear on a lens, right", of(smeared_lens(90, 50, 8.0)), "seen|measured|fit|support|part|sections", True),
    Case("out of focus", of(out_of_focus), "seen|measured|fit|part|sections", True),
    Case("one smeared frame", ordered(smeared)),
    Case("step of exposure", from_middle(lit(1.6))),
    Case("dark", of(lit(0.3, 3.0))),
    Case("tripod and logo", of(patched)),
    Case("lenses exposed differently", of(seamed)),
    Case("the first half only", of(lambda p: p), "part|heights|sections|seen|no such thing was found", part=(0.0, 0.5)),
    Case("VR180 side by side", of(eyes(np.pi, False)), "side by side"),
    Case("stereo side by side", of(eyes(2 * np.pi, False)), "side by side"),
    Case("stereo above one another", of(eyes(2 * np.pi, True)), "one eye above"),
    Case("two fisheyes", of(two_fisheyes), "fisheye"),
    Case("ordinary video", of(ordinary), "no panorama"),
    Case("flag: turn by 180 degrees", of(lambda p: p), "to be turned", container={"degrees": 180}),
    Case("two streams", of(lambda p: p), "2 video streams", container={"streams": 2}),
)


def read(video: Path) -> Frames:
    """All frames of a video."""
    return [(panorama.stamp_s, panorama.image) for panorama in panoramas(Clip(video, fps=1000.0))]


def write(path: Path, frames: Frames, degrees: float = 0.0, streams: int = 1) -> None:
    """An H.264 video of pictures with their times."""
    with av.open(str(path), "w") as container:
        opened = []
        for _ in range(streams):
            stream = container.add_stream("libx264", rate=30, options={"crf": "14", "preset": "ultrafast", "g": "10"})
            stream.height, stream.width, stream.pix_fmt = *frames[0][1].shape[:2], "yuv420p"
            stream.codec_context.time_base = Fraction(1, 90000)
            stream.set_display_rotation(degrees)
            opened.append(stream)
        for stamp, picture in frames:
            for stream in opened:
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
                frame.pts, frame.time_base = round(stamp * 90000), Fraction(1, 90000)
                container.mux(stream.encode(frame))
        for stream in opened:
            container.mux(stream.encode())


def steps_of(video: Path) -> Steps:
    """How the camera went."""
    watch = PassWatch()
    for panorama in panoramas(Clip(video)):
        watch.update(panorama)
    return watch.steps


def usual_attitude(steps: Steps, side: str) -> Floats:
    """A made-up attitude (3, 3) of which only the direction of the face's +x counts: that of the clean clip, by its side."""
    ways = np.radians(np.array([motion.way for motion in steps.motions]) + steps.heading_deg)
    way = float(np.angle(np.exp(1j * ways).sum())) + (np.pi if side == "right" else 0.0)
    return np.array([[np.sin(way), 0.0, np.cos(way)], [0, 1, 0], [0, 0, 1]])


def looked_at(clip: Path, attitude: Floats) -> tuple[str, Sequence[Doubt]]:
    """What the footage alone says: an error in words, or doubts."""
    try:
        doubts = require_panoramas(clip, preview_frames(Clip(clip))[0])
        return "", (*doubts, *require_course("pass 1", clip, steps_of(clip), attitude, None))
    except SavmapError as error:
        return str(error), ()


def site_of(site: Path, clip: Path, case: Case, length_s: float) -> Path:
    """A site file that maps the first row of a site from another clip."""
    content = yaml.safe_load(site.read_text(encoding="utf-8"))
    name, row = next(iter(content["rows"].items()))
    part = {} if case.part is None else {"start_s": case.part[0] * length_s, "end_s": case.part[1] * length_s}
    row["passes"] = [{"video": str(clip), "side": case.side(row["passes"][0]["side"]), **part}]
    content["rows"], content["survey"] = {name: row}, str(site.with_name("survey.json").resolve())
    path = clip.with_suffix(".yaml")
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def mapped(site: Path, survey: Path) -> dict[str, Any]:
    """How mapping ends: the ending, the reasons, and how far off the worst structure is."""
    try:
        site_map = savmap.map_site(site, ["shelves"])
    except SavmapError as error:
        return {"ending": "refused", "reasons": [str(error)]}
    (row,) = site_map.rows.values()
    assert row.verdict is not None
    score = savmap.evaluate(site_map, survey).rows[row.name]
    sigma = {structure.id: worst_sigma(structure) for structure in row.structures["shelves"]}
    off = {name: error for name, error in score.deviations.items() if error > SIGMAS * sigma[name] + SLACK_M}
    lost = sum(score.missing.values()) + sum(score.spurious.values())
    return {
        "ending": row.verdict.grade,
        "reasons": [f"{doubt.kind}: {doubt.what}" for doubt in row.verdict.doubts],
        "right": not off and not lost,
        "worst_cm": 100 * max(score.deviations.values(), default=float("inf")),
        "lost": lost,
    }


def worst_sigma(structure: Structure) -> float:
    """The largest standard deviation of a structure's corners in the face's plane, m."""
    return float(np.sqrt(np.diagonal(structure.covariances[:, :2, :2], axis1=1, axis2=2).max()))


def judged(case: Case, result: Mapping[str, Any]) -> str:
    """How a case's result stands to what is expected."""
    if result["ending"] == "trusted":
        if not result["right"]:
            return "SILENTLY WRONG"
        return "ok" if not case.words or case.either else "ok (right all the same)"
    if not case.words:
        footage = result["ending"] == "refused" or any(
            re.match("camera|motion", reason) for reason in result["reasons"]
        )
        return "false alarm" if footage else "doubted by others"
    return "ok" if re.search(case.words, " ".join(result["reasons"])) else "other reason"


def run(case: Case, clip: Path, frames: Frames, site: Path, attitude: Floats, which: str) -> dict[str, Any]:
    """One case on one row, whose changed clip is written already."""
    start = time.perf_counter()
    error, doubts = looked_at(clip, attitude)
    reasons = [error] if error else [f"{doubt.kind}: {doubt.what}" for doubt in doubts]
    result: dict[str, Any] = {"ending": "refused" if error else "check", "reasons": reasons, "by": "footage"}
    if which == "all" or (which == "quiet" and not reasons):
        result = mapped(site_of(site, clip, case, frames[-1][0]), site.with_name("survey.json"))
        result["by"] = "map"
    elif not reasons:
        result = {"ending": "not mapped", "reasons": [], "by": "footage"}
    result["seconds"] = time.perf_counter() - start
    result["verdict"] = "quiet" if result["ending"] == "not mapped" else judged(case, result)
    return result


def line(row: str, case: Case, result: Mapping[str, Any]) -> str:
    """One line of the table."""
    error = f"{result['worst_cm']:8.1f}" if "worst_cm" in result else 8 * " "
    reason = result["reasons"][0].split("/")[-1][:90] if result["reasons"] else ""
    return f"{row:10} {case.name:28} {result['ending']:10} {error} {result['verdict']:24} {reason}"


def runs(
    sites: Sequence[Path], names: Sequence[str], which: str, folder: Path
) -> Iterator[tuple[str, Case, dict[str, Any]]]:
    """All cases on all rows."""
    videos = [next(iter(load_site(site).rows.values())).passes[0] for site in sites]
    for number, (site, one) in enumerate(zip(sites, videos, strict=True)):
        frames = read(one.video)
        other = read(videos[(number + 1) % len(videos)].video)
        attitude = usual_attitude(steps_of(one.video), one.side or "left")
        for case in (case for case in CASES if not names or case.name in names):
            clip = folder / "clip.mp4"
            write(clip, case.change(frames, other), **case.container)
            way = usual_attitude(steps_of(clip), one.side or "left") if case.new_way else attitude
            yield site.absolute().parent.name, case, run(case, clip, frames, site, way, which)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", nargs="+", type=Path)
    parser.add_argument("--case", action="append", default=[], choices=[case.name for case in CASES])
    parser.add_argument("--map", choices=["all", "quiet", "none"], default="quiet")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "physics_footage.json")
    arguments = parser.parse_args()
    results: dict[str, dict[str, Any]] = {}
    print(f"{'row':10} {'case':28} {'ending':10} {'worst cm':>8} {'verdict':24} reason", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        for row, case, result in runs(arguments.sites, arguments.case, arguments.map, Path(scratch)):
            results.setdefault(row, {})[case.name] = result
            print(line(row, case, result), flush=True)
            write_text(arguments.output, json.dumps(results, indent=2) + "\n")
    every = [result["verdict"] for of_row in results.values() for result in of_row.values()]
    print(
        f"{len(every)} cases; false alarms: {every.count('false alarm')}, other reasons: {every.count('other reason')}"
    )
    print(f"silently wrong: {every.count('SILENTLY WRONG')}")


if __name__ == "__main__":
    main()
