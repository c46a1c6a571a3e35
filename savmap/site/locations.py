"""Where the keys of a site file stand, and what is wrong with them in one line each: place, key, problem, remedy."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product

from pydantic import BaseModel, ValidationError

from savmap.files import validation
from savmap.files.validation import Location, kinds_at, path_of, schema_of

INHERITED = ("video", "fps", "camera")
"""What passes take from their row, or from the site, where they do not say it themselves."""
SECTIONS = ("object", "array")
"""Types, in JSON Schemas, of sections and lists."""


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
            in_section = location[:-1] == set_at[: len(location) - 1] and location[:-1] not in self.lines
            if above or below or in_section:
                return place
        nearest = (location[:n] for n in range(len(location), -1, -1) if location[:n] in self.lines)
        return next((f"{self.where}:{self.lines[key]}" for key in nearest), self.where)

    def sets(self, location: Location) -> bool:
        """Whether an option or a variable sets a key, or what it stands in."""
        return any(location[: len(above)] == above for above in self.overridden)

    def given(self, location: Location) -> Location:
        """The location at which the value for a key of a pass was given: there, or with its row, or with the site."""
        places = {*self.lines, *self.overridden}
        if location[:1] != ("rows",) or len(location) < 5 or location in places:
            return location
        row, key = location[:2], location[4:]
        if key[0] not in (*INHERITED, "views"):
            return location
        return next((above for above in ((*row, *key), key) if above[:-1] in places or above in places), location)


def without_value(
    model: type[BaseModel],
    source: SourceMap,
    roots: Collection[Location] = ((),),
    empty_sections: bool = True,
) -> dict[Location, str]:
    """A line for each key that has no value, by its location in the file. `roots` are the places there at which the
    model's keys may stand; `empty_sections`: whether nothing may stand in a section."""
    schema, problems = schema_of(model), dict[Location, str]()
    for location, root in product(source.empty, roots):
        if location[: len(root)] == root and location != root and not source.sets(location):
            kinds = kinds_at(schema, location[len(root) :])
            may_be_empty = empty_sections and any(kind.get("type") in SECTIONS for kind in kinds)
            if kinds and all("type" in kind for kind in kinds) and not may_be_empty:
                text = "it has no value: write one behind the colon, or take the key away"
                problems[location] = f"{source.of(location)}: `{path_of(location)}`: {text}"
    return problems


def left_out(model: type[BaseModel], source: SourceMap) -> Iterator[str]:
    """A line for each section or list of a file in which nothing stands."""
    schema = schema_of(model)
    for location in source.empty:
        named = any(location[-1] in section.get("properties", ()) for section in kinds_at(schema, location[:-1]))
        section = any(kind.get("type") in SECTIONS for kind in kinds_at(schema, location))
        if named and section and not source.sets(location):
            yield f"{source.of(location)}: `{path_of(location)}` has no value, and is as good as left out"


def explained(
    error: ValidationError, model: type[BaseModel], source: SourceMap, at: Callable[[Location], Location] = tuple
) -> dict[Location, str]:
    """A line for each problem of a validation error, by its location in the site. `at`: where in the site a key of the
    model stands."""
    return validation.explained(error, model, source.of, lambda location: source.given(at(location)))
