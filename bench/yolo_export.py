"""A real YOLO-seg export of savmap's classes, in an environment of its own that has ultralytics (AGPL-3.0; savmap does not need it).

    python -m venv yolo && yolo/bin/pip install ultralytics onnx onnxruntime && yolo/bin/pip install -e '.[sim]'
    python bench/yolo_export.py pictures data/blue --count 600 --seed 71
    python bench/yolo_export.py row data/blue-row --seed 5200
    yolo/bin/python bench/yolo_export.py set data/yolo --data data/blue
    yolo/bin/python bench/yolo_export.py train data/yolo --minutes 30 --size 384 -o runs/racks.onnx
    yolo/bin/python bench/yolo_export.py train data/yolo --minutes 16 --from runs/train/weights/last.pt -o racks.onnx
    yolo/bin/python bench/yolo_export.py compare racks.onnx data/yolo/images/val
    python bench/networks.py data/blue-row/site.yaml --yolo racks.onnx

`pictures` and `row` are made-up racks of one style, blue with orange beams, as a user's own are: so few pictures and minutes do
not teach a network every style from nothing. `set` turns labelled pictures into a YOLO-seg set; `train` trains from the architecture's file alone,
without anyone's weights, or goes on from a run's own, and exports; `compare` reads pictures with savmap and with ultralytics itself and says how far their masks agree.
"""

import argparse
import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.label.polygons import outlines
from savmap.lab.sim.dataset import write
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import simulate
from savmap.lab.train.data.dataset import read_dataset, split
from savmap.vision.networks.segmenter import Segmenter

CLASSES = ("upright", "beam")
CARTONS = [[0.48, 0.33, 0.2], [0.42, 0.28, 0.16], [0.6, 0.6, 0.58], [0.2, 0.2, 0.22]]
LEAST_PIXELS = 20


def blue(scene: Scene) -> Scene:
    """A scene with its racks in one style and goods in few colours."""
    content = scene.model_dump(mode="json")
    for rack in content["structures"]["shelves"]["rows"].values():
        rack |= {"upright_color": [0.03, 0.12, 0.42], "upright_texture": "holes", "rear_color": None}
        rack |= {"beam_color": [0.8, 0.25, 0.02], "beam_texture": "plain", "metallic": 0.0}
    content["goods"]["colors"] = CARTONS
    return parse_scene(content, "blue racks")


def make_row(folder: Path, seed: int) -> None:
    """Footage of a row of that style, with its site file and survey."""
    simulate(blue(random_row(seed, frames=36, width=4096)), folder)


def yolo(model: Path | str) -> Any:
    """ultralytics' model. Ends with a line where it is not installed."""
    try:
        return importlib.import_module("ultralytics").YOLO(str(model), task="segment")
    except ModuleNotFoundError:
        raise SystemExit("ultralytics is not installed here; see the head of this file") from None


def lines_of(mask: NDArray[np.uint8]) -> Iterator[str]:
    """Lines of a YOLO-seg label file: the number of the class and the outline, 0..1, of each connected region."""
    height, width = mask.shape
    for number in range(len(CLASSES)):
        for outline in outlines(mask == number + 1, least_pixels=LEAST_PIXELS):
            yield f"{number} {' '.join(f'{place:.5f}' for place in (outline / (width, height)).ravel())}"


def make_set(folders: Sequence[Path], output: Path) -> None:
    """A YOLO-seg set of the pictures that show a class, with the data sets' own split."""
    for folder in folders:
        for name, samples in zip(("train", "val"), split(read_dataset(folder, CLASSES).samples), strict=True):
            for kind in ("images", "labels"):
                (output / kind / name).mkdir(parents=True, exist_ok=True)
            for sample in samples:
                picture, mask = sample.load()
                if lines := list(lines_of(mask)):
                    stem = f"{folder.name}-{sample.image.stem}"
                    cv2.imwrite(str(output / "images" / name / f"{stem}.jpg"), picture[:, :, ::-1])
                    (output / "labels" / name / f"{stem}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    names = ", ".join(f"{number}: {name}" for number, name in enumerate(CLASSES))
    text = f"path: {output.absolute()}\ntrain: images/train\nval: images/val\nnames: {{{names}}}\n"
    (output / "data.yaml").write_text(text, encoding="utf-8")


def train(data: Path, start: str, minutes: float, size: int, output: Path) -> None:
    """Train for so many minutes, from an architecture's file or weights, and export."""
    model = yolo(start)
    model.add_callback("on_train_start", in_few_bits)
    settings = {"device": "cpu", "workers": 0, "batch": 8, "amp": False, "plots": False, "val": False, "mosaic": 0.0}
    settings |= {"warmup_epochs": 1.0, "cache": "ram"}
    folder = output.absolute().parent
    model.train(data=str(data / "data.yaml"), time=minutes / 60, imgsz=size, project=str(folder), **settings)
    export(yolo(model.trainer.last), output)


def in_few_bits(trainer: Any) -> None:
    """Let a training network compute in bfloat16 where the processor can; what it returns, and so the loss, stays in 32 bits."""
    import torch
    from torch.utils._pytree import tree_map

    from savmap.lab.train.device import fast_arithmetic

    plain = trainer.model.predict

    def predict(*given: Any, **named: Any) -> Any:
        with fast_arithmetic(torch.device("cpu")):
            outputs = plain(*given, **named)
        return tree_map(lambda value: value.float() if hasattr(value, "float") else value, outputs)

    trainer.model.predict = predict


def export(model: Any, output: Path) -> None:
    """A model as an ONNX file for views of 640 x 480."""
    Path(model.export(format="onnx", imgsz=[480, 640], simplify=False)).replace(output)


def compare(export: Path, pictures: Sequence[Path]) -> None:
    """Print the IoU of savmap's masks with ultralytics' own, class by class, over all pictures together."""
    ours, theirs = Segmenter(export, 1, providers=("cpu",)), yolo(export)
    both, either = np.zeros(len(ours.classes)), np.zeros(len(ours.classes))
    instances = [0, 0]
    for path in pictures:
        picture = cv2.imread(str(path))
        assert picture is not None
        segmentation = ours.predict(np.ascontiguousarray(picture[:, :, ::-1], np.uint8))
        result = theirs.predict(picture, conf=0.25, iou=0.7, retina_masks=True, verbose=False)[0]
        kinds = result.boxes.cls.numpy().astype(int)
        masks = np.zeros((0, *picture.shape[:2])) if result.masks is None else result.masks.data.numpy()
        instances[0] += sum(int(owner.max()) for owner in segmentation.owners) if segmentation.owners is not None else 0
        instances[1] += len(kinds)
        for number in range(len(ours.classes)):
            our_mask, their_mask = segmentation.maps[number + 1] > 0.5, (masks[kinds == number] > 0.5).any(axis=0)
            both[number] += (our_mask & their_mask).sum()
            either[number] += (our_mask | their_mask).sum()
    for name, value in zip(ours.classes, both / np.maximum(either, 1), strict=True):
        print(f"{name}: IoU of savmap's and ultralytics' masks {value:.4f}")
    print(f"instances: {instances[0]} and {instances[1]} in {len(pictures)} pictures")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    doing = parser.add_subparsers(dest="doing", required=True)
    for name in ("pictures", "row"):
        command = doing.add_parser(name)
        command.add_argument("output", type=Path)
        command.add_argument("--seed", type=int, required=True)
    doing.choices["pictures"].add_argument("--count", type=int, required=True)
    command = doing.add_parser("set")
    command.add_argument("output", type=Path)
    command.add_argument("--data", type=Path, action="append", required=True)
    command = doing.add_parser("train")
    command.add_argument("data", type=Path)
    command.add_argument(
        "--from", dest="start", default="yolo11n-seg.yaml", help="an architecture's file, or weights of an earlier run"
    )
    command.add_argument("--minutes", type=float, default=30.0)
    command.add_argument("--size", type=int, default=640)
    command.add_argument("-o", "--output", type=Path, required=True)
    command = doing.add_parser("compare")
    command.add_argument("model", type=Path)
    command.add_argument("pictures", type=Path)
    given = parser.parse_args()
    if given.doing == "pictures":
        write(given.output, given.seed, given.count, "face", CLASSES, lambda seed: blue(random_scene(seed)))
    elif given.doing == "row":
        make_row(given.output, given.seed)
    elif given.doing == "set":
        make_set(given.data, given.output)
    elif given.doing == "train":
        train(given.data, given.start, given.minutes, given.size, given.output)
    else:
        compare(given.model, sorted(given.pictures.glob("*.jpg")))


if __name__ == "__main__":
    main()
