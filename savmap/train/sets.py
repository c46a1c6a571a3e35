"""Data sets of any known kind, recognised by what is in them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from savmap.errors import OutputError
from savmap.io.files import read_json, read_text
from savmap.train.coco import read_coco
from savmap.train.dataset import NO_MAPPING, Dataset, read_dataset
from savmap.train.yolo import read_yolo

KINDS = "a savmap-dataset (dataset.json), COCO instances (a JSON file) or YOLO segments (data.yaml)"


def read_sets(
    sources: Sequence[Path], classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING
) -> list[Dataset]:
    """Data sets with the network's classes; `mapping` gives their classes other names. Raises OutputError for one that cannot be
    read, or is of no known kind."""
    return [read_set(source, classes, mapping) for source in sources]


def read_set(source: Path, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """One data set: a folder, or the JSON or YAML file of one. Raises OutputError."""
    if not source.exists():
        raise OutputError(f"{source}: no such file or folder; give {KINDS} (see docs/training.md)")
    if (source / "dataset.json").is_file():
        return read_dataset(source, classes, mapping)
    found = candidates(source) if source.is_dir() else [source]
    if not found:
        raise OutputError(f"{source}: no dataset.json, nor labels of another kind; give {KINDS} (see docs/training.md)")
    if len(found) > 1:
        names = " and ".join(str(one) for one in found)
        raise OutputError(f"{source}: holds {names}; give the one that is to be trained on")
    if found[0].suffix.lower() in {".yaml", ".yml"}:
        return read_yolo(found[0], yaml_of(found[0]), classes, mapping)
    content = read_json(found[0])
    if not is_coco(content):
        raise OutputError(f"{found[0]}: is not COCO (an object with images, annotations and categories)")
    return read_coco(found[0], content, classes, mapping)


def candidates(folder: Path) -> list[Path]:
    """The files of a folder that describe a set: COCO's JSON files, also in `annotations/`, and YAML files with `names`."""
    jsons = [*sorted(folder.glob("*.json")), *sorted((folder / "annotations").glob("*.json"))]
    yamls = [*sorted(folder.glob("*.yaml")), *sorted(folder.glob("*.yml"))]
    return [one for one in jsons if is_coco(read_json(one))] + [one for one in yamls if "names" in yaml_of(one)]


def is_coco(content: object) -> bool:
    """Whether a JSON file's content has COCO's parts."""
    return isinstance(content, dict) and {"images", "annotations", "categories"} <= set(content)


def yaml_of(path: Path) -> Mapping[str, object]:
    """What a YAML file maps. Raises OutputError where it is none."""
    try:
        content = yaml.safe_load(read_text(path))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise OutputError(f"{path}{f':{mark.line + 1}' if mark else ''}: is not YAML") from None
    if not isinstance(content, dict):
        raise OutputError(f"{path}: is not a data.yaml (a mapping with names and train)")
    return content
