"""Reading site files: YAML with errors that name file, line, key and a remedy."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from savmap.errors import SiteError
from savmap.site import Site
from savmap.validation import path_of, text_of

UNITS = ("m", "mm", "cm", "s", "ms", "deg", "rad", "px", "fps")


def load_site(path: Path) -> Site:
    """The site of a file, its relative paths taken from the file's folder.

    Raises SiteError with file and line for anything that is not as docs/site-file.md says.
    """
    text = _read(path)
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}" if mark else str(path)
        raise SiteError(f"{where}: not valid YAML: {getattr(error, 'problem', error)}") from None
    if not isinstance(content, dict):
        raise SiteError(f"{path}: a site file is a mapping with at least `rows:` (see docs/site-file.md)")
    try:
        site = Site.model_validate(content)
    except ValidationError as error:
        raise SiteError(explain(error, Site, path, node)) from None
    return _resolve(site, path.parent)


def explain(error: ValidationError, model: type[BaseModel], where: Path | str, node: yaml.Node | None = None) -> str:
    """One line for the first problem of a validation error: file, line, key, what is wrong, and the nearest right key."""
    problems = error.errors()
    problem = next((one for one in problems if one["type"] == "extra_forbidden"), problems[0])
    location = problem["loc"]
    line = _line(node, location)
    key = path_of(problem)
    place = f"{where}:{line}" if line else str(where)
    if problem["type"] == "extra_forbidden":
        return f"{place}: unknown key `{key}`{_hint(str(location[-1]), _keys(model, location[:-1]))}"
    if problem["type"] == "missing":
        return f"{place}: `{key}` is missing"
    return (
        f"{place}: `{key}`: {text_of(problem).lower()} (it is {problem['input']!r}; lengths are metres, times seconds)"
    )


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SiteError(f"{path}: no such site file (give one, or run in a folder that has a site.yaml)") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SiteError(f"{path}: cannot be read as a site file: {error}") from None


def _resolve(site: Site, folder: Path) -> Site:
    def resolved(path: Path) -> Path:
        return path if path.is_absolute() else folder / path

    rows = {
        name: row.model_copy(
            update={"passes": tuple(p.model_copy(update={"video": resolved(p.video)}) for p in row.passes)}
        )
        for name, row in site.rows.items()
    }
    survey = resolved(site.survey) if site.survey else None
    return site.model_copy(update={"rows": rows, "survey": survey})


def _line(node: yaml.Node | None, location: tuple[int | str, ...]) -> int | None:
    if node is None:
        return None
    line: int = node.start_mark.line + 1
    for part in location:
        if isinstance(node, yaml.MappingNode):
            found = next(((k, v) for k, v in node.value if k.value == str(part)), None)
            if found is None:
                return line
            line, node = found[0].start_mark.line + 1, found[1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
    return line


def _keys(model: Any, location: tuple[int | str, ...]) -> list[str]:
    """Keys that are allowed at a place of the model, found by following field annotations."""
    current = model
    for part in location:
        inner = _models_in(current)
        fields = inner.model_fields if inner else {}
        current = fields[part].annotation if isinstance(part, str) and part in fields else current
    inner = _models_in(current)
    return list(inner.model_fields) if inner else []


def _models_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        found = _models_in(argument)
        if found:
            return found
    return None


def _hint(key: str, allowed: list[str]) -> str:
    stem = key.rsplit("_", 1)
    same_stem = [a for a in allowed if a.rsplit("_", 1)[0] == stem[0] and a != key]
    if len(stem) == 2 and stem[1] in UNITS and same_stem:
        return f": wrong unit? Use `{same_stem[0]}`"
    near = difflib.get_close_matches(key, allowed, 1)
    if near:
        return f": did you mean `{near[0]}`?"
    return f": allowed here are {', '.join(allowed)}" if allowed else ""


def validated(model: type[BaseModel], values: Mapping[str, Any], where: str) -> BaseModel:
    """A config made from values, or SiteError with one line that says what is wrong with it and where."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise SiteError(explain(error, model, where)) from None
