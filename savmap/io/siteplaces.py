"""Where the keys of a site file stand, and what is wrong with them in one line each: place, key, problem, remedy."""

import difflib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from reprlib import Repr
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from savmap.io.overrides import Location
from savmap.sitedefaults import INHERITED
from savmap.validation import path_of, text_of

MOST_KEYS = 100_000
SHORT = Repr()
SHORT.maxstring = SHORT.maxother = 80
UNITS = ("m", "mm", "cm", "s", "ms", "deg", "rad", "px", "fps")


@dataclass(frozen=True)
class Places:
    """Where a site's keys were given: lines of its file `where`, and the options or variables that set them instead."""

    where: str
    lines: Mapping[Location, int] = field(default_factory=dict)
    overridden: Mapping[Location, str] = field(default_factory=dict)

    def of(self, location: Location, whole: bool = False) -> str:
        """ "site.yaml:12" of the key at a location, or the nearest one above it; or what overrode it, or made the section that it
        is missing in. `whole`: a problem of the section at that location, which anything that was set in it may have made."""
        for set_at, place in reversed(list(self.overridden.items())):
            above = set_at == location[: len(set_at)]
            below = location == set_at[: len(location)] and (whole or location not in self.lines)
            beside = location[:-1] == set_at[: len(location) - 1] and location[:-1] not in self.lines
            if above or below or beside:
                return place
        inside = next((own for n in range(len(location), -1, -1) if (own := location[:n]) in self.lines), None)
        return self.where if inside is None else f"{self.where}:{self.lines[inside]}"

    def given(self, location: Location) -> Location:
        """The location at which the value for a key of a pass was given: there, or with its row, or with the site."""
        known = {*self.lines, *self.overridden}
        if location[:1] != ("rows",) or len(location) < 5 or location in known:
            return location
        row, key = location[:2], location[4:]
        if key[0] not in (*INHERITED, "views"):
            return location
        return next((above for above in ((*row, *key), key) if above[:-1] in known or above in known), location)


def lines_of(node: yaml.Node | None) -> dict[Location, int]:
    """The line, from 1, of every key and entry of a YAML document."""
    return dict(islice(_lines(node, (), frozenset()), MOST_KEYS)) if node is not None else {}


def given_twice(node: yaml.Node | None) -> Iterator[tuple[Location, int, int]]:
    """Keys that stand twice in one section, of which YAML would keep the last: location, both lines."""
    return _twice(node, (), set())


def _twice(node: yaml.Node | None, location: Location, seen: set[int]) -> Iterator[tuple[Location, int, int]]:
    if id(node) in seen:
        return
    seen.add(id(node))
    if isinstance(node, yaml.MappingNode):
        first: dict[str, int] = {}
        for key, value in node.value:
            line, inside = key.start_mark.line + 1, (*location, str(key.value))
            if str(key.value) in first and key.value != "<<":
                yield inside, first[str(key.value)], line
            first.setdefault(str(key.value), line)
            yield from _twice(value, inside, seen)
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            yield from _twice(value, (*location, number), seen)


def explained(
    error: ValidationError, model: type[BaseModel], places: Places, at: Callable[[Location], Location] = tuple
) -> dict[Location, str]:
    """A line for each problem of a validation error, by its place in the site, unknown keys first. `at`: where in the site a key
    of the model stands."""
    problems = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    found: dict[Location, ErrorDetails] = {}
    for one in problems:
        follows = one["type"] == "too_short" and any(
            own is not one and own["loc"][: len(one["loc"])] == one["loc"] for own in problems
        )
        if not follows:
            found.setdefault(places.given(at(one["loc"])), one)
    return {location: _explained(one, location, model, places) for location, one in found.items()}


def _explained(problem: ErrorDetails, location: Location, model: type[BaseModel], places: Places) -> str:
    key = path_of({**problem, "loc": location})
    place = places.of(location, whole=problem["type"] == "value_error")
    if problem["type"] == "extra_forbidden":
        allowed = _keys(model, problem["loc"][:-1])
        return f"{place}: unknown key `{key}`{_hint(str(location[-1]), allowed)}"
    if problem["type"] == "missing":
        return f"{place}: `{key}` is missing"
    text = text_of(problem)
    text = text[:1].lower() + text[1:]
    if problem["type"] == "value_error":
        return f"{place}: `{key}`: {text}"
    units = "; lengths are metres, times seconds" if isinstance(problem["input"], int | float) else ""
    return f"{place}: `{key}`: {text} (it is {SHORT.repr(problem['input'])}{units})"


def _lines(node: yaml.Node, location: Location, above: frozenset[int]) -> Iterator[tuple[Location, int]]:
    yield location, node.start_mark.line + 1
    if id(node) in above:
        return
    inside = above | {id(node)}
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield from _lines(value, (*location, str(key.value)), inside)
            yield (*location, str(key.value)), key.start_mark.line + 1
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            yield from _lines(value, (*location, number), inside)


def _keys(model: Any, location: Location) -> list[str]:
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
