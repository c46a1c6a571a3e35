"""The same rows mapped with the shipped network and with networks in other layouts of the same classes.

    python bench/networks.py examples/aisle-dev/site.yaml [more.yaml] [--yolo export.onnx] [--data data/others] [--pictures 40]

"YOLO-seg, the same maps" is the shipped network itself inside a graph of YOLO-seg's layout: picture 0..1, its two maps as prototypes at a
quarter of the size, a box each: what differs from the shipped network's map is what the layout and its adapter lose. `--yolo` is an export of
your own (bench/yolo_export.py makes one). IoU is over all pictures of a labelled data set together.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

import savmap
from savmap.errors import SavmapError
from savmap.lab.train.data.dataset import IGNORE, read_dataset
from savmap.plugin.manager import load_class
from savmap.report.evaluation import mean_absolute_error
from savmap.site.load import load_site
from savmap.types import SiteMap, Structure, pool
from savmap.vision.networks.segmenter import Segmenter

PLUGIN = "shelves"
SURE = 0.99
LEAST = 1e-6


def as_yolo(model: Path, output: Path, cell: int = 4) -> Path:
    """A semantic network of savmap's in the layout of a YOLO-seg export with prototypes `cell` times coarser than its input."""
    given = Segmenter(model)
    assert given.input_size is not None
    width, height = given.input_size
    count = len(given.names)
    graph = onnx.load(model)
    source, maps = graph.graph.input[0].name, graph.graph.output[0].name
    box = [width / 2, height / 2, width, height]
    rows = np.array([[*box, *(SURE * unit), *unit] for unit in np.eye(count)], np.float32)
    constants = {"n.full": 255.0, "n.least": LEAST, "n.most": 1 - LEAST, "n.one": 1.0, "output0": rows.T[None]}
    first = [
        *(_constant(name, np.array(value, np.float32)) for name, value in constants.items()),
        *(_constant(name, np.array([value])) for name, value in (("n.from", 1), ("n.to", 1 + count), ("n.axis", 1))),
        helper.make_node("Mul", ["images", "n.full"], [source]),
    ]
    last = [
        helper.make_node("Slice", [maps, "n.from", "n.to", "n.axis"], ["n.maps"]),
        helper.make_node("Clip", ["n.maps", "n.least", "n.most"], ["n.inside"]),
        helper.make_node("Sub", ["n.one", "n.inside"], ["n.rest"]),
        helper.make_node("Div", ["n.inside", "n.rest"], ["n.odds"]),
        helper.make_node("Log", ["n.odds"], ["n.logits"]),
        helper.make_node("AveragePool", ["n.logits"], ["output1"], kernel_shape=[cell, cell], strides=[cell, cell]),
    ]
    nodes = [*first, *graph.graph.node, *last]
    del graph.graph.node[:], graph.graph.input[:], graph.graph.output[:]
    graph.graph.node.extend(nodes)
    graph.graph.input.append(_value("images", (1, 3, height, width)))
    graph.graph.output.append(_value("output0", (1, *rows.T.shape)))
    graph.graph.output.append(_value("output1", (1, count, height // cell, width // cell)))
    names = str(dict(enumerate(given.names)))
    helper.set_model_props(graph, {"task": "segment", "names": names, "stride": "32", "imgsz": str([height, width])})
    output.write_bytes(graph.SerializeToString())
    return output


def _constant(name: str, value: np.ndarray) -> onnx.NodeProto:
    return helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value))


def _value(name: str, shape: Sequence[int]) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape))


@dataclass(frozen=True)
class Candidate:
    """A network to map with."""

    name: str
    model: Path


def mapped(site: Path, model: Path) -> SiteMap:
    """The map of a site with another network, without rows that could not be mapped."""
    return savmap.map_site(site, [PLUGIN], overrides=[f"plugins.{PLUGIN}.model={model.absolute()}"])


def structures(site_map: SiteMap) -> dict[tuple[str, str], Structure]:
    """A map's elements by row and id."""
    return {(name, element.id): element for name, row in site_map.rows.items() for element in row.structures[PLUGIN]}


def line(site: Path, candidate: Candidate, site_map: SiteMap, shipped: SiteMap) -> str:
    """How a map's elements compare with those of the shipped network's map, and with the survey."""
    ours, theirs = structures(site_map), structures(shipped)
    common = ours.keys() & theirs.keys()
    apart = [np.linalg.norm(ours[key].vertices - theirs[key].vertices, axis=1).max() for key in common]
    away = f"{100 * np.median(apart):6.2f} {100 * max(apart):6.2f}" if apart else "     -      -"
    return f"{site.parent.name:10} {candidate.name:28} {len(ours):4} {len(common):5} {away} {score(site, site_map)}"


def score(site: Path, site_map: SiteMap) -> str:
    """Mean absolute error, cm, missing and spurious elements, where the site has a survey."""
    survey = load_site(site).survey
    if survey is None:
        return ""
    whole = pool(savmap.evaluate(site_map, survey).rows.values())
    error = mean_absolute_error(whole)
    missing, spurious = sum(whole.missing.values()), sum(whole.spurious.values())
    return f"{'     -' if error is None else f'{100 * error:6.2f}'} {missing:4} {spurious:4}"


def overlap(model: Path, data: Path, most: int) -> Iterator[str]:
    """IoU by class over labelled pictures, and milliseconds a picture."""
    network = Segmenter(model, 1, wanted=load_class(PLUGIN).classes, providers=("cpu",))
    both, either = np.zeros(len(network.classes)), np.zeros(len(network.classes))
    samples = [sample for sample in read_dataset(data, network.classes).samples if "ceiling" not in sample.image.name][
        :most
    ]
    seconds = []
    for sample in samples:
        picture, mask = sample.load()
        begin = time.perf_counter()
        maps = network.probabilities(picture)
        seconds.append(time.perf_counter() - begin)
        judged = mask != IGNORE
        for number, probability in enumerate(maps[1:]):
            seen, true = (probability > 0.5) & judged, mask == number + 1
            both[number] += (seen & true).sum()
            either[number] += (seen | true).sum()
    for name, value in zip(network.classes, both / np.maximum(either, 1), strict=True):
        yield f"{name} {value:.3f}"
    yield f"{1000 * np.median(seconds):.0f} ms a picture, {len(samples)} pictures"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", type=Path, nargs="*")
    parser.add_argument("--yolo", type=Path, action="append", default=[], help="a YOLO-seg export; may be repeated")
    parser.add_argument("--data", type=Path, help="a labelled data set to measure IoU on")
    parser.add_argument("--pictures", type=int, default=40)
    given = parser.parse_args()
    shipped = Path(load_class(PLUGIN).model)
    with TemporaryDirectory() as folder:
        candidates = [
            Candidate("shipped, semantic", shipped),
            Candidate("YOLO-seg, the same maps", as_yolo(shipped, Path(folder) / "same.onnx")),
            *(Candidate(f"YOLO-seg, {path.name}", path) for path in given.yolo),
        ]
        if given.data is not None:
            for candidate in candidates:
                print(f"IoU  {candidate.name:28} {', '.join(overlap(candidate.model, given.data, given.pictures))}")
        print(
            "site       network                    elements  same  apart cm: median, most   MAE cm, missing, spurious"
        )
        for site in given.sites:
            reference: SiteMap | None = None
            for candidate in candidates:
                try:
                    site_map = mapped(site, candidate.model)
                except SavmapError as error:
                    print(f"{site.parent.name:10} {candidate.name:28} not mapped: {error}")
                    continue
                reference = reference or site_map
                print(line(site, candidate, site_map, reference), flush=True)


if __name__ == "__main__":
    main()
