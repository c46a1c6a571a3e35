"""What pydantic finds wrong with a value, in a user's words: at the value's own key, and of the kinds of value that may
stand there the one that was meant."""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from savmap.files.yaml_text import AsWritten, space_needed, unspaced

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

Location = tuple[int | str, ...]
Found = tuple[Location, "ErrorDetails"]
COMMA = re.compile(r"\s*([+-]?\d+),(\d+)\s*")
SECTION = "a section with keys is expected"
KINDS = {
    "float": "a number is expected",
    "int": "a whole number is expected",
    "bool": "true or false is expected",
    "string": "text is expected",
    "path": "a path is expected",
    "tuple": "a list is expected",
    "list": "a list is expected",
    "dict": SECTION,
    "mapping": SECTION,
    "model": SECTION,
}
"""What is expected, by the first word of the types of pydantic's errors that say that a value is of another kind."""
MAY_BE_NUMBERS = ("float", "int", "model")
OTHER_KIND = re.compile(rf"({'|'.join(KINDS)})_(type|parsing|parsing_size|from_float)")
ENTRIES = {"too_short": ("at least", "min_length"), "too_long": ("at most", "max_length")}
OF_KEY = "[key]"
"""What pydantic puts behind a location where the key itself is wrong, not what stands under it."""
MOST_KEYS = 8
"""Keys of a section that a line names."""


def words(problem: "ErrorDetails", model: type[BaseModel]) -> str:
    """The problem in a user's words."""
    kind, given = OTHER_KIND.fullmatch(problem["type"]), problem["input"]
    if problem["loc"][-1:] == (OF_KEY,):
        return f'this key must be text: write "{given}"'
    if isinstance(given, str) and kind and KINDS[kind[1]] == SECTION and (parts := unspaced(given)):
        return space_needed(*parts)
    if kind and kind[1] == "string" and isinstance(given, bool | int | float):
        return "text is expected: put it in quotation marks"
    if problem["type"] in ENTRIES:
        least, limit = ENTRIES[problem["type"]]
        number = problem["ctx"][limit]
        return f"{least} {number} {'entry is' if number == 1 else 'entries are'} expected"
    if kind is None:
        text = problem["msg"].removeprefix("Value error, ")
        return text[:1].lower() + text[1:]
    comma = COMMA.fullmatch(given) if isinstance(given, str) and kind[1] in MAY_BE_NUMBERS else None
    if comma:
        return f"a decimal point is expected: {comma[1]}.{comma[2]}"
    return KINDS[kind[1]] + (_keys_of_section(problem, model) if kind[1] == "model" else "")


def meant(problems: Iterable["ErrorDetails"], model: type[BaseModel]) -> Iterator[Found]:
    """The problems with the locations of their keys. Where a value may be of several kinds, pydantic tells why it is
    none of them: only what the kind lacks is kept that the value is nearest to."""
    kinds: dict[Location, dict[str, list[Found]]] = {}
    for number, problem in enumerate(problems):
        location, at, kind = _own(problem["loc"], model)
        place, name = ((number,), "") if kind is None else (at, kind)
        kinds.setdefault(place, {}).setdefault(name, []).append((location, problem))
    for found in kinds.values():
        yield from min(found.values(), key=_distance)


def annotations_at(model: Any, location: Location) -> list[Any]:
    """What may stand at the location of a key: the types that the model gives it."""
    found = [model]
    for part in location:
        found = [inner for one in found for inner in _inside(one, part)]
    return [choice for one in found for choice in _choices(one)]


def allows_section(annotations: Iterable[Any]) -> bool:
    """Whether a section or a list may stand where these types may."""
    return any(_is_model(one) or get_origin(one) is tuple or _is_mapping(one) for one in annotations)


def misread(model: type[BaseModel], content: object) -> Iterator[tuple[Location, str]]:
    """Words in a YAML content that stand where a number is expected, and are another one in YAML 1.1 than they look
    like: 015, 1:30, 1_000."""
    yield from _misread(content, (), [model])


def _misread(content: object, location: Location, found: list[Any]) -> Iterator[tuple[Location, str]]:
    choices = [choice for one in found for choice in _choices(one)]
    if isinstance(content, AsWritten) and not any(
        one in (str, Path, Any) or get_origin(one) is Literal for one in choices
    ):
        yield location, f"a plain number is expected: write {content.decimal} (it is {content})"
    if Any in choices or not isinstance(content, Mapping | list):
        return
    for part, value in content.items() if isinstance(content, Mapping) else enumerate(content):
        own = part if isinstance(part, int) else str(part)
        yield from _misread(value, (*location, own), [inner for one in choices for inner in _inside(one, own)])


def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """A model's fields by the keys that a file has for them."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def may_be_none(field: FieldInfo) -> bool:
    """Whether a field takes null for a value."""
    return NoneType in get_args(field.annotation)


def location_of(problem: "ErrorDetails", model: type[BaseModel]) -> Location:
    """A problem's location without pydantic's names of kinds."""
    return _own(problem["loc"], model)[0]


def _own(location: Location, model: type[BaseModel]) -> tuple[Location, Location, str | None]:
    """A problem's location without pydantic's names of kinds, and the first place at which such a name stood, with the
    name."""
    own: Location = ()
    named: tuple[Location, str | None] = ((), None)
    found: list[Any] = [model]
    several = False
    for part in location:
        if part == OF_KEY:
            continue
        if several and isinstance(part, str):
            named = named if named[1] else (own, part)
            several = False
            continue
        found = [inner for one in found for inner in _inside(one, part)]
        own = (*own, part)
        several = any(len(_choices(one)) > 1 for one in found)
    return own, *named


def _distance(found: list[Found]) -> tuple[int, bool, int]:
    """How far a value is from a kind with these problems: those that lie deeper in it, or are not of kind, are nearer;
    so are lists that may be longer."""
    deepest = max(len(location) for location, _ in found)
    other = all(OTHER_KIND.fullmatch(problem["type"]) for _, problem in found)
    longest = max(int(problem.get("ctx", {}).get("max_length", 0)) for _, problem in found)
    return -deepest, other, -longest


def _keys_of_section(problem: "ErrorDetails", model: type[BaseModel]) -> str:
    sections = [one for one in annotations_at(model, location_of(problem, model)) if _is_model(one)]
    fields = fields_of(sections[0]) if sections else {}
    needed = [name for name, field in fields.items() if field.is_required()]
    number = isinstance(problem["input"], int | float) and not isinstance(problem["input"], bool)
    if number and len(needed) == 1 and float in annotations_at(sections[0], (needed[0],)):
        return f": {{{needed[0]}: {problem['input']}}}"
    return f": {', '.join(fields)}" if 0 < len(fields) <= MOST_KEYS else ""


def _inside(annotation: Any, part: int | str) -> Iterator[Any]:
    """The types of a key, or entry, of what an annotation says."""
    for one in _choices(annotation):
        if _is_model(one):
            yield from (field.annotation for name, field in fields_of(one).items() if name == part)
        elif isinstance(part, int):
            yield from (inner for inner in get_args(one) if inner is not Ellipsis)
        elif _is_mapping(one):
            yield get_args(one)[1]


def _choices(annotation: Any) -> list[Any]:
    """The types that an annotation allows, beside none."""
    if get_origin(annotation) is Annotated:
        return _choices(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [inner for one in get_args(annotation) for inner in _choices(one) if inner is not NoneType]
    return [annotation]


def _is_mapping(annotation: Any) -> bool:
    return isinstance(get_origin(annotation), type) and issubclass(get_origin(annotation), Mapping)


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
