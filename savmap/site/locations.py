"""Where the keys of a site file stand, and what is wrong with them in one line each: place, key, problem, remedy."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice

import yaml
from pydantic import BaseModel, ValidationError

from savmap.files import validation
from savmap.files.validation import Location
from savmap.site.inheritance import INHERITED

MOST_KEYS = 100_000


@dataclass(frozen=True)
class SourceMap:
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
    error: ValidationError, model: type[BaseModel], source: SourceMap, at: Callable[[Location], Location] = tuple
) -> dict[Location, str]:
    """A line for each problem of a validation error, by its location in the site. `at`: where in the site a key of the model stands."""
    return validation.explained(error, model, source.of, lambda location: source.given(at(location)))


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
