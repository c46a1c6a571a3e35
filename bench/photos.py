"""What a network sees on photographs of real racks that were labelled by hand (docs/photographs.md).

    python -m bench photos [--set dev|unseen] [--model FILE ...] [--ways letterboxed tiles scales] [--labels DIR --pictures DIR]

Without `--model` all networks that the plugin comes with are measured: mapping takes the one that sees more of a row. Three ways of showing a
photograph: `letterboxed`, scaled as a whole into a view of 640x480; `tiles`, scaled so that its median front member is 10 px thick and cut into
overlapping views; `scales`, the mean of the probabilities at three scales. All figures are read at the photograph's resolution (at most 1280 px
wide); a pixel has a class by the plugin's three thresholds, as in mapping, or where its probability is above `--threshold`:

- IoU of each class, over the pixels that count: those labelled `ignore` and those of rear members do not. In totals: the mean over
  photographs, and of all pixels together.
- found: front members of which at least half of the visible length is found. A member is cut across its long axis into slices of 1 px; a
  slice is found where more than half of its visible pixels have its class.
- wrong: connected regions of a class with more than 150 px of which less than 30 % lies on a member of that class, front or rear, or on
  what is to be ignored; of all such regions.
- found, by the contrast of members to what lies beside them, in grey levels.

Labels are LabelMe's (`savmap label`), with `flags.front` of each shape. A shape covers what lay there before; the label `background` stands for
goods that hide a member. Corners lie between pixels: pixel i reaches from i to i + 1.

Photographs of the set `dev` may be looked at, and each has a line of figures. Those of `unseen` are for the last word on a network: only
totals are printed, and nothing is to be chosen or mended by any one of them.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from bench.baseline import Figures
from bench.photo_files import PHOTOS, photo, scaled
from savmap.errors import OutputError
from savmap.files.atomic import read_json
from savmap.files.validation import checked
from savmap.lab.label.polygons import Polygon, filled
from savmap.lab.train.data.dataset import HEIGHT, IGNORE, WIDTH
from savmap.lab.train.data.sets import polygon_of
from savmap.plugin.manager import load_class
from savmap.types import Thresholds
from savmap.vision.masks import connected_regions, hysteresis
from savmap.vision.networks.segmenter import Segmenter

DATA = Path(__file__).parent / "photo_data"
SETS = {"dev": ("photos.json", "labels"), "unseen": ("unseen.json", "unseen")}
"""Lists of photographs and folders of their labels in DATA. Figures of one photograph are shown of `dev` alone."""
Bytes = NDArray[np.uint8]
CUT = {"upright"}
"""Classes whose members are drawn in several pieces, because others cross them: pieces in line are one member."""
LEAST_PIXELS = 12
LEAST_SIDE_PX = 10
GAP_PX = 1


class Shape(BaseModel):
    """A shape of LabelMe's."""

    label: str
    points: list[tuple[float, float]]
    flags: dict[str, bool] = Field(default_factory=dict)


class Shapes(BaseModel):
    """A file of LabelMe's."""

    shapes: list[Shape]


@dataclass(frozen=True, eq=False)
class Piece:
    """What was drawn: its label, whether it belongs to a rack's front, its corners (n, 2) px."""

    label: str
    front: bool
    outline: Polygon


@dataclass(frozen=True, eq=False)
class Member:
    """A front member as far as it is seen: rows and columns of its pixels (n,), and the slice (n,) across its long axis, 1 px
    long, that each pixel lies in. `contrast` is in grey levels, NaN where nothing beside it can be seen."""

    label: str
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    slices: NDArray[np.int64]
    contrast: float = np.nan

    @property
    def thickness_px(self) -> float:
        """Median number of its pixels in a slice."""
        counts = np.bincount(self.slices)
        return float(np.median(counts[counts > 0]))


@dataclass(frozen=True, eq=False)
class Truth:
    """Labels of a photograph (H, W): `judged` is 0 background, k a front member of the k-th class, IGNORE also where a rear member is;
    `present` is the same with rear members as members. `members` are those of the front."""

    judged: Bytes
    present: Bytes
    members: Sequence[Member] = field(default_factory=tuple)

    @property
    def thickness_px(self) -> float:
        """Thickness of the median front member, px. Raises OutputError where there is none."""
        if not self.members:
            raise OutputError(
                "no front member is labelled, so that there is no scale; label one, or leave the photograph out"
            )
        return float(np.median([member.thickness_px for member in self.members]))


def read_pieces(path: Path) -> list[Piece]:
    """What was drawn, in order of painting. Raises OutputError for a file that is not LabelMe's."""
    shapes = checked(Shapes, read_json(path), str(path)).shapes
    drawn = [(shape.label, shape.flags.get("front", True), shape.points) for shape in shapes]
    return [
        Piece(label, front, polygon_of([number for point in points for number in point], f"{path}: shape {index}"))
        for index, (label, front, points) in enumerate(drawn)
    ]


def truth_of(pieces: Sequence[Piece], image: Bytes, classes: Sequence[str]) -> Truth:
    """What is to be seen in a photograph (H, W, 3) RGB. Raises OutputError for a label that is none of the classes, `background` or
    `ignore`."""
    values = {"background": 0, "ignore": IGNORE, **{name: number for number, name in enumerate(classes, start=1)}}
    unknown = sorted({piece.label for piece in pieces} - values.keys())
    if unknown:
        raise OutputError(f"unknown label {', '.join(unknown)}; labels are {', '.join(values)}")
    owners = painted(pieces, *image.shape[:2])
    present = np.array([0, *(values[piece.label] for piece in pieces)], np.uint8)[owners]
    rear = [piece.label in classes and not piece.front for piece in pieces]
    judged = np.where(np.array([False, *rear])[owners], np.uint8(IGNORE), present)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    free = (present == 0) | (present == IGNORE)
    return Truth(judged, present, tuple(members(pieces, owners, grey, free, classes)))


def painted(pieces: Sequence[Piece], height: int, width: int) -> NDArray[np.int32]:
    """The number of the last piece, from 1, that covers each pixel (height, width); 0 where there is none."""
    owners = np.zeros((height, width), np.int32)
    for number, piece in enumerate(pieces, start=1):
        owners[filled(piece.outline, height, width)] = number
    return owners


def members(
    pieces: Sequence[Piece], owners: NDArray[np.int32], grey: Bytes, free: NDArray[np.bool_], classes: Sequence[str]
) -> Iterator[Member]:
    """The front members of which at least some pixels are seen; `free` (H, W) says where no member is."""
    for label in classes:
        own = {n: p.outline for n, p in enumerate(pieces, start=1) if p.front and p.label == label}
        for group in in_line(own) if label in CUT else [[number] for number in own]:
            seen = np.isin(owners, group)
            rows, columns = np.nonzero(seen)
            if len(rows) < LEAST_PIXELS:
                continue
            axis, _ = long_axis(np.concatenate([own[number] for number in group]))
            along = np.floor(columns * axis[0] + rows * axis[1]).astype(np.int64)
            member = Member(label, rows, columns, along - along.min())
            yield Member(label, rows, columns, member.slices, contrast(member, axis, grey, free))


def long_axis(outline: Polygon) -> tuple[NDArray[np.float64], float]:
    """Unit vector along the smallest rectangle around corners (n, 2), and the rectangle's length."""
    corners = cv2.boxPoints(cv2.minAreaRect(outline.astype(np.float32))).astype(np.float64)
    sides = corners[1:3] - corners[:2]
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(np.argmax(lengths))
    return sides[longer] / max(lengths[longer], 1e-9), float(lengths[longer])


def in_line(outlines: Mapping[int, Polygon]) -> list[list[int]]:
    """Groups of pieces: one belongs to a longer one if most of its width lies within that one's, prolonged."""
    groups: list[list[int]] = []
    for number in sorted(outlines, key=lambda n: -long_axis(outlines[n])[1]):
        piece = outlines[number]
        home = next((group for group in groups if any(_prolongs(piece, outlines[other]) for other in group)), None)
        if home is None:
            groups.append([number])
        else:
            home.append(number)
    return groups


def _prolongs(piece: Polygon, longer: Polygon) -> bool:
    axis, _ = long_axis(longer)
    across = np.array([-axis[1], axis[0]])
    (low, high), (first, last) = (((p @ across).min(), (p @ across).max()) for p in (piece, longer))
    return bool(min(high, last) - max(low, first) > (high - low) / 2)


def contrast(member: Member, axis: NDArray[np.float64], grey: Bytes, free: NDArray[np.bool_]) -> float:
    """How far a member's median grey level is from that of what lies beside it, within its own thickness, 1 px left out and members
    left out: the mean over its two sides. NaN where neither side shows 10 px."""
    reach = max(3, round(member.thickness_px)) + GAP_PX
    top, left = np.maximum([member.rows.min() - reach, member.columns.min() - reach], 0)
    window = slice(top, member.rows.max() + reach + 1), slice(left, member.columns.max() + reach + 1)
    own = np.zeros(grey[window].shape, np.uint8)
    own[member.rows - top, member.columns - left] = 1
    near, far = (cv2.dilate(own, np.ones((2 * px + 1, 2 * px + 1), np.uint8)) > 0 for px in (GAP_PX, reach))
    across, along = np.array([-axis[1], axis[0]]), axis
    rows, columns = np.nonzero(far & ~near & free[window])
    ends = np.stack([member.columns, member.rows], axis=1) @ along
    places = np.stack([columns + left, rows + top], axis=1)
    beside = (places @ along >= ends.min()) & (places @ along <= ends.max())
    offset = places @ across - np.mean(np.stack([member.columns, member.rows], axis=1) @ across)
    level = np.median(grey[member.rows, member.columns])
    around = grey[window][rows, columns]
    sides = [around[beside & (offset * sign > 0)] for sign in (-1, 1)]
    found = [abs(float(level - np.median(side))) for side in sides if len(side) >= LEAST_SIDE_PX]
    return float(np.mean(found)) if found else np.nan


Maps = NDArray[np.float32]
Predict = Callable[[Bytes], Maps]
"""Picture (480, 640, 3) RGB -> probabilities (1 + classes, 480, 640), background first."""

THICKNESS_PX = 10.0
"""How thick the median front member is in `tiles`."""
STEPS = (1.0, 1.6, 2.56)
"""The three scales of `scales`, in multiples of the one at which the whole photograph fits into a view."""
OVERLAP = 0.25
GREY = 127


def letterboxed(predict: Predict, image: Bytes, thickness_px: float) -> Maps:
    """Probabilities (1 + classes, H, W) of a photograph (H, W, 3) shown as a whole; its members' thickness is not used."""
    return at_scale(predict, image, fitting(image))


def tiles(predict: Predict, image: Bytes, thickness_px: float) -> Maps:
    """The same, of tiles in which the median front member is 10 px thick."""
    return at_scale(predict, image, THICKNESS_PX / thickness_px)


def scales(predict: Predict, image: Bytes, thickness_px: float) -> Maps:
    """The same, the mean over three scales: whole, and in tiles at 1.6 and 2.56 times that scale; members' thickness is not used."""
    shown = [at_scale(predict, image, step * fitting(image)) for step in STEPS]
    return np.asarray(np.mean(shown, axis=0), np.float32)


WAYS: dict[str, Callable[[Predict, Bytes, float], Maps]] = {
    "letterboxed": letterboxed,
    "tiles": tiles,
    "scales": scales,
}


def fitting(image: Bytes) -> float:
    """The scale at which a whole photograph fits into a view."""
    height, width = image.shape[:2]
    return float(min(WIDTH / width, HEIGHT / height))


def at_scale(predict: Predict, image: Bytes, scale: float) -> Maps:
    """Probabilities of a photograph that is scaled, shown in overlapping tiles, and read at its own resolution. A photograph smaller than
    a tile lies in the middle of a grey one."""
    height, width = image.shape[:2]
    size = max(1, round(width * scale)), max(1, round(height * scale))
    canvas = np.full((max(HEIGHT, size[1]), max(WIDTH, size[0]), 3), GREY, np.uint8)
    left, top = (canvas.shape[1] - size[0]) // 2, (canvas.shape[0] - size[1]) // 2
    inner = slice(top, top + size[1]), slice(left, left + size[0])
    canvas[inner] = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    how = cv2.INTER_AREA if scale > 1 else cv2.INTER_LINEAR
    planes = [cv2.resize(plane[inner], (width, height), interpolation=how) for plane in blended(predict, canvas)]
    return np.stack(planes).astype(np.float32)


def blended(predict: Predict, canvas: Bytes) -> Maps:
    """Probabilities of a picture at least as large as a tile: the mean of its tiles', weighted less towards their edges."""
    weight = np.minimum.outer(_ramp(HEIGHT), _ramp(WIDTH)).astype(np.float32)
    total = np.zeros(canvas.shape[:2], np.float32)
    sums: Maps | None = None
    for top in starts(canvas.shape[0], HEIGHT):
        for left in starts(canvas.shape[1], WIDTH):
            place = slice(top, top + HEIGHT), slice(left, left + WIDTH)
            maps = predict(np.ascontiguousarray(canvas[place]))
            sums = np.zeros((len(maps), *total.shape), np.float32) if sums is None else sums
            sums[:, *place] += weight * maps
            total[place] += weight
    assert sums is not None
    return np.asarray(sums / total, np.float32)


def starts(length: int, tile: int) -> Iterator[int]:
    """Where tiles begin that cover a length, evenly, and overlap by at least a quarter."""
    count = 1 + int(np.ceil((length - tile) / ((1 - OVERLAP) * tile)))
    yield from np.linspace(0, length - tile, count).round().astype(int).tolist()


def _ramp(length: int) -> NDArray[np.float64]:
    """Weights (length,) that rise to 1 over the overlap from both ends."""
    place = np.arange(length) + 0.5
    weights: NDArray[np.float64] = np.minimum(1.0, np.minimum(place, length - place) / (OVERLAP * length))
    return weights


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


def totals(scores: Sequence[Score], classes: Sequence[str]) -> dict[str, dict[str, float]]:
    """Each class's figures over some photographs."""
    return {name: total([score[name] for score in scores]) for name in classes}


def total(parts: Sequence[ClassScore]) -> dict[str, float]:
    """One class's figures over some photographs: the mean of their IoUs, that of all pixels together, members found, the same by
    contrast, and wrong regions; NaN of nothing."""
    known = [part.iou for part in parts if np.isfinite(part.iou)]
    members = [member for part in parts for member in part.members]
    by_contrast = {
        f"found %, contrast {label}": percent_found([m for m in members if low <= m.contrast < high])
        for label, low, high in CONTRASTS
    }
    both, either, wrong, regions = (
        sum(getattr(part, name) for part in parts) for name in ("both", "either", "wrong", "regions")
    )
    return {
        "IoU": float(np.mean(known)) if known else np.nan,
        "IoU of all pixels": both / either if either else np.nan,
        "found %": percent_found(members),
        "wrong %": 100 * wrong / regions if regions else np.nan,
        **by_contrast,
    }


def percent_found(members: Sequence[Seen]) -> float:
    """Of members; NaN of none."""
    return 100 * sum(member.found for member in members) / len(members) if members else np.nan


def indexed(index: Path, labels: Path, cache: Path, classes: Sequence[str]) -> Iterator[Photograph]:
    """The photographs that a list names, with the labels of the same names in a folder. Raises SavmapError."""
    entries = read_json(index)
    assert isinstance(entries, list)
    for entry in entries:
        yield labelled(labels / f"{entry['name']}.json", scaled(photo(entry, cache)), classes)


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


def thresholds(given: argparse.Namespace) -> Thresholds:
    """The one of the command line, or those of the plugin's settings."""
    if given.threshold is not None:
        return Thresholds.of(given.threshold)
    settings = load_class(given.plugin).Config()
    return Thresholds.of(
        settings.threshold, *(getattr(settings, f"{name}_threshold", None) for name in ("weak", "seed"))
    )


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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=list(SETS), default="dev", help="of `unseen` only totals are printed")
    parser.add_argument("--model", type=Path, action="append", help="instead of the plugin's network; may be repeated")
    parser.add_argument("--plugin", default="shelves", help="whose network and classes")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    parser.add_argument("--threshold", type=float, help="one for all pixels; by default the plugin's three")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--labels", type=Path, help="measure the photographs of this folder's labels instead")
    parser.add_argument("--pictures", type=Path, help="where they lie, by default beside the labels")
    parser.add_argument("--cache", type=Path, default=PHOTOS, help="where photographs are kept once they are fetched")


def run(given: argparse.Namespace) -> Figures:
    """Figures by network, way and class; the table of photographs, if they may be looked at, is printed as it is measured."""
    cv2.setNumThreads(given.threads)
    classes = tuple(load_class(given.plugin).classes)
    if given.labels is None:
        index, labels = SETS[given.set]
        photographs = list(indexed(DATA / index, DATA / labels, given.cache, classes))
    else:
        photographs = list(others(given.labels, given.pictures or given.labels, classes))
    each = given.labels is not None or given.set == "dev"
    figures: dict[str, dict[str, float]] = {}
    for model in given.model or [Path(load_class(given.plugin).model)]:
        segmenter = Segmenter(model, given.threads, providers=("cpu",))
        for way in given.ways:
            total = shown(segmenter, photographs, way, classes, thresholds(given), each)
            figures |= {f"{model.name}, {way}, {name}": part for name, part in total.items()}
    return figures


def shown(
    segmenter: Segmenter,
    photographs: Sequence[Photograph],
    way: str,
    classes: Sequence[str],
    thresholds: Thresholds,
    each: bool,
) -> dict[str, dict[str, float]]:
    """Print a line of figures for all photographs together and, with `each`, for each one as it is measured; the totals."""
    print(f"{segmenter.path.name}, {way}: IoU, found %, wrong % of {', '.join(classes)}")
    scores: list[Score] = []
    for name, part in measured(predictor(segmenter, classes), photographs, way, classes, thresholds):
        scores.append(part)
        if each:
            print(_line(name, totals([part], classes)), flush=True)
    together = totals(scores, classes)
    print(_line(f"all {len(scores)}", together), flush=True)
    return together


def _line(name: str, figures: Mapping[str, Mapping[str, float]]) -> str:
    cells = (f"{of['IoU']:.2f} {of['found %']:4.0f} {of['wrong %']:4.0f}" for of in figures.values())
    return f"{name[:30]:30s}  {'   '.join(cells)}"
