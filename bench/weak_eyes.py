"""Maps with a network made worse on purpose: the demo, or any site with a survey.

    python bench/weak_eyes.py [SITE.yaml SURVEY.json] [--seed 0] [-o bench/results/weak_eyes.json]

Every frame's probabilities are spoiled before the plugins see them: logits of the classes lowered by 1.5 (faint), 40 % of beams' pixels
lost in blobs (holes), false beams painted along goods in 30 % of the frames (false beams), and all three together. Printed: missing and
spurious elements and the mean absolute error.
"""

import argparse
import json
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import savmap
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.report.evaluation import as_json
from savmap.vision.networks.adapter import Segmentation
from savmap.vision.networks.segmenter import Segmenter

ROOT = Path(__file__).parent.parent
LOWERED, HOLES, FALSE_FRAMES = 1.5, 0.4, 0.3
BLOB_PX, FALSE_BEAMS = 9.0, 4
Maps = NDArray[np.float32]
Spoil = Callable[[Maps, NDArray[np.uint8], np.random.Generator], Maps]


def faint(maps: Maps, image: NDArray[np.uint8], rng: np.random.Generator) -> Maps:
    """Logits of all classes lowered against the background."""
    odds = maps[1:] / np.maximum(maps[:1], 1e-6) * np.exp(-LOWERED)
    total = 1 + odds.sum(axis=0)
    return np.concatenate([1 / total[None], odds / total]).astype(np.float32)


def holes(maps: Maps, image: NDArray[np.uint8], rng: np.random.Generator) -> Maps:
    """Beams' pixels lost in blobs."""
    noise = cv2.GaussianBlur(rng.normal(size=maps.shape[1:]).astype(np.float32), (0, 0), BLOB_PX)
    spoiled = maps.copy()
    spoiled[2][noise < np.quantile(noise, HOLES)] = 0.0
    return spoiled


def false_beams(maps: Maps, image: NDArray[np.uint8], rng: np.random.Generator) -> Maps:
    """Beams where level edges of the picture are that are none, in some of the frames."""
    if rng.random() > FALSE_FRAMES:
        return maps
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    level = np.abs(cv2.Sobel(cv2.blur(grey, (41, 3)), cv2.CV_32F, 0, 1))
    level[maps[1:].sum(axis=0) > 0.1] = 0.0
    spoiled = maps.copy()
    for _ in range(FALSE_BEAMS):
        row, column = np.unravel_index(int(level.argmax()), level.shape)
        length, thick = int(rng.uniform(40, 160)), int(rng.uniform(4, 12))
        place = (
            slice(max(int(row) - thick // 2, 0), int(row) + thick // 2 + 1),
            slice(max(int(column) - length // 2, 0), int(column) + length // 2),
        )
        spoiled[2][place] = np.maximum(spoiled[2][place], 0.95)
        level[max(int(row) - 15, 0) : int(row) + 16, max(int(column) - 80, 0) : int(column) + 80] = 0.0
    return spoiled


CASES: dict[str, Sequence[Spoil]] = {
    "as it is": (),
    "faint": (faint,),
    "holes": (holes,),
    "false beams": (false_beams,),
    "all three": (faint, holes, false_beams),
}


def spoiled_predict(spoils: Sequence[Spoil], seed: int) -> Callable[[Segmenter, NDArray[np.uint8]], Segmentation]:
    """What takes the place of `Segmenter.predict`: the same picture is spoiled the same way."""
    original = Segmenter.predict

    def predict(self: Segmenter, image: NDArray[np.uint8]) -> Segmentation:
        segmentation = original(self, image)
        if segmentation.classes != ("upright", "beam"):
            return segmentation
        rng = np.random.default_rng([seed, zlib.crc32(image.tobytes())])
        maps = segmentation.maps
        for spoil in spoils:
            maps = spoil(maps, image, rng)
        return Segmentation(segmentation.classes, maps, segmentation.owners)

    return predict


def figures_of(site: Path, survey: Path, spoils: Sequence[Spoil], seed: int) -> dict[str, object]:
    """The scores of a site's map by a spoiled network."""
    original = Segmenter.predict
    Segmenter.predict = spoiled_predict(spoils, seed)  # type: ignore[method-assign, assignment]
    try:
        scores = as_json(savmap.evaluate(savmap.map_site(site), survey))
        return {key: scores[key] for key in ("mae_m", "missing", "spurious")}
    except SavmapError as error:
        return {"error": str(error)}
    finally:
        Segmenter.predict = original  # type: ignore[method-assign]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    demo = ROOT / "savmap" / "demo"
    parser.add_argument("site", type=Path, nargs="?", default=demo / "site.yaml")
    parser.add_argument("survey", type=Path, nargs="?", default=demo / "survey.json")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=list(CASES), action="append")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "weak_eyes.json")
    arguments = parser.parse_args()
    results = {}
    print(f"{'':12s} missing  spurious   MAE cm")
    for name in arguments.only or CASES:
        figures = results[name] = figures_of(arguments.site, arguments.survey, CASES[name], arguments.seed)
        if "error" in figures:
            print(f"{name:12s} {figures['error']}", flush=True)
            continue
        missing, spurious = (sum(figures[key].values()) for key in ("missing", "spurious"))  # type: ignore[attr-defined]
        print(f"{name:12s} {missing:7d} {spurious:9d} {100 * figures['mae_m']:8.2f}", flush=True)  # type: ignore[operator]
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
