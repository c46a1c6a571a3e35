"""Fingerprints of what a row's stages are made of: footage, settings, networks, code. Same fingerprint, same result."""

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
from savmap.maps.map_file import map_text
from savmap.plugin.manager import LoadedPlugin
from savmap.site.job import Job, plugins_for
from savmap.site.model import Pass
from savmap.types import SiteMap
from savmap.vision.networks.providers import choose, runtime_version

LIBRARIES = ("av", "gtsam", "numpy", "opencv-python-headless", "scipy")
ELSEWHERE = {"sim", "train", "report", "testing", "scaffold", "commands"}
ENDS = 1 << 20


def measurement_key(job: Job, name: str) -> str:
    """Of what a row's pictures show: everything but what is used after they were looked at."""
    known = job.site.row_references(name)
    return _digest(
        row=name,
        code=code(plugins_for(job, name)),
        passes=[_pass(one) for one in job.site.rows[name].passes],
        plugins=[_room(plugin, pixels_only=True) for plugin in plugins_for(job, name)],
        markers=[marker.model_dump(mode="json") for marker in known.markers],
        appearance=job.site.row_appearance(name),
        earlier=_file(job.earlier),
    )


def solution_key(job: Job, seen: Mapping[str, str]) -> str:
    """Of the maps of rows that are solved together, from the fingerprints of what was seen of them."""
    return _digest(
        seen=dict(seen),
        plugins={name: [_room(plugin, pixels_only=False) for plugin in plugins_for(job, name)] for name in seen},
        references={name: job.site.row_references(name).model_dump(mode="json") for name in seen},
        calibration={name: job.site.row_calibration(name).model_dump(mode="json") for name in seen},
    )


def drawing_key(site_map: SiteMap, name: str, survey: Mapping[str, Any] | None) -> str:
    """Of a row's pictures."""
    return _digest(
        row=map_text(SiteMap({name: site_map.rows[name]}, site_map.made_by)),
        survey=dict(survey) if survey is not None else None,
        code=[_sources(Path(__file__).parent), _sources(Path(__file__).parent / "report")],
    )


def code(plugins: Sequence[LoadedPlugin]) -> str:
    """Of the program, its plugins, and the libraries that count."""
    packages = sorted({_package_of(type(plugin.instance)) for plugin in plugins})
    named = {name for plugin in plugins for name in getattr(plugin.instance, "libraries", ())}
    return _digest(
        savmap=_sources(Path(__file__).parent),
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


def _digest(**parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def _pass(one: Pass) -> dict[str, Any]:
    return {**one.model_dump(mode="json", exclude={"video"}), "video": list(_footage(one.video))}


def _room(plugin: LoadedPlugin, pixels_only: bool) -> dict[str, Any]:
    settings: BaseModel = plugin.config
    later = set(getattr(plugin.instance, "after_pixels", ())) if pixels_only else set()
    return {
        "name": plugin.name,
        "plugin": f"{type(plugin.instance).__module__}.{type(plugin.instance).__qualname__}",
        "settings": settings.model_dump(mode="json", exclude=later | {"model"}),
        "model": _file(plugin.model_file),
        "providers": choose(plugin.providers).names,
    }


def _footage(path: Path) -> Iterator[tuple[str, int, int, str]]:
    """Name, size, time of change and a digest of both ends, of a video or of all files of a folder of pictures."""
    try:
        for own in sorted(path.iterdir()) if path.is_dir() else [path]:
            facts = own.stat()
            yield own.name, facts.st_size, facts.st_mtime_ns, _ends(own) if own.is_file() else ""
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


def _package_of(kind: type) -> Path:
    """The folder of a class's package, or its file where it is in none."""
    place = Path(inspect.getfile(kind))
    return place.parent if sys.modules[kind.__module__].__package__ else place


@cache
def _sources(place: Path) -> str:
    """Digest of a package's Python files, but for parts that make no map."""
    files = [place] if place.is_file() else sorted(place.rglob("*.py"))
    own = [(file, file.relative_to(place).parts) for file in files]
    chosen = [(str(Path(*parts)), sha256(file)) for file, parts in own if not parts or parts[0] not in ELSEWHERE]
    return _digest(files=chosen)
