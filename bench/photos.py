"""What a network sees on photographs of real racks that were labelled by hand (docs/photographs.md).

    python bench/photos.py [--model FILE ...] [--ways letterboxed tiles scales] [--labels DIR --pictures DIR] [-o photos.json]

Without `--model` all networks that the plugin comes with are measured: mapping takes the one that sees more of a row. Three ways of showing a photograph: `letterboxed`, the whole of it scaled into one view
of 640x480; `tiles`, scaled so that its median front member is 10 px thick and cut into overlapping views; `scales`, the mean of the
probabilities at three scales. All figures are read at the photograph's own resolution (at most 1280 px wide); a pixel has a class
by the plugin's three thresholds, as in mapping, or where its probability is above one (`--threshold`):

- IoU of each class, over the pixels that are judged: those labelled `ignore` and those of rear members are not. In totals: the mean over
  photographs, and of all pixels together.
- found: front members of which at least half of the visible length is found. A member is cut across its long axis into slices of 1 px; a
  slice is found where more than half of its visible pixels have its class.
- wrong: connected regions of a class with more than 150 px of which less than 30 % lies on a member of that class, front or rear, or on
  what is to be ignored; of all such regions.
- found, by the contrast of members to what lies beside them, in grey levels.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from photo_files import PHOTOS, photo, scaled
from photo_labels import Bytes, Truth, read_pieces, truth_of
from photo_views import WAYS, Maps, Predict

from savmap.errors import OutputError
from savmap.files.atomic import read_json, write_text
from savmap.lab.train.data.dataset import IGNORE
from savmap.plugin.manager import load_class
from savmap.types import Thresholds
from savmap.vision.masks import connected_regions, hysteresis
from savmap.vision.networks.segmenter import Segmenter

TEST = Path(__file__).parent / "photos"
LEAST_REGION_PX, LEAST_SHARE = 150, 0.3
CONTRASTS = (("under 8", 0.0, 8.0), ("8 to 16", 8.0, 16.0), ("over 16", 16.0, np.inf))
"""Grey levels that a member differs by from what is beside it."""
SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph (H, W, 3) RGB and its labels."""

    name: str
    image: Bytes
    truth: Truth


@dataclass(frozen=True)
class Seen:
    """A front member: its contrast in grey levels, and the share of its visible length that was found."""

    contrast: float
    share: float

    @property
    def found(self) -> bool:
        """Whether at least half of it was."""
        return self.share >= 0.5


@dataclass(frozen=True)
class ClassScore:
    """A class in one photograph: pixels right and in question, front members, regions that are wrong and all of them."""

    both: int
    either: int
    members: tuple[Seen, ...]
    wrong: int
    regions: int

    @property
    def iou(self) -> float:
        """Intersection over union; NaN where there is nothing of the class."""
        return self.both / self.either if self.either else np.nan


Score = Mapping[str, ClassScore]
"""A photograph's scores by class."""


def score(maps: Maps, truth: Truth, classes: Sequence[str], thresholds: Thresholds) -> Score:
    """What probabilities (1 + classes, H, W) are worth."""
    return {
        name: class_score(hysteresis(maps[number], thresholds), truth, number, name)
        for number, name in enumerate(classes, start=1)
    }


def class_score(predicted: NDArray[np.bool_], truth: Truth, number: int, name: str) -> ClassScore:
    """What the pixels (H, W) that are said to be of the class `number` are worth. IoU is not known where no front member is."""
    judged, true = truth.judged != IGNORE, truth.judged == number
    known = bool(true.any())
    wrong, regions = wrong_regions(predicted, (truth.present == number) | (truth.present == IGNORE))
    return ClassScore(
        int((predicted & true).sum()),
        int(((predicted | true) & judged).sum()) if known else 0,
        tuple(
            Seen(member.contrast, found_share(predicted[member.rows, member.columns], member.slices))
            for member in truth.members
            if member.label == name
        ),
        wrong,
        regions,
    )


def found_share(predicted: NDArray[np.bool_], slices: NDArray[np.int64]) -> float:
    """The share of slices of which more than half of the pixels is predicted; both arrays (n,) are of a member's pixels."""
    sizes = np.bincount(slices)
    hits = np.bincount(slices, predicted)
    return float(np.mean(hits[sizes > 0] > sizes[sizes > 0] / 2))


def wrong_regions(predicted: NDArray[np.bool_], right: NDArray[np.bool_]) -> tuple[int, int]:
    """How many large regions of a prediction (H, W) lie too little where they may be, and how many there are."""
    found = connected_regions(predicted.view(np.uint8))
    large = np.flatnonzero(found.areas[1:] > LEAST_REGION_PX) + 1
    inside = np.bincount(found.labels[right], minlength=len(found.areas))
    return int(np.sum(inside[large] < LEAST_SHARE * found.areas[large])), len(large)


@dataclass(frozen=True)
class Count:
    """So many of all."""

    some: int
    every: int

    @property
    def percent(self) -> str:
        """To be printed; `-` of none."""
        return f"{100 * self.some / self.every:.0f} %" if self.every else "-"

    def __str__(self) -> str:
        return f"{self.some}/{self.every}"


@dataclass(frozen=True)
class Total:
    """A class's figures over photographs: the mean of their IoUs, that of all pixels together (NaN where there is nothing of the class),
    front members found, the same by contrast, and wrong regions."""

    iou: float
    pixel_iou: float
    found: Count
    by_contrast: Mapping[str, Count]
    wrong: Count

    def as_json(self) -> dict[str, object]:
        """Counts as [some, of all]."""
        return {
            "iou": round(self.iou, 4) if np.isfinite(self.iou) else None,
            "iou of all pixels": round(self.pixel_iou, 4) if np.isfinite(self.pixel_iou) else None,
            "found": [self.found.some, self.found.every],
            "found by contrast": {label: [count.some, count.every] for label, count in self.by_contrast.items()},
            "wrong": [self.wrong.some, self.wrong.every],
        }


Totals = Mapping[str, Total]
"""Figures by class."""


def totals(scores: Sequence[Score], classes: Sequence[str]) -> Totals:
    """Each class's figures over some photographs."""
    return {name: total([score[name] for score in scores]) for name in classes}


def total(parts: Sequence[ClassScore]) -> Total:
    """One class's figures over some photographs."""
    known = [part.iou for part in parts if np.isfinite(part.iou)]
    either = sum(part.either for part in parts)
    members = [member for part in parts for member in part.members]
    return Total(
        float(np.mean(known)) if known else np.nan,
        sum(part.both for part in parts) / either if either else np.nan,
        counted(members),
        {label: counted([m for m in members if low <= m.contrast < high]) for label, low, high in CONTRASTS},
        Count(sum(part.wrong for part in parts), sum(part.regions for part in parts)),
    )


def counted(members: Sequence[Seen]) -> Count:
    """How many members are found."""
    return Count(sum(member.found for member in members), len(members))


def indexed(folder: Path, cache: Path, classes: Sequence[str]) -> Iterator[Photograph]:
    """The photographs that a folder's `photos.json` lists, with the labels of the same names in `labels/`. Raises SavmapError."""
    entries = read_json(folder / "photos.json")
    assert isinstance(entries, list)
    for entry in entries:
        yield labelled(folder / "labels" / f"{entry['name']}.json", scaled(photo(entry, cache)), classes)


def others(labels: Path, pictures: Path, classes: Sequence[str]) -> Iterator[Photograph]:
    """Photographs that lie in a folder, with the labels of the same names in another. Raises OutputError."""
    for path in sorted(labels.glob("*.json")):
        file = next((found for suffix in SUFFIXES if (found := pictures / (path.stem + suffix)).is_file()), None)
        if file is None:
            raise OutputError(f"{path}: its photograph is not in {pictures}; put it there as {path.stem}.png")
        picture = cv2.imread(str(file), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if picture is None:
            raise OutputError(f"{file}: cannot be read as a picture; save it again")
        yield labelled(path, scaled(np.ascontiguousarray(picture[:, :, ::-1], np.uint8)), classes)


def labelled(path: Path, image: Bytes, classes: Sequence[str]) -> Photograph:
    """A photograph with the labels in a file. Raises OutputError that begins with the file's name."""
    pieces = read_pieces(path)
    try:
        return Photograph(path.stem, image, truth_of(pieces, image, classes))
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from None


def measured(
    predict: Predict, photographs: Sequence[Photograph], way: str, classes: Sequence[str], thresholds: Thresholds
) -> Iterator[tuple[str, Score]]:
    """Names and scores of photographs that are shown in one way."""
    for photograph in photographs:
        maps = WAYS[way](predict, photograph.image, photograph.truth.thickness_px)
        yield photograph.name, score(maps, photograph.truth, classes, thresholds)


def row(label: str, figures: Totals) -> str:
    """A line of the table: IoU, found and wrong of each class."""
    parts = figures.values()
    iou = "".join("       -" if np.isnan(part.iou) else f"{part.iou:8.2f}" for part in parts)
    found, wrong = (
        "".join(f"{count!s:>8s}" for count in counts)
        for counts in zip(*((p.found, p.wrong) for p in parts), strict=True)
    )
    return f"{label[:30]:30s} {iou}  {found}  {wrong}"


def header(classes: Sequence[str]) -> str:
    """The lines above the table."""
    width = 8 * len(classes)
    names = "".join(f"{name[:7]:>8s}" for name in classes)
    return f"{'':30s} {'IoU':>{width}s}  {'found':>{width}s}  {'wrong':>{width}s}\n{'':30s} {names}  {names}  {names}"


def summary(figures: Totals) -> Iterator[str]:
    """Lines below the table."""
    yield line("front members found", {name: part.found for name, part in figures.items()})
    for label, _, _ in CONTRASTS:
        yield line(f"  contrast {label}", {name: part.by_contrast[label] for name, part in figures.items()})
    yield line("wrong regions", {name: part.wrong for name, part in figures.items()})
    yield (
        f"  {'IoU of all pixels':22s}"
        + "".join(f"{f'{n} {part.pixel_iou:.2f}':26s}" for n, part in figures.items()).rstrip()
    )


def line(what: str, counts: Mapping[str, Count]) -> str:
    """Percentages of some counts."""
    parts = (f"{name} {count.percent:>5s} ({count})" for name, count in counts.items())
    return f"  {what:22s}" + "".join(f"{part:26s}" for part in parts).rstrip()


def networks(plugin: str) -> list[Path]:
    """The networks that a plugin comes with, its own first. Raises PluginError."""
    found = load_class(plugin)
    return [Path(found.model), *map(Path, getattr(found, "further_models", ()))]


def thresholds(given: argparse.Namespace) -> Thresholds:
    """The one of the command line, or those of the plugin's settings."""
    if given.threshold is not None:
        return Thresholds.of(given.threshold)
    settings = load_class(given.plugin).Config()
    return Thresholds.of(
        settings.threshold, *(getattr(settings, f"{name}_threshold", None) for name in ("weak", "seed"))
    )


def network(model: Path, threads: int) -> Segmenter:
    """A network with all its classes. Raises ModelError."""
    return Segmenter(model, threads, providers=("cpu",))


def predictor(segmenter: Segmenter, classes: Sequence[str]) -> Predict:
    """The network's probabilities in the order of `classes`; a class that it does not have is never seen.

    The labels hold whole members: what a network takes for a member's side (class `upright_side` beside `upright`) is of the member.
    """
    parts = [
        [segmenter.classes.index(part) + 1 for part in (name, f"{name}_side") if part in segmenter.classes]
        for name in classes
    ]

    def predict(image: Bytes) -> Maps:
        maps = segmenter.probabilities(image)
        return np.stack([maps[0], *(maps[own].sum(axis=0) for own in parts)]).astype(np.float32)

    return predict


def shown(
    segmenter: Segmenter, photographs: Sequence[Photograph], way: str, classes: Sequence[str], thresholds: Thresholds
) -> dict[str, object]:
    """Print the table of a network and a way as it is measured; what it says, for the JSON file."""
    print(f"{segmenter.path.name}, {way}, thresholds {', '.join(f'{one:g}' for one in thresholds)}\n{header(classes)}")
    scores: dict[str, Score] = {}
    for name, part in measured(predictor(segmenter, classes), photographs, way, classes, thresholds):
        scores[name] = part
        print(row(name, totals([part], classes)), flush=True)
    whole = totals(list(scores.values()), classes)
    print(row(f"all {len(scores)}", whole), *summary(whole), "", sep="\n", flush=True)
    return {
        "total": {name: part.as_json() for name, part in whole.items()},
        "photographs": {
            name: {label: part.as_json() for label, part in totals([found], classes).items()}
            for name, found in scores.items()
        },
    }


def arguments(given: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--model", type=Path, action="append", help="a network instead of those of the plugin; may be repeated"
    )
    parser.add_argument("--plugin", default="shelves", help="whose network and classes")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    parser.add_argument("--threshold", type=float, help="one for all pixels; by default the plugin's three")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--labels", type=Path, help="measure the photographs of this folder's labels instead")
    parser.add_argument("--pictures", type=Path, help="where they lie, by default beside the labels")
    parser.add_argument("--cache", type=Path, default=PHOTOS, help="where photographs are kept once they are fetched")
    parser.add_argument("-o", "--output", type=Path, help="a JSON file with the figures")
    return parser.parse_args(given)


def main(command: Sequence[str] | None = None) -> None:
    given = arguments(command)
    cv2.setNumThreads(given.threads)
    classes = tuple(load_class(given.plugin).classes)
    if given.labels is None:
        photographs = list(indexed(TEST, given.cache, classes))
    else:
        photographs = list(others(given.labels, given.pictures or given.labels, classes))
    results: dict[str, dict[str, object]] = {}
    for model in given.model or networks(given.plugin):
        segmenter = network(model, given.threads)
        results[str(model) if given.model else model.name] = {
            way: shown(segmenter, photographs, way, classes, thresholds(given)) for way in given.ways
        }
    if given.output is not None:
        write_text(given.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
