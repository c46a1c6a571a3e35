"""Cache keys: digests of what a row's stages are made of. Same key, same result.

Every file that a result depends on is in its key:

| file | by |
| --- | --- |
| videos, folders of pictures | `_footage`: name, size, time of change, both ends |
| networks: those of a plugin, the one that the user names, their weights beside them, in float32 where a provider wants
that | `_network` |
| an earlier map whose path is used, or that is updated | `_file` |
| code of savmap and of plugins, with whatever lies in their packages beside it | `_sources` |
| libraries that count, and those that a plugin names | their versions |
| the survey, for pictures of it | its content |
"""

import hashlib
import inspect
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from savmap.errors import VideoError
from savmap.files.atomic import reason, sha256
from savmap.files.serialization import packed
from savmap.plugin.manager import LoadedPlugin
from savmap.site.job import Job, plugins_for
from savmap.site.model import Pass
from savmap.types import RowMap
from savmap.vision.networks.session import choose, file_for, network_files, runtime_version

LIBRARIES = ("av", "gtsam", "numpy", "opencv-python-headless", "pillow", "scipy")
DRAWING_LIBRARIES = ("jinja2", "matplotlib", "resvg-py")
SAVMAP = Path(__file__).parents[1]
NO_MAP = {"lab", "split", "report", "viewer", "demo", "cli", "contract.py", "scaffold"}
"""Parts of savmap that have no influence on a map, or on the pictures of a row."""
NO_SOURCE = {".pyc", ".onnx", ".md"}
"""Endings of files in packages that are in no key, or in it otherwise."""
ENDS = 1 << 20


def measurement_key(job: Job, row: str) -> str:
    """Of what is measured in a row's pictures: everything but what is used after that."""
    references = job.site.row_references(row)
    plugins = plugins_for(job, row)
    return digest(
        row=row,
        code=code(plugins),
        passes=[_pass(row_pass) for row_pass in job.site.rows[row].passes],
        plugins=[_plugin(plugin, pixels_only=True) for plugin in plugins],
        markers=[marker.model_dump(mode="json") for marker in references.markers],
        appearance=job.site.row_appearance(row),
        earlier=_file(job.earlier),
    )


def solution_key(job: Job, measurement_keys: Mapping[str, str]) -> str:
    """Of the maps of rows that are solved together, from the keys of their measurements by row."""
    rows = list(measurement_keys)
    return digest(
        measured=dict(measurement_keys),
        plugins={row: [_plugin(plugin, pixels_only=False) for plugin in plugins_for(job, row)] for row in rows},
        references={row: job.site.row_references(row).model_dump(mode="json") for row in rows},
        calibration={row: job.site.row_calibration(row).model_dump(mode="json") for row in rows},
        against=[_file(job.against), job.against_row],
    )


def strips_key(job: Job, measured: str) -> str:
    """Of the pictures that were kept of a row's frames, from the key of its measurement."""
    return digest(measured=measured, strips=job.site.orthophotos, stills=job.site.panoramas)


def picture_key(strips: str, solved: bytes) -> str:
    """Of a row's orthophoto and stills, from the key of what they are made of and its solved map."""
    return digest(strips=strips, solved=hashlib.sha256(solved).hexdigest())


def drawing_key(row: RowMap, survey: Mapping[str, Any] | None) -> str:
    """Of a row's pictures."""
    return digest(
        row=hashlib.sha256(packed(row)).hexdigest(),
        survey=dict(survey) if survey is not None else None,
        code=[_sources(SAVMAP), _sources(SAVMAP / "report")],
        libraries={name: _version(name) for name in DRAWING_LIBRARIES},
    )


def code(plugins: Sequence[LoadedPlugin]) -> str:
    """Of the program, its plugins, and the libraries that count."""
    kinds = [type(plugin.instance) for plugin in plugins]
    files = [(Path(inspect.getfile(kind)), sys.modules[kind.__module__].__package__) for kind in kinds]
    packages = sorted({file.parent if package else file for file, package in files})
    named = {name for plugin in plugins for name in getattr(plugin.instance, "libraries", ())}
    return digest(
        savmap=_sources(SAVMAP),
        plugins=[_sources(place) for place in packages],
        libraries={
            **{name: _version(name) for name in sorted({*LIBRARIES, *named})},
            "onnxruntime": runtime_version(),
        },
    )


def _version(library: str) -> str:
    """Empty where it is not installed: a plugin may do without."""
    try:
        return version(library)
    except PackageNotFoundError:
        return ""


def digest(**parts: Any) -> str:
    """SHA-256 of parts that JSON can hold, or that can be told apart by their text."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def _pass(row_pass: Pass) -> dict[str, Any]:
    calibration = None if row_pass.camera is None else row_pass.camera.calibration
    return {
        **row_pass.model_dump(mode="json", exclude={"video"}),
        "video": list(_footage(row_pass.video)),
        "calibration": _file(calibration),
    }


def _plugin(plugin: LoadedPlugin, pixels_only: bool) -> dict[str, Any]:
    settings: BaseModel = plugin.config
    later = set(getattr(plugin.instance, "after_pixels", ())) if pixels_only else set()
    providers = choose(plugin.providers).names
    return {
        "name": plugin.name,
        "plugin": f"{type(plugin.instance).__module__}.{type(plugin.instance).__qualname__}",
        "settings": settings.model_dump(mode="json", exclude=later | {"model"}),
        "model": _network(plugin.model, providers),
        "providers": providers,
    }


def _network(model: Path, providers: Sequence[str]) -> list[str]:
    """Digests of all files of a network, and of the one in float32 beside it if a provider runs that; none where there
    is no such file."""
    files = dict.fromkeys(file_for(model, provider) for provider in providers)
    return [_file(part) for file in files if file.is_file() for part in network_files(file)]


def _footage(path: Path) -> Iterator[tuple[str, int, int, str]]:
    """Name, size, time of change and a digest of both ends, of a video or of all files of a folder of pictures."""
    try:
        for file in sorted(path.iterdir()) if path.is_dir() else [path]:
            facts = file.stat()
            yield file.name, facts.st_size, facts.st_mtime_ns, _ends(file) if file.is_file() else ""
    except OSError as error:
        raise VideoError(f"{path}: cannot be read: {reason(error)}") from error


def _ends(path: Path) -> str:
    with path.open("rb") as file:
        first = file.read(ENDS)
        file.seek(max(path.stat().st_size - ENDS, 0))
        return hashlib.sha256(first + file.read(ENDS)).hexdigest()


def _file(path: Path | None) -> str:
    """Digest of a file; empty where there is none, which whoever reads it will tell."""
    if path is None or not path.is_file():
        return ""
    facts = path.stat()
    return _unchanged(path, facts.st_size, facts.st_mtime_ns)


@cache
def _unchanged(path: Path, size: int, changed_ns: int) -> str:
    """Digest of a file as it was then: every row asks for the same networks."""
    return sha256(path)


@cache
def _sources(place: Path) -> str:
    """Digest of a package's files, code and what it reads, but for parts that make no map and for networks."""
    files = [place] if place.is_file() else sorted(file for file in place.rglob("*") if file.suffix not in NO_SOURCE)
    parts = [(file, file.relative_to(place).parts) for file in files]
    used = [(file, names) for file, names in parts if not NO_MAP.intersection(names) and file.is_file()]
    return digest(files=[(str(Path(*names)), sha256(file)) for file, names in used])
