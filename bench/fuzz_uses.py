"""What `bench/fuzz_texts.py` does with one broken text: read it as the commands do, and use what comes of it as they do."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from fuzz_mutations import as_json, as_yaml

from savmap.demo import SITE
from savmap.errors import CONTROLS, SavmapError, SiteError, VideoError
from savmap.files.atomic import read_text
from savmap.jobs.api import import_survey
from savmap.jobs.cache_keys import measurement_key
from savmap.lab.sim.scene.files import load_scene, row_frame
from savmap.lab.train.data.sets import read_set
from savmap.maps.exports.plain import write_csv, write_ply
from savmap.maps.map_file import map_of, map_text, read_map
from savmap.maps.run_record import read_log
from savmap.maps.search import find_structures
from savmap.maps.survey import read_survey, write_survey
from savmap.plugin.scaffold.stub import stub_network
from savmap.report.evaluation import as_table
from savmap.report.page import page_text
from savmap.report.site_report import evaluation_of, plugins_of_map, report_for
from savmap.site.job import job_for, video_content
from savmap.site.layout import placements
from savmap.site.load import draft_of, problems_in, read_draft, sound_part
from savmap.site.locations import SourceMap
from savmap.site.overrides import overrides_of
from savmap.site.preflight import footage, settings_problems, tells_scale
from savmap.site.references import calibration_of, references_of
from savmap.types import FrameTable, Measured, Placement, ReferenceUse, RowMap, SiteMap, Structure, Trajectory, ViewSpec
from savmap.vision.networks.segmenter import Segmenter

CLASSES = ("upright", "beam")
PICTURE = "a.png"


class WrongError(Exception):
    """An outcome that is neither a refusal in one line nor sound."""


@dataclass(frozen=True)
class Kind:
    """A kind of text: a sound tree, how it is written, the name of its file, and what is done with the file."""

    seed: Any
    written: Callable[[Any], bytes]
    name: str
    use: Callable[[Path], object]
    bombs: bool = True


def require(holds: bool, what: str) -> None:
    if not holds:
        raise WrongError(what)


def require_quiet(text: str, what: str) -> None:
    """No character but the ends of lines acts on whoever shows the text."""
    acting = [found for found in CONTROLS.findall(text) if found != "\n"]
    require(not acting, f"{what} holds {acting[:3]}")


def refusal_of(error: SavmapError) -> str:
    """The line of a refusal. Raises WrongError where it is none."""
    line = str(error)
    require(len(line) < 6000, f"a line of {len(line)} letters: {line[:200]}")
    require(bool(line.strip()), "an empty line")
    return line


def use_site(path: Path) -> None:
    draft = read_draft(path)
    if problems_in(draft):
        sound_part(draft)
    job = job_for(path, None, path.parent / "out")
    placements(job.site)
    for problem in (*settings_problems(job.site, job.plugins, job.places), *footage(job)):
        if isinstance(problem, SavmapError):
            refusal_of(problem)
    for row in job.site.rows:
        tells_scale(job.site, row, job.plugins)
        references_of(job.site.row_references(row))
        calibration_of(job.site.row_calibration(row))
        try:
            measurement_key(job, row)
        except VideoError:
            continue
    job.site.model_dump_json(exclude_none=True)


def use_scene(path: Path) -> None:
    for place in load_scene(path).rows.values():
        row_frame(place)


def use_option(path: Path) -> None:
    key, _, value = read_text(path).partition("\n")
    overrides = overrides_of(
        [f"{key}={value}"], {f"SAVMAP__{key.replace('.', '__')}": value} if "." not in value else {}
    )
    draft = draft_of(video_content(Path("a.mp4"), 3.0, "left"), SourceMap("a.mp4"), Path(), overrides)
    for _, problem in problems_in(draft):
        raise SiteError(problem)


def use_map(path: Path) -> None:
    site = read_map(path)
    text = map_text(site)
    require(map_text(map_of(text, "again")) == text, "the map that is written and read again is another one")
    require_quiet(text, "map.json")
    write_csv(site, path.with_suffix(".csv"))
    require_quiet(path.with_suffix(".csv").read_text(encoding="utf-8"), "the CSV file")
    first = next((one.id for row in site.rows.values() for group in row.structures.values() for one in group), None)
    if first is not None:
        [str(hit) for hit in find_structures(site, first)]
    write_ply(site, path.with_suffix(".ply"))
    require_quiet(path.with_suffix(".ply").read_text(encoding="ascii"), "the PLY file")
    require_quiet(page_text(report_for(site, plugins_of_map(site))), "the page")


def use_survey(path: Path) -> None:
    survey, site = read_survey(path), map_of(map_text(made_map()), "made up")
    plugins = plugins_of_map(site)
    require_quiet(as_table(evaluation_of(site, survey, plugins)), "the table")
    require_quiet(page_text(report_for(site, plugins, survey)), "the page")


def use_import(path: Path) -> None:
    site = map_of(map_text(made_map()), "made up")
    result = import_survey(path, site)
    for line in result.lines():
        require(len(line) < 1000, f"a line of {len(line)} letters: {line[:200]}")
    write_survey(result.survey, path.with_suffix(".json"))
    survey = read_survey(path.with_suffix(".json"))
    require_quiet(as_table(evaluation_of(site, survey, plugins_of_map(site))), "the table")


def use_run(path: Path) -> None:
    site = made_map()
    require_quiet(page_text(report_for(site, plugins_of_map(site), None, read_log(path))), "the page")


def use_network(path: Path) -> None:
    network = Segmenter(path, 1)
    if network.input_size is None or network.input_size[0] * network.input_size[1] <= 1 << 20:
        network.probabilities(np.zeros((48, 64, 3), np.uint8))


def use_labels(path: Path) -> None:
    picture = path.parent / "images" / PICTURE
    picture.parent.mkdir(exist_ok=True)
    for place in (picture, path.parent / PICTURE):
        cv2.imwrite(str(place), np.zeros((32, 64, 3), np.uint8))
    for place in (path.parent / "masks" / PICTURE, path.parent / "labels" / "a.txt"):
        place.parent.mkdir()
    cv2.imwrite(str(path.parent / "masks" / PICTURE), np.zeros((32, 64), np.uint8))
    if path.suffix == ".json" and path.name != "dataset.json":
        shutil.rmtree(path.parent / "masks")
    (path.parent / "labels" / "a.txt").write_text("0 0.1 0.1 0.5 0.1 0.5 0.5\n")
    for sample in read_set(path.parent if path.suffix == ".json" and "LabelMe" in path.name else path, CLASSES).samples:
        sample.load()


def use_polygons(path: Path) -> None:
    (path.parent / "data.yaml").write_text("names: [upright, beam]\ntrain: images\n")
    (path.parent / "images").mkdir(exist_ok=True)
    (path.parent / "labels").mkdir(exist_ok=True)
    cv2.imwrite(str(path.parent / "images" / PICTURE), np.zeros((32, 64, 3), np.uint8))
    path.replace(path.parent / "labels" / "a.txt")
    for sample in read_set(path.parent / "data.yaml", CLASSES).samples:
        sample.load()


def made_map() -> SiteMap:
    """A row of two uprights and a beam, and one of a lamp and a sign."""
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 2, 0], [0, 2, 0]])
    spread, ring = np.tile(1e-4 * np.eye(3), (4, 1, 1)), np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    names = ("lower left", "lower right", "upper right", "upper left")

    def thing(name: str, label: str, shift: tuple[float, float, float], **more: Any) -> Structure:
        labels = tuple(f"{name} / {corner}" for corner in names)
        return Structure(name, label, corners + shift, spread, labels, ring, more)

    post = [thing(f"upright {n}", "upright", (2.7 * n, 0, 0)) for n in range(2)]
    beam = thing("bay 1 / beam 1", "beam", (0.1, 0.3, 0), bay=1, beam=1, height_m=Measured(0.3, 0.01))
    sign = thing("sign 1", "sign", (1, 1, 0), text="A21-03", kind="plate")
    path = Trajectory(np.arange(3), np.tile(np.eye(4), (3, 1, 1)), np.full((3, 3), 0.01))
    table, views = FrameTable(np.arange(4) / 15, ("pass 1",) * 4), {"face": ViewSpec("face", 90.0)}
    known = (ReferenceUse("camera height", 3.05, 0.02, 3.06),)
    figures: dict[str, float | int | str] = {"frames": 4, "rms_px": 0.4, "note 1": "a remark"}
    one = RowMap("A", table, views, path, {"shelves": (*post, beam)}, known, figures)
    two = RowMap("B", table, views, path, {"signs": (sign,), "lights": ()}, (), {})
    placed = {"A": Placement(0.0, 0.0, 0.0, np.diag([1e-4, 1e-4, 0.01])), "B": Placement(5.0, 3.0, 180.0, np.eye(3))}
    return SiteMap({"A": one, "B": two}, {"savmap": "0"}, {"C": "no such file"}, placed)


def _network(tree: Any) -> bytes:
    """A small network with metadata, sides and a format of any kind."""
    import onnx

    model = onnx.load_from_string(stub_network("upright", "1"))
    del model.metadata_props[:]
    for key, value in (
        tree.get("metadata", {}).items() if isinstance(tree, dict) and isinstance(tree.get("metadata"), dict) else ()
    ):
        text = value if isinstance(value, str) else json.dumps(value)
        model.metadata_props.add(key=_utf8(str(key)), value=_utf8(text))
    sides = tree.get("sides") if isinstance(tree, dict) else None
    for dim, side in zip(
        model.graph.input[0].type.tensor_type.shape.dim, sides if isinstance(sides, list) else (), strict=False
    ):
        if type(side) is int and 0 <= side < 1 << 62:
            dim.dim_value = side
        else:
            dim.dim_param = "any"
    return bytes(model.SerializeToString())


def _utf8(text: str) -> str:
    return text.encode("utf-8", "replace").decode()


def _option(tree: Any) -> bytes:
    pair = tree if isinstance(tree, list) and len(tree) == 2 else ["fps", tree]
    return "\n".join(one if isinstance(one, str) else json.dumps(one) for one in pair).encode("utf-8", "replace")


def _lines(tree: Any) -> bytes:
    rows = tree if isinstance(tree, list) else [tree]
    return "\n".join(" ".join(map(str, row)) if isinstance(row, list) else str(row) for row in rows).encode(
        "utf-8", "replace"
    )


def _table(tree: Any) -> bytes:
    rows = tree if isinstance(tree, list) else [tree]
    return "\n".join(";".join(map(str, row)) if isinstance(row, list) else str(row) for row in rows).encode(
        "utf-8", "replace"
    )


def _drawing(tree: Any) -> bytes:
    """Entities as pairs of group codes and values."""
    entities = tree if isinstance(tree, list) else [tree]
    pairs = [pair for entity in entities for pair in (entity if isinstance(entity, list) else [entity])]
    lines = [str(part) for pair in pairs for part in (pair if isinstance(pair, list) else [pair])]
    return ("\n".join(lines) + "\n").encode("utf-8", "replace")


def made_drawing() -> list[list[list[Any]]]:
    """Two uprights of the made-up map as lines, one as a block within a block, and a beam, in the world: pairs of group codes and values."""

    def line(*ends: float) -> list[list[Any]]:
        return [
            [0, "LINE"],
            [8, "UPRIGHT"],
            *([code, value] for code, value in zip((10, 20, 30, 11, 21, 31), ends, strict=True)),
        ]

    def insert(name: str, layer: str, x: float) -> list[list[Any]]:
        return [
            [0, "INSERT"],
            [8, layer],
            [2, name],
            [10, x],
            [20, 0.0],
            [30, 0.0],
            [41, 1.0],
            [50, 0.0],
            [70, 1],
            [71, 1],
        ]

    def block(name: str, *entities: list[list[Any]]) -> list[list[list[Any]]]:
        begin: list[list[Any]] = [[0, "BLOCK"], [8, "0"], [2, name], [70, 0], [10, 0.0], [20, 0.0], [30, 0.0]]
        return [begin, *entities, [[0, "ENDBLK"]]]

    ring = [[0.1, 0.0, 0.3], [2.7, 0.0, 0.3], [2.7, 0.0, 0.6], [0.1, 0.0, 0.6]]
    corners: list[list[Any]] = [[0, "POLYLINE"], [8, "Beam"], [66, 1], [70, 9]]
    vertices: list[list[list[Any]]] = [
        [[0, "VERTEX"], [8, "Beam"], [10, x], [20, y], [30, z], [70, 32]] for x, y, z in ring
    ]
    end: list[list[Any]] = [[0, "SEQEND"]]
    return [
        [[0, "SECTION"], [2, "HEADER"], [9, "$ACADVER"], [1, "AC1009"], [9, "$INSUNITS"], [70, 6], [0, "ENDSEC"]],
        [[0, "SECTION"], [2, "BLOCKS"]],
        *block("edges", line(0.0, 0.0, 0.0, 0.0, 0.0, 2.0), line(0.1, 0.0, 0.0, 0.1, 0.0, 2.0)),
        *block("post", insert("edges", "0", 0.0)),
        [[0, "ENDSEC"], [0, "SECTION"], [2, "ENTITIES"]],
        insert("post", "UPRIGHT", 0.0),
        line(2.7, 0.0, 0.0, 2.8, 0.0, 0.0),
        line(2.8, 0.0, 0.0, 2.8, 0.0, 2.0),
        corners,
        *vertices,
        end,
        [[0, "POINT"], [8, "light"], [10, 1.0], [20, -1.2], [30, 8.0]],
        [[0, "ENDSEC"], [0, "EOF"]],
    ]


def made_table() -> list[list[Any]]:
    """The corners of two uprights and a beam, of a lamp and of a sign, in several frames."""
    lines: list[list[Any]] = [["Row", "Frame", "Id", "Label", "Vertex", "x [m]", "y [m]", "z [m]", "Text"]]
    for number in range(2):
        lines += [["A", "row", f"upright {number}", "upright", "", 2.7 * number + x, 0.0, 0.0, ""] for x in (0.0, 0.1)]
    lines += [
        ["A", "site", "beam", "BEAM", f"beam / {side} left", "1,0", y, 0.0, ""]
        for side, y in (("lower", "0,3"), ("upper", "0,6"))
    ]
    lines += [["", "world", "lamp", "light", "", x, -1.2, 8.0, ""] for x in (0.5, 1.7)]
    corners = ((1, 1), (1.3, 1), (1.3, 0.8), (1, 0.8))
    lines += [["A", "row", "sign", "sign", "", x, y, 0.01, "A21-03"] for x, y in corners]
    return [[str(cell).replace(".", ",") if isinstance(cell, float) else cell for cell in line] for line in lines]


def kinds() -> Mapping[str, Kind]:
    """All kinds by name."""
    site = yaml.safe_load(SITE.read_text(encoding="utf-8")) | {
        "video": str(SITE.parent / "aisle-dev.mp4"),
        "views": {"face": {"yaw_deg": 90, "hfov_deg": 110}},
        "layout": {"aisle_m": 3.0, "rack_m": 2.5, "length_m": 14.2, "rows": ["A", None]},
        "calibration": {"panorama": {"turn_sigma_deg": 1.0}, "rolling_shutter": True},
        "providers": ["cpu"],
        "plugin_timeout_s": 60,
    }
    site["plugins"] |= {"signs": {"pattern": "[A-Z]+", "sizes_m": [[0.2, 0.1]]}}
    site["references"] |= {
        "points": [{"vertex": "upright 1 / left", "axis": "x", "value": 0.0, "sigma": 0.01}],
        "markers": [{"dictionary": "tag36h11", "id": 1, "size_m": 0.2}],
    }
    scene = yaml.safe_load(
        (Path(__file__).parents[1] / "examples" / "scenes" / "short-row.yaml").read_text(encoding="utf-8")
    )
    survey = json.loads((SITE.parent / "survey.json").read_text(encoding="utf-8"))
    survey["rows"]["B"] = {"signs": [{"corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "text": "A"}]}
    run = {
        "format": "savmap-run",
        "version": 1,
        "rows": {"A": {"status": "mapped", "seconds": {"solved": 1.5}, "used": 4}},
        "wall_s": 2.0,
    }
    network = {
        "metadata": {
            "savmap.format": "semantic",
            "savmap.classes": ["upright"],
            "names": "{0: 'a'}",
            "task": "segment",
            "savmap.output": "logits",
            "savmap.mean": [0, 0, 0],
        },
        "sides": [1, 3, 480, 640],
    }
    image = {"id": 1, "file_name": PICTURE, "width": 64, "height": 32}
    ring, counts = [1, 1, 20, 1, 20, 20], {"size": [32, 64], "counts": [10, 20, 2018]}
    coco = {
        "images": [image],
        "annotations": [
            {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [ring], "iscrowd": 0, "bbox": [1, 1, 20, 20]},
            {"id": 2, "image_id": 1, "category_id": 2, "segmentation": counts, "iscrowd": 1},
            {
                "id": 3,
                "image_id": 1,
                "category_id": 2,
                "segmentation": {"size": [32, 64], "counts": "PP2"},
                "iscrowd": 1,
            },
        ],
        "categories": [{"id": 1, "name": "upright"}, {"id": 2, "name": "beam"}],
    }
    shape = {"label": "upright", "points": [[1, 1], [20, 1], [20, 20]], "shape_type": "polygon"}
    drawn = {
        "imagePath": PICTURE,
        "shapes": [shape, {**shape, "label": "beam", "points": [[3, 3], [9, 9]], "shape_type": "rectangle"}],
        "imageWidth": 64,
        "imageHeight": 32,
    }
    yolo = {"path": ".", "train": "images", "val": "images", "names": {0: "upright", 1: "beam"}}
    header = {"format": "savmap-dataset", "version": 1, "classes": ["upright", "beam"], "renderer": "x"}
    return {
        "site file": Kind(site, as_yaml, "site.yaml", use_site),
        "scene": Kind(scene, as_yaml, "scene.yaml", use_scene),
        "option": Kind(["rows.1.fps", "5"], _option, "option.txt", use_option, False),
        "map": Kind(json.loads(map_text(made_map())), as_json, "map.json", use_map),
        "survey": Kind(survey, as_json, "survey.json", use_survey),
        "table": Kind(made_table(), _table, "points.csv", use_import, False),
        "drawing": Kind(made_drawing(), _drawing, "plan.dxf", use_import, False),
        "run": Kind(run, as_json, "run.json", use_run),
        "network": Kind(network, _network, "model.onnx", use_network, False),
        "labels: COCO": Kind(coco, as_json, "coco.json", use_labels),
        "labels: LabelMe": Kind(drawn, as_json, "a.LabelMe.json", use_labels),
        "labels: YOLO": Kind(yolo, as_yaml, "data.yaml", use_labels),
        "labels: polygons": Kind(
            [[0, 0.1, 0.1, 0.5, 0.1, 0.5, 0.5], [1, 0.2, 0.2, 0.6, 0.2, 0.6, 0.6]], _lines, "a.txt", use_polygons, False
        ),
        "labels: savmap": Kind(header, as_json, "dataset.json", use_labels),
    }
