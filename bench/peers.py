"""A point-cloud peer on the very same views: pycolmap beside savmap, camera positions against the truth of simulated footage.

    pip install pycolmap
    python bench/peers.py [SITE.yaml ...] [-o bench/results/peers.json]

The first row of each site is mapped; then the views of its face are rendered again for the frames that savmap looked at (same
directions, 640x480, focal length known) and given to pycolmap: SIFT, sequential matching, incremental mapping.
Printed: frames located, root mean square error of the camera's positions (savmap after rotation and translation only, for
its scale is part of what is asked; the peer after a seven-parameter alignment, for it has none), elements missing and
spurious, seconds on the clock and of processor time. Where a site has no `poses.json`, the peer is compared with savmap instead. Without arguments: the demo
clip, a short row, and a row of identical bays.
"""

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.files.atomic import write_text
from savmap.jobs.map_site import map_job
from savmap.jobs.scheduler import RunOptions
from savmap.lab.sim.scene.files import load_scene
from savmap.lab.sim.simulate import simulate
from savmap.report.evaluation import score_json
from savmap.site.job import job_for
from savmap.site.model import Pass
from savmap.types import RowMap
from savmap.types.progress import SilentMonitor
from savmap.video.reader import panoramas
from savmap.vision.views import Renderer

ROOT = Path(__file__).parent.parent
SCENES = ("short-row", "identical-row")
Places = dict[int, NDArray[np.float64]]
Clock = tuple[float, float]


def now() -> Clock:
    """Seconds on the clock, and of processor time of all this process's threads: the latter is the fairer on a busy machine."""
    return time.perf_counter(), time.process_time()


def elapsed(since: Clock) -> Clock:
    """The same, gone by since then."""
    clock, processor = now()
    return clock - since[0], processor - since[1]


def ours(site: Path) -> tuple[RowMap, Pass, dict[str, Any]]:
    """The map of a site's first row, its first pass, and what it is worth."""
    job = job_for(site, ["shelves"], Path())
    name = next(iter(job.site.rows))
    first_row = job.site.model_copy(update={"rows": {name: job.site.rows[name]}})
    since = now()
    run = map_job(replace(job, site=first_row), RunOptions(jobs=0), SilentMonitor())
    seconds, processor = elapsed(since)
    row = run.site_map.rows[name]
    figures: dict[str, Any] = {"seconds": seconds, "processor_s": processor, "frames": len(row.trajectory.frames)}
    if run.evaluation is not None:
        score = score_json(run.evaluation.rows[name])
        figures |= {key: score[key] for key in ("missing", "spurious", "mae_m")}
    return row, job.site.rows[name].passes[0], figures


def places_of(row: RowMap) -> Places:
    """Camera positions by frame, m."""
    return dict(zip(row.trajectory.frames.tolist(), row.trajectory.world_from_rig[:, :3, 3], strict=True))


def true_places(site: Path, row: str) -> Places | None:
    """The truth of simulated footage in the row's frame, None where there is none."""
    path = site.with_name("poses.json")
    if not path.is_file():
        return None
    content = json.loads(path.read_text(encoding="utf-8"))
    frame = content["rows"][row]
    rotation, origin = np.array(frame["world_from_row"]), np.array(frame["origin"])
    return {
        entry["frame"]: (np.array(entry["world_from_rig"])[:3, 3] - origin) @ rotation for entry in content["frames"]
    }


def write_views(row: RowMap, row_pass: Pass, folder: Path) -> float:
    """Render the face's view of every frame as frame-NNNNN.png; gives its focal length in pixels."""
    spec = next(spec for name, spec in row.views.items() if "face" in name)
    renderer = Renderer()
    for panorama in panoramas(row_pass.clip):
        image = renderer.render(panorama, spec).image
        cv2.imwrite(str(folder / f"frame-{panorama.frame:05d}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return float(spec.camera[0, 0])


def peer(folder: Path, focal_px: float) -> tuple[Places, Clock]:
    """Camera positions of the largest model that pycolmap makes of a folder of views, up to a similarity, and its time."""
    import pycolmap

    since = now()
    work = folder.with_name("pycolmap")
    work.mkdir()
    database = work / "database.db"
    parameters = f"{focal_px},{focal_px},320,240"
    reader = pycolmap.ImageReaderOptions(camera_model="PINHOLE", camera_params=parameters)
    pycolmap.extract_features(database, folder, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
    pycolmap.match_sequential(database)
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = options.ba_refine_principal_point = False
    models = pycolmap.incremental_mapping(database, folder, work, options=options)
    spent = elapsed(since)
    if not models:
        return {}, spent
    best = max(models.values(), key=lambda model: model.num_reg_images())
    return {
        int(image.name[6:11]): np.asarray(image.projection_center()) for image in best.images.values() if image.has_pose
    }, spent


def misplaced(places: Places, truth: Places, scaled: bool) -> float:
    """Root mean square distance, m, of positions after the best rotation, translation and, if `scaled`, scale (Umeyama 1991)."""
    common = sorted(set(places) & set(truth))
    if len(common) < 3:
        return float("nan")
    a, b = (np.array([known[frame] for frame in common]) for known in (places, truth))
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    u, singular, v = np.linalg.svd((b - mean_b).T @ (a - mean_a))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = float(np.trace(np.diag(singular) @ sign) / np.sum((a - mean_a) ** 2)) if scaled else 1.0
    moved = scale * (a - mean_a) @ (u @ sign @ v).T + mean_b
    return float(np.sqrt(np.mean(np.sum((moved - b) ** 2, axis=1))))


def compare(site: Path, folder: Path) -> dict[str, Any]:
    """Both on one site."""
    row, row_pass, figures = ours(site)
    views = folder / "views"
    views.mkdir()
    positions, (seconds, processor) = peer(views, write_views(row, row_pass, views))
    truth = true_places(site, row.name)
    if truth is not None:
        figures["rmse_m"] = misplaced(places_of(row), truth, scaled=False)
    other = {
        "frames": len(positions),
        "rmse_m": misplaced(positions, truth if truth is not None else places_of(row), scaled=True),
        "against": "truth" if truth is not None else "savmap",
        "seconds": seconds,
        "processor_s": processor,
    }
    return {"savmap": figures, "pycolmap": other, "time_ratio": figures["seconds"] / seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", type=Path, nargs="*")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "peers.json")
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as temporary:
        base = Path(temporary)
        sites = arguments.sites or [ROOT / "examples" / "aisle-dev" / "site.yaml", *made(base)]
        for number, site in enumerate(sites):
            folder = base / str(number)
            folder.mkdir()
            results[site.parent.name] = result = compare(site, folder)
            print(f"{site.parent.name}: savmap takes {result['time_ratio']:.2f} of the peer's time")
            for name in ("savmap", "pycolmap"):
                print(f"  {name:9s}", json.dumps(result[name]), flush=True)
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


def made(base: Path) -> list[Path]:
    """Footage of the example scenes."""
    for name in SCENES:
        simulate(load_scene(ROOT / "examples" / "scenes" / f"{name}.yaml"), base / name)
    return [base / name / "site.yaml" for name in SCENES]


if __name__ == "__main__":
    main()
