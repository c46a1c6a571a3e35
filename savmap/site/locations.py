"""Where the keys of a site file stand, and what is wrong with them in one line each: place, key, problem, remedy."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice, product
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from savmap.files import validation
from savmap.files.mistakes import allows_section, annotations_at, misread
from savmap.files.validation import Location, path_of
from savmap.files.yaml_text import space_needed, unspaced
from savmap.site.inheritance import INHERITED

MOST_KEYS = 100_000


@dataclass(frozen=True)
class SourceMap:
    """Where a site's keys were given: lines of its file `where`, the options or variables that set them instead, and
    the keys behind whose colon nothing stands (not even null)."""

    where: str
    lines: Mapping[Location, int] = field(default_factory=dict)
    overridden: Mapping[Location, str] = field(default_factory=dict)
    empty: Collection[Location] = ()

    def of(self, location: Location, whole: bool = False) -> str:
        """ "site.yaml:12" of the key at a location, or the nearest one above it; or what overrode it, or made the
        section that it is missing in. `whole`: a problem of the section at that location, which anything that was set
        in it may have made."""
        for set_at, place in reversed(list(self.overridden.items())):
            above = set_at == location[: len(set_at)]
            below = location == set_at[: len(location)] and (whole or location not in self.lines)
            beside = location[:-1] == set_at[: len(location) - 1] and location[:-1] not in self.lines
            if above or below or beside:
                return place
        inside = next((own for n in range(len(location), -1, -1) if (own := location[:n]) in self.lines), None)
        return self.where if inside is None else f"{self.where}:{self.lines[inside]}"

    def sets(self, location: Location) -> bool:
        """Whether an option or a variable sets a key, or what it stands in."""
        return any(location[: len(above)] == above for above in self.overridden)

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


def empty_keys(node: yaml.Node | None) -> list[Location]:
    """The keys of a YAML document behind whose colon nothing stands."""
    return list(islice(_empty(node, (), frozenset()), MOST_KEYS))


def _empty(node: yaml.Node | None, location: Location, above: frozenset[int]) -> Iterator[Location]:
    if id(node) in above:
        return
    inside = above | {id(node)}
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            own = (*location, str(key.value))
            if isinstance(value, yaml.ScalarNode) and not value.value and not value.style:
                yield own
            yield from _empty(value, own, inside)
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            yield from _empty(value, (*location, number), inside)


def misspelt(
    model: type[BaseModel],
    content: object,
    source: SourceMap,
    at: Callable[[Location], Location] = tuple,
    roots: Collection[Location] = ((),),
    empty_sections: bool = True,
) -> dict[Location, str]:
    """A line for each key of a content, by its location in the file, that has no value or runs into it, and for each
    number that YAML reads otherwise than people do. `at` gives a model key's location in the file, `roots` are the
    places there at which the model's keys may stand; `empty_sections`: whether nothing may stand in a section."""
    found = {at(location): text for location, text in misread(model, content)}
    for location, root in product(source.empty, roots):
        if location[: len(root)] != root or location == root or source.sets(location):
            continue
        kinds = annotations_at(model, location[len(root) :])
        if parts := unspaced(str(location[-1])):
            found[location] = space_needed(*parts)
        elif kinds and Any not in kinds and not (empty_sections and allows_section(kinds)):
            found[location] = "it has no value: write one behind the colon, or take the key away"
    return {location: f"{source.of(location)}: `{path_of(location)}`: {text}" for location, text in found.items()}


def left_out(model: type[BaseModel], source: SourceMap) -> Iterator[str]:
    """A line for each section or list of a file in which nothing stands."""
    for location in source.empty:
        above = annotations_at(model, location[:-1])
        named = any(isinstance(one, type) and issubclass(one, BaseModel) for one in above)
        if named and not source.sets(location) and allows_section(annotations_at(model, location)):
            yield f"{source.of(location)}: `{path_of(location)}` has no value, and is as good as left out"


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
    """A line for each problem of a validation error, by its location in the site. `at`: where in the site a key of the
    model stands."""
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
