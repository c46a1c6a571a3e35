"""Data sets of any known kind, recognised by what is in them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from savmap.errors import OutputError
from savmap.files import yaml_text
from savmap.files.atomic import read_json, read_text
from savmap.files.urls import likely, on_disk
from savmap.lab.train.data.coco import read_coco
from savmap.lab.train.data.dataset import NO_MAPPING, Dataset, Sample, read_dataset
from savmap.lab.train.data.labelme import is_labelme, read_labelme
from savmap.lab.train.data.yolo import read_yolo

MOST_MB = 256
"""Of a file of labels, in which a picture may lie too."""
HEADER = "dataset.json"
KINDS = f"a savmap-dataset ({HEADER}), COCO instances (a JSON file), YOLO segments (data.yaml) or a folder of LabelMe's files"
Reader = Callable[[Sequence[str], Mapping[str, str]], Dataset]


def read_sets(
    sources: Sequence[Path], classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING, every: int = 1
) -> list[Dataset]:
    """Data sets with the network's classes, thinned to one picture of `every`; `mapping` gives their classes other
    names. Raises OutputError for one that cannot be read, or is of no known kind."""
    sets = [read_set(source, classes, mapping) for source in sources]
    return [replace(one, samples=one.samples[::every]) for one in sets]


def samples_of(datasets: Sequence[Dataset]) -> list[Sample]:
    """The pictures of all sets. One that stands in several belongs to one scene, so that no copy of a picture that is
    held out is trained on."""
    scenes: dict[str, str] = {}
    return [
        replace(sample, group=scenes.setdefault(sample.image_digest, sample.group))
        for dataset in datasets
        for sample in dataset.samples
    ]


def read_set(source: Path, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """One data set: a folder, or the JSON or YAML file of one. Raises OutputError, also for a folder that holds
    several: labels are corrected in one of them, and the others are out of date."""
    source = on_disk(source)
    if not source.exists():
        raise OutputError(f"{source}: no such file or folder{likely(source)}; give {KINDS} (see docs/training.md)")
    readers = dict(sets_in(source)) if source.is_dir() else {source: reader_of(source)}
    if not readers:
        raise OutputError(f"{source}: no {HEADER}, nor labels of another kind; give {KINDS} (see docs/training.md)")
    if len(readers) > 1:
        names = ", ".join("LabelMe's files" if path == source else str(path) for path in readers)
        raise OutputError(
            f"{source}: holds labels of several kinds ({names}); give one of them, or move the others away"
        )
    (read,) = readers.values()
    return read(classes, mapping)


def sets_in(folder: Path) -> Iterator[tuple[Path, Reader]]:
    """The sets in a folder: the path to give for each, and its reader. COCO's JSON files may be in `annotations/`,
    LabelMe's in `images/`."""
    if (folder / HEADER).is_file():
        yield folder / HEADER, partial(read_dataset, folder)
    for place in (folder, folder / "annotations", folder / "images"):
        contents = {path: parsed(path) for path in sorted(place.glob("*.json")) if path.name != HEADER}
        yield from ((path, partial(read_coco, path, content)) for path, content in contents.items() if is_coco(content))
        drawn = {path: content for path, content in contents.items() if is_labelme(content)}
        if drawn:
            yield place, partial(read_labelme, place, drawn)
    for path in [*sorted(folder.glob("*.yaml")), *sorted(folder.glob("*.yml"))]:
        if "names" in (content := yaml_of(path)):
            yield path, partial(read_yolo, path, content)


def reader_of(file: Path) -> Reader:
    """The reader of the set that a file describes. Raises OutputError for one of no known kind."""
    if file.name == HEADER:
        return partial(read_dataset, file.parent)
    if file.suffix.lower() in {".yaml", ".yml"}:
        return partial(read_yolo, file, yaml_of(file))
    content = parsed(file)
    if is_labelme(content):
        raise OutputError(f"{file}: is LabelMe's of one picture; give the folder that it is in")
    if not is_coco(content):
        raise OutputError(f"{file}: is not COCO (an object with images, annotations and categories)")
    return partial(read_coco, file, content)


def parsed(file: Path) -> object:
    """A JSON file's content, without the copy of the picture that LabelMe may put into it."""
    content = read_json(file, MOST_MB)
    if isinstance(content, dict):
        content.pop("imageData", None)
    return content


def is_coco(content: object) -> bool:
    """Whether a JSON file's content has COCO's parts."""
    return isinstance(content, dict) and {"images", "annotations", "categories"} <= set(content)


def yaml_of(path: Path) -> Mapping[str, object]:
    """The mapping in a YAML file. Raises OutputError if there is none."""
    try:
        content = yaml_text.load(read_text(path, yaml_text.MOST_MB))
    except yaml_text.YamlError as error:
        raise OutputError(f"{path}{f':{error.line}' if error.line else ''}: is not YAML ({error})") from None
    if not isinstance(content, dict):
        raise OutputError(f"{path}: is not a data.yaml (a mapping with names and train)")
    return content
