"""Wrong footage: does a map that cannot be right ever end as `trusted`?

    python -m bench physics-footage SITE.yaml [SITE.yaml ...] [--ways drives files cameras] [--case NAME ...] [--map all|quiet|none]

Each site's first row is mapped from clips made of its video: there and back, cuts, gaps and harmless changes (`drives`), the same
pictures in other files (`files`), and what real cameras give (`cameras`, of simulated rows: `poses.json` beside the site file).
The footage is examined first, without networks, as `savmap map` does; where that says nothing (`--map quiet`, the default), or in any
case (`all`), the row is mapped and compared with the survey beside the site file. A case is right where it ends as expected: refused or
`check` for the true reason, or `trusted` with every edge within 3 standard deviations and a centimetre.
"""

import argparse
import re
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import savmap
from bench.baseline import Figures
from bench.clip_cases import CASES, FILES, Case, camera_cases
from bench.clips import Frames, Packing, read, write
from savmap.errors import SavmapError
from savmap.pipeline.trust.footage import require_course, require_panoramas
from savmap.site.load import load_site
from savmap.types import Floats, MapWarning, Structure
from savmap.video.motion import PassWatch, Steps
from savmap.video.reader import Clip, panoramas, preview_frames

WAYS = ("drives", "files", "cameras")
SIGMAS, SLACK_M = 3.0, 0.01
FOOTAGE = ("bad-panorama", "stretched-pictures", "lens-seam", "missing-frames", "camera-motion")
"""The codes of warnings about the footage."""


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


def looked_at(clip: Path, attitude: Floats) -> tuple[str, Sequence[MapWarning]]:
    """What the footage alone says: an error in words, or warnings."""
    try:
        warnings = require_panoramas(Clip(clip), preview_frames(Clip(clip))[0])
        return "", (*warnings, *require_course("pass 1", Clip(clip), steps_of(clip), attitude, None))
    except SavmapError as error:
        return str(error), ()


def reason(warning: MapWarning) -> str:
    """A warning with its details."""
    return "; ".join((warning.line, *warning.details))


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
        "reasons": [reason(warning) for warning in row.verdict.warnings],
        "right": not off and not lost,
        "mean_cm": 100 * float(np.mean(list(score.deviations.values()))) if score.deviations else float("inf"),
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
        footage = result["ending"] == "refused" or any(reason.startswith(FOOTAGE) for reason in result["reasons"])
        return "false alarm" if footage else "warned of by others"
    return "ok" if re.search(case.words, " ".join(result["reasons"])) else "other reason"


def ending_of(case: Case, clip: Path, frames: Frames, site: Path, attitude: Floats, which: str) -> dict[str, Any]:
    """One case on one row, whose changed clip is written already."""
    start = time.perf_counter()
    error, warnings = looked_at(clip, attitude)
    reasons = [error] if error else [reason(warning) for warning in warnings]
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
    return f"{row:10} {case.name:36} {result['ending']:10} {error} {result['verdict']:24} {reason}"


def cases_of(site: Path, ways: Sequence[str]) -> tuple[Case, ...]:
    """The cases of these kinds; those of cameras only where the camera's path is known."""
    poses = site.with_name("poses.json")
    cameras = camera_cases(poses) if "cameras" in ways and poses.is_file() else ()
    return (*(CASES if "drives" in ways else ()), *(FILES if "files" in ways else ()), *cameras)


def runs(
    sites: Sequence[Path], ways: Sequence[str], names: Sequence[str], which: str, folder: Path
) -> Iterator[tuple[str, Case, dict[str, Any]]]:
    """All cases on all rows."""
    videos = [next(iter(load_site(site).rows.values())).passes[0] for site in sites]
    for number, (site, one) in enumerate(zip(sites, videos, strict=True)):
        frames = read(one.video)
        other = read(videos[(number + 1) % len(videos)].video)
        attitude = usual_attitude(steps_of(one.video), one.side or "left")
        for case in (case for case in cases_of(site, ways) if not names or case.name in names):
            packing = Packing(**case.container)
            clip = folder / f"clip{packing.suffix}"
            write(clip, case.change(frames, other), packing)
            way = usual_attitude(steps_of(clip), one.side or "left") if case.new_way else attitude
            yield site.absolute().parent.name, case, ending_of(case, clip, frames, site, way, which)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("sites", nargs="+", type=Path)
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    parser.add_argument("--case", action="append", default=[])
    parser.add_argument("--map", choices=["all", "quiet", "none"], default="quiet")


def run(given: argparse.Namespace) -> Figures:
    """How many cases end in which way."""
    verdicts = []
    print(f"{'row':10} {'case':36} {'ending':10} {'worst cm':>8} {'verdict':24} reason", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        for row, case, result in runs(given.sites, given.ways, given.case, given.map, Path(scratch)):
            verdicts.append(result["verdict"].lower())
            print(line(row, case, result), flush=True)
    words = ("silently wrong", "false alarm", "other reason")
    return {"total": {"cases": len(verdicts), **{word: verdicts.count(word) for word in words}}}
