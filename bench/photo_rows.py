"""Rows whose face is a real photograph, from simulated footage to scored map: missing, spurious, error, warnings.

    python -m bench photo-rows [--model FILE] [--faces NAME ...] [--only colour grey dim] [--photos DIR] [--keep DIR]

A face is the front of a rectified photograph (real paint, real goods), laid on the plane of a row and repeated along it; the drive, the hall and
its lamps are simulated. Each face stands in colour, in grey and at a third of the light. Goods lie in the plane: parallax is missing.
Photographs are fetched by address and digest into `--photos`, they are not redistributed. Footage already in DIR is used again.

`photo_data/faces.json` holds, for each face, where its photograph is found, and what was read off it:

- `corners`: where the corners of the rectified picture lie in the photograph (top left, top right, bottom right, bottom
  left), px from the outer corner of its first pixel; `radial`: its lens's distortion; `size_px` of the rectified picture.
- `pixels_a_metre` of the rectified picture; its lower border is the floor.
- `posts`: left and right edge of each post, px. `bays`: `span`, the columns between two posts that belong to the bay (a
  post's visible flank is left out), and its `beams` from the bottom up: bottom and top edge of the front, px from the top;
  a third number is where the beam's visible underside ends: it is squeezed out of the picture.
- `row`: post, bay, post, ... post: by which a row is put together.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import av
import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BeforeValidator, TypeAdapter

import savmap
from bench.baseline import Figures
from bench.photo_files import PHOTOS, photo
from savmap.errors import SavmapError
from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.lab.scenes import Exposure, Material, RowSize, SceneParts, span
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.render.panorama import in_order, linear_bands
from savmap.lab.sim.render.shade import Renderer, compressed, developed, metered, renderer
from savmap.lab.sim.render.surfaces import Singles
from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import poses, references, site_of
from savmap.report.evaluation import as_json
from savmap.types import Bools, Floats, SiteMap

FACES = Path(__file__).parent / "photo_data" / "faces.json"
Picture = NDArray[np.uint8]
_ROUNDS = 20
_FINE = 20


def _four(numbers: Sequence[float]) -> Sequence[float]:
    """Bottom, top, below and above of a beam, the last two where they are given."""
    return [*numbers, *(numbers[0], numbers[1])[len(numbers) - 2 :]]


@dataclass(frozen=True)
class BayPicture:
    """One bay of a rectified picture, px: `span` of columns; `beams` (bottom, top, below, above) from the bottom up, where what
    is between `above` and `top` and between `bottom` and `below` is left out; rows `without`, which are left out as well; on which
    side its mirror image follows."""

    span: tuple[float, float]
    beams: tuple[Annotated[tuple[float, float, float, float], BeforeValidator(_four)], ...]
    without: tuple[tuple[float, float], ...] = ()
    mirrored: str = ""


@dataclass(frozen=True)
class Face:
    """One face of `faces.json`."""

    name: str
    entry: Mapping[str, Any]
    corners: tuple[tuple[float, float], ...]
    radial: float
    size_px: tuple[int, int]
    pixels_a_metre: float
    posts: tuple[tuple[float, float], ...]
    bays: tuple[BayPicture, ...]
    row: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class PhotoRow:
    """The picture (h, w, 3) RGB of a whole row, its `size` (length, height) in m, and the truth: x of the posts' edges and,
    for each bay, y of the beams' edges, m."""

    picture: Picture
    size: tuple[float, float]
    posts: tuple[tuple[float, float], ...]
    beams: tuple[tuple[tuple[float, float], ...], ...]


def read_faces(path: Path = FACES) -> dict[str, Face]:
    """The faces by name."""
    entries = json.loads(path.read_text(encoding="utf-8"))["faces"]
    return {entry["name"]: TypeAdapter(Face).validate_python({**entry, "entry": entry}) for entry in entries}


def photo_row(face: Face, photo: Picture) -> PhotoRow:
    """A row of a face from its photograph (h, w, 3) RGB."""
    parts: dict[tuple[bool, int], Picture] = {}
    cells = [(place % 2 == 1, number) for place, number in enumerate(face.row)]
    for is_bay, number in cells:
        if (is_bay, number) not in parts:
            parts[is_bay, number] = _bay(face, number, photo) if is_bay else _post(face, number, photo)
    strips = [parts[cell] for cell in cells]
    ends = np.cumsum([0, *(strip.shape[1] for strip in strips)]) / face.pixels_a_metre
    posts = tuple((float(ends[at]), float(ends[at + 1])) for at in range(0, len(cells), 2))
    beams = tuple(beams_m(face, number) for is_bay, number in cells if is_bay)
    picture = np.hstack(strips)
    return PhotoRow(picture, (float(ends[-1]), face.size_px[1] / face.pixels_a_metre), posts, beams)


def beams_m(face: Face, bay: int) -> tuple[tuple[float, float], ...]:
    """y of bottom and top edges of a bay's beams, m above the floor."""
    height = face.size_px[1]
    return tuple(
        ((height - beam[0]) / face.pixels_a_metre, (height - beam[1]) / face.pixels_a_metre)
        for beam in face.bays[bay].beams
    )


def _post(face: Face, number: int, photo: Picture) -> Picture:
    rows: Floats = np.arange(face.size_px[1]) + np.float64(0.5)
    return _seen(face, photo, _columns(face.posts[number]), rows)


def _bay(face: Face, number: int, photo: Picture) -> Picture:
    bay = face.bays[number]
    seen = _seen(face, photo, _columns(bay.span), squeezed(bay, face.size_px[1]))
    if not bay.mirrored:
        return seen
    return np.hstack([seen, seen[:, ::-1]] if bay.mirrored == "right" else [seen[:, ::-1], seen])


def _columns(span: tuple[float, float]) -> Floats:
    """Middles of the columns (n,) of a strip, px of the rectified picture: a whole number of them fills the span."""
    count = round(span[1] - span[0])
    columns: Floats = span[0] + (np.arange(count) + 0.5) * (span[1] - span[0]) / count
    return columns


def squeezed(bay: BayPicture, height: int) -> Floats:
    """Rows (height,) of the rectified picture that a bay's rows show: what lies between two fronts is stretched over what is
    left out between them."""
    kept, ends = np.ones(height * _FINE), [0, height * _FINE]
    for bottom, top, below, above in bay.beams:
        ends += [round(top * _FINE), round(bottom * _FINE)]
        kept[round(above * _FINE) : ends[-2]] = kept[ends[-1] : round(below * _FINE)] = 0
    for first, last in bay.without:
        kept[round(first * _FINE) : round(last * _FINE)] = 0
    ends.sort()
    shown = np.zeros(height * _FINE + 1)
    for first, last in pairwise(ends):
        part = np.cumsum(kept[first:last])
        shown[first + 1 : last + 1] = first + part * ((last - first) / max(part[-1], 1) if len(part) else 1)
    places = np.arange(height * _FINE + 1) / _FINE
    rows: Floats = np.interp(np.arange(height) + 0.5, shown / _FINE, places)
    return rows


def _seen(face: Face, photo: Picture, columns: Floats, rows: Floats) -> Picture:
    """The picture (m, n, 3) at columns (n,) and rows (m,) of the rectified picture."""
    width, height = face.size_px
    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    size = np.array(photo.shape[1::-1])
    straight = undistorted(np.array(face.corners), size, face.radial)
    from_rectified = cv2.getPerspectiveTransform(target, straight.astype(np.float32))
    u, v = np.meshgrid(columns, rows)
    places = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ from_rectified.T
    bent = distorted(places[:, :2] / places[:, 2:], size, face.radial) - 0.5
    at = bent.astype(np.float32).reshape(*u.shape, 2)
    seen = cv2.remap(photo, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.uint8)


def undistorted(points: Floats, size: NDArray[np.int64], radial: float) -> Floats:
    """Points (n, 2) of a photograph of `size` (width, height), px, as a lens without distortion would show them."""
    middle, half = size / 2, size[0] / 2
    offset = (points - middle) / half
    straight: Floats = middle + half * offset * (1 + radial * (offset**2).sum(axis=1, keepdims=True))
    return straight


def distorted(points: Floats, size: NDArray[np.int64], radial: float) -> Floats:
    """The inverse of `undistorted`."""
    middle, half = size / 2, size[0] / 2
    straight = (points - middle) / half
    offset = straight
    for _ in range(_ROUNDS):
        offset = straight / (1 + radial * (offset**2).sum(axis=1, keepdims=True))
    bent: Floats = middle + half * offset
    return bent


LIGHTS = ("colour", "grey", "dim")
ROW = "A"
_AISLE_M = 1.7
_DIM = 1 / 3
_METERING_HEIGHT = 64
_COARSE = 2
_CENTRE = ((0.0, 0.0),)
_CORNERS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
_ENCODING = {"crf": "18", "preset": "fast"}


@dataclass(frozen=True)
class Size:
    """How much footage: frames, and their width in px."""

    frames: int
    width: int


def make_footage(row: PhotoRow, name: str, folders: Mapping[str, Path], size: Size) -> None:
    """Write footage.mp4, site.yaml, survey.json and poses.json of a row into the folder of each light."""
    built = build(scene_of(row, name, size), {"shelves": lambda *_: parts_of(row)})
    path = drive(built.scene.cart, built.scene.seed)
    with ExitStack() as stack:
        videos = {light: stack.enter_context(_Video(folders[light], size)) for light in LIGHTS}
        task = _Task(renderer(built), path, built.scene.look, row.size)
        task = replace(task, look=metered(task.look, task.linear(len(path.origins) // 2, _METERING_HEIGHT)))
        for shown in in_order(task.frame, len(path.origins), 2):
            for light, picture in shown.items():
                videos[light].write(picture)
    for folder in folders.values():
        _write_files(built, path, folder)


def parts_of(row: PhotoRow) -> SceneParts:
    """The scene's part that a photo row is: one box with the picture on its front."""
    length, height = row.size
    linear = ((row.picture.reshape(-1, 3).mean(axis=0) / 255) ** 2.2).tolist()
    front = span((0.0, length), (0.0, height), (-0.05, 0.0), Material((linear[0], linear[1], linear[2])))
    box = replace(front, face_labels={"+z": "photo"}, prints={"+z": row.picture})
    lowest = {"values": [round(beams[0][0], 4) for beams in row.beams], "sigma": 0.002}
    whole = {"value": round(length, 4), "sigma": 0.003}
    between = ["upright 1 / left", f"upright {len(row.posts)} / right"]
    return SceneParts(
        [box],
        {ROW: {"uprights": row.posts, "sections": [{"beams": beams} for beams in row.beams]}},
        sizes={ROW: RowSize(length, height)},
        references={ROW: {"lowest_beam_bottom_height_m": lowest, "first_to_last_upright_outer_edges_m": whole}},
        site_rows={
            ROW: {
                "references": {"lengths": [{"between": between, **whole}]},
                "plugins": {"shelves": {"lowest_beam_bottom_height_m": lowest}},
            }
        },
    )


def scene_of(row: PhotoRow, name: str, size: Size) -> Scene:
    """Hall, lamps and drive around a photo row, by its name."""
    length, height = row.size
    rng = np.random.default_rng([*name.encode(), 7])
    mast = float(np.clip(height * rng.uniform(0.45, 0.6), 1.4, 3.0))
    aisle = max(_AISLE_M, 0.64 * max(mast, height - mast))
    yaw, pitch, roll = rng.uniform([-180, -5, -5], [180, 5, 5]).tolist()
    cart = {"start": [-0.8, aisle], "end": [length + 0.8, aisle], "height": mast, "yaw": yaw, "pitch": pitch}
    cart |= {"roll": roll, "frames": size.frames, "width": size.width, "fps": 6.0}
    top = max(height + 1.5, 6.0)
    content = {
        "seed": int(rng.integers(1 << 30)),
        "hall": {"x": [-7.0, length + 8.0], "z": [-4.0, 2 * aisle + 2.5], "height": top, "pipes": 1},
        "goods": {"density": 0.0},
        "look": {"ambient": 0.3},
        "cart": cart,
        "rows": {ROW: {}},
        "structures": {"shelves": {}, "lights": {"lines": [{"z": aisle, "height": top - 0.5, "pitch": 3.2}]}},
    }
    return parse_scene(content, name)


@dataclass(frozen=True, eq=False)
class _Task:
    scene: Renderer
    path: Drive
    look: Exposure
    size: tuple[float, float]

    def frame(self, index: int) -> dict[str, Picture]:
        """A frame in each light."""
        settings = self.scene.built.scene
        linear = self.linear(index, settings.cart.width // 2)
        rng = np.random.default_rng([settings.seed, 9, index])
        colour = developed(linear, self.look, None, rng)
        grey = np.repeat(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
        darker = self.look.model_copy(update={"exposure": self.look.exposure * _DIM})
        return {"colour": colour, "grey": grey.astype(np.uint8), "dim": developed(linear, darker, None, rng)}

    def linear(self, index: int, height: int) -> Singles:
        """A frame's radiance (height, 2 height, 3): the hall coarsely, the face and what is near it pixel by pixel, its border
        by four rays a pixel."""
        origin, turn = self.path.origins[index], self.path.world_from_rig[index]
        coarse = np.concatenate(list(linear_bands(self.scene, origin, turn, height // _COARSE)))
        linear = cv2.resize(coarse, (2 * height, height), interpolation=cv2.INTER_LINEAR)
        u, v = np.meshgrid(np.arange(2.0 * height), np.arange(float(height)))
        pixels = np.stack([u, v], axis=-1)
        face = self._on_face(origin, rays_from_panorama_pixels(pixels.reshape(-1, 2), height) @ turn.T)
        near, border = _around(face.reshape(height, 2 * height))
        for chosen, steps in ((near, _CENTRE), (border, _CORNERS)):
            parts = [self._seen(origin, turn, pixels[chosen] + step, height) for step in steps]
            linear[chosen] = np.mean(parts, axis=0)
        return np.asarray(linear, np.float32)

    def _on_face(self, origin: Floats, rays: Floats) -> Bools:
        """Which rays (n, 3) meet the face."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -origin[2] / rays[:, 2]
            x, y = (origin[axis] + distance * rays[:, axis] for axis in (0, 1))
            hit: Bools = (distance > 0) & (x > 0) & (x < self.size[0]) & (y > 0) & (y < self.size[1])
        return hit

    def _seen(self, origin: Floats, turn: Floats, pixels: Floats, height: int) -> Singles:
        rays = rays_from_panorama_pixels(pixels, height) @ turn.T
        return compressed(self.scene.radiance(origin, rays, np.pi / height)[0])


def _around(face: Bools) -> tuple[Bools, Bools]:
    """The pixels (h, w) of a face in a panorama or near it, and those of its border."""
    wide = 3 * _COARSE
    mask = np.pad(face.astype(np.uint8), ((0, 0), (wide, wide)), mode="wrap")
    near, outer = (cv2.dilate(mask, np.ones((size, size), np.uint8)) for size in (2 * wide + 1, 3))
    inner = cv2.erode(mask, np.ones((3, 3), np.uint8))
    return near[:, wide:-wide] > 0, (outer - inner)[:, wide:-wide] > 0


class _Video:
    """footage.mp4 in a folder, frame by frame; a film that breaks off is left with another name."""

    def __init__(self, folder: Path, size: Size) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "footage.mp4"
        self._container = av.open(str(folder / "partial.mp4"), "w")
        self._stream = self._container.add_stream("libx264", rate=Fraction(6), options=_ENCODING)
        self._stream.width, self._stream.height, self._stream.pix_fmt = size.width, size.width // 2, "yuv420p"

    def __enter__(self) -> "_Video":
        return self

    def write(self, picture: Picture) -> None:
        """Append a frame."""
        self._container.mux(self._stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))

    def __exit__(self, kind: object, *_: object) -> None:
        self._container.mux(self._stream.encode())
        self._container.close()
        if kind is None:
            self._path.with_name("partial.mp4").replace(self._path)


def _write_files(built: Built, path: Drive, folder: Path) -> None:
    known = references(built, path)
    site: dict[str, Any] = {**site_of(built, known), "plugins": {"shelves": {}}}
    for name, content in (("survey", built.survey), ("references", known), ("poses", poses(built, path))):
        (folder / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    plain = json.loads(json.dumps(site))
    (folder / "site.yaml").write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")


KINDS = ("upright", "beam")
_GOOD_M = 0.015


@dataclass(frozen=True)
class Case:
    """A face in one light."""

    face: Face
    light: str

    @property
    def name(self) -> str:
        """Such as "gmu-grey"."""
        return f"{self.face.name}-{self.light}"


def footage(case: Case, base: Path, photos: Path, size: Size) -> Path:
    """The site file of a case's footage; that of all lights of its face is made unless it is there."""
    site = base / case.name / "site.yaml"
    if not site.is_file():
        row = photo_row(case.face, photo(case.face.entry, photos))
        folders = {light: base / Case(case.face, light).name for light in LIGHTS}
        make_footage(row, case.face.name, folders, size)
    return site


def score(site: Path, output: Path, model: Path | None = None) -> dict[str, Any]:
    """Map a site and score it, with what the map warns of; an error is named, and is a warning too."""
    start = time.perf_counter()
    try:
        overrides = [f"plugins.shelves.model={model.resolve()}"] if model else []
        site_map = savmap.map_site(site, output=output, overrides=overrides)
        figures = as_json(savmap.evaluate(site_map, site.with_name("survey.json")))
        figures = {key: figures[key] for key in ("mae_m", "missing", "spurious", "classes", "edges")}
        figures["warnings"] = warnings_of(site_map)
    except SavmapError as error:
        figures = {"error": str(error), "warnings": [str(error)]}
    return {**figures, "seconds": time.perf_counter() - start}


def warnings_of(site_map: SiteMap) -> list[str]:
    """What a map itself warns of, and why rows failed."""
    notes = [str(note) for row in site_map.rows.values() for key, note in row.report.items() if key.startswith("note ")]
    return [*notes, *site_map.failed.values()]


def is_good(figures: Mapping[str, Any]) -> bool:
    """Whether a map misses nothing, invents nothing, and is off by at most 1.5 cm."""
    if "error" in figures or any(figures["missing"].values()) or any(figures["spurious"].values()):
        return False
    return bool(figures["mae_m"] <= _GOOD_M)


def line(name: str, figures: Mapping[str, Any]) -> str:
    """One row of the table."""
    if "error" in figures:
        return f"{name:24} {figures['error'][:100]}"
    counts = "".join(f"{figures[what].get(kind, 0):10d}" for what in ("missing", "spurious") for kind in KINDS)
    error = f"{100 * figures['mae_m']:8.2f}" if figures["mae_m"] is not None else f"{'-':>8}"
    return f"{name:24}{counts} {error} {len(figures['warnings']):8d} {figures['seconds']:8.0f}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--faces", nargs="+", choices=read_faces(), default=list(read_faces()))
    parser.add_argument("--only", nargs="+", choices=LIGHTS, default=LIGHTS)
    parser.add_argument("--photos", type=Path, default=PHOTOS, help="the photographs' folder")
    parser.add_argument("--model", type=Path, help="another network than the plugin's")
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--width", type=int, default=2048)


def run(given: argparse.Namespace) -> Figures:
    """Each case, and the totals."""
    results: dict[str, dict[str, Any]] = {}
    faces = read_faces()
    for case in (Case(faces[name], light) for name in given.faces for light in given.only):
        base = given.keep
        site = footage(case, base, given.photos, Size(given.frames, given.width))
        results[case.name] = score(site, base / case.name / "out", given.model)
        print(line(case.name, results[case.name]), flush=True)
    return totals(results)


def totals(results: Mapping[str, Mapping[str, Any]]) -> Figures:
    """The cases' errors, cm, and how many are good, and wrong without a word."""
    mapped = {name: figures for name, figures in results.items() if "error" not in figures}
    errors = {
        name: {"mean cm": 100 * figures["mae_m"]} for name, figures in mapped.items() if figures["mae_m"] is not None
    }
    bad = [figures for figures in results.values() if not is_good(figures)]
    total: dict[str, float] = {
        "cases": len(results),
        "good": len(results) - len(bad),
        "wrong without a warning": sum(not figures["warnings"] for figures in bad),
        **{what: sum(sum(figures[what].values()) for figures in mapped.values()) for what in ("missing", "spurious")},
    }
    return {**errors, "total": total}
