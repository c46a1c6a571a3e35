"""Content of files checked against pydantic models: for each mistake one line in a user's words, at the value's key,
and of the kinds of value that may stand there about the one that was meant."""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from reprlib import Repr
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ValidationError
from pydantic.fields import FieldInfo

from savmap.errors import OutputError, SiteError
from savmap.files.texts import readings
from savmap.files.yaml_text import Location as Location
from savmap.files.yaml_text import space_needed, unspaced

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

UNKNOWN = ("extra_forbidden", "invalid_key")
SHORT = Repr()
SHORT.maxstring = SHORT.maxother = 80
SHORT.maxlevel = 2
UNITS = ("m", "mm", "cm", "s", "ms", "deg", "rad", "px", "fps")
PLAIN = re.compile(r"\s*[+-]?\d+\s*")
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
MOST_KEYS = 8
"""Keys of a section that a line names."""
Model = TypeVar("Model", bound=BaseModel)
Located = tuple[Location, "ErrorDetails"]


def _with_text_keys(value: object) -> object:
    return {str(key): name for key, name in value.items()} if isinstance(value, Mapping) else value


ClassNames = Annotated[Mapping[str, str], BeforeValidator(_with_text_keys)]
"""A plugin's setting `class_names`: the plugin's names for its network's classes, which are given by name or by number
from 0."""


def checked(model: type[Model], content: object, where: str) -> Model:
    """`content` as `model`. Raises OutputError with one line: `where`, the path inside it, and what is wrong there."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise OutputError(one_line(error, model, where)) from error


def validated(model: type[Model], values: Mapping[str, Any], where: str) -> Model:
    """A model made from values. Raises SiteError with one line that says what is wrong, and where."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise SiteError(one_line(error, model, where)) from None


def one_line(error: ValidationError, model: type[BaseModel], where: str) -> str:
    """The first problem of a validation error, in a user's words, and how many more there are."""
    first, *others = explained(error, model, lambda *_: where).values()
    return f"{first} (and {len(others)} more)" if others else first


def path_of(location: Location) -> str:
    """A location in the content as a path: "rows.A.passes[0].fps"."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return "".join(parts).lstrip(".")


def explained(
    error: ValidationError,
    model: type[BaseModel],
    place_of: Callable[[Location, bool], str],
    at: Callable[[Location], Location] = tuple,
) -> dict[Location, str]:
    """A line for each problem of a validation error, by its location in the file, unknown keys first.

    `at` gives a model key's location in the file. `place_of` gives the text for a location; its second argument is
    whether the problem concerns the whole section there.
    """
    problems = sorted(error.errors(), key=lambda problem: problem["type"] not in UNKNOWN)
    first: dict[Location, ErrorDetails] = {}
    for location, problem in _meant(problems, model):
        follows = problem["type"] == "too_short" and any(
            inner is not problem and inner["loc"][: len(problem["loc"])] == problem["loc"] for inner in problems
        )
        if not follows:
            first.setdefault(at(location), problem)
    return {location: _explained(problem, location, model, place_of) for location, problem in first.items()}


def annotations_at(model: Any, location: Location) -> list[Any]:
    """What may stand at the location of a key: the types that the model gives it."""
    kinds = _choices(model)
    for part in location:
        kinds = [choice for kind in kinds for inner in _inside(kind, part) for choice in _choices(inner)]
    return kinds


def allows_section(annotations: Iterable[Any]) -> bool:
    """Whether a section or a list may stand where these types may."""
    return any(is_model(kind) or get_origin(kind) is tuple or _is_mapping(kind) for kind in annotations)


def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """A model's fields by the keys that a file has for them."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def may_be_none(field: FieldInfo) -> bool:
    """Whether a field takes null for a value."""
    return NoneType in get_args(field.annotation)


def is_model(annotation: Any) -> bool:
    """Whether a type is a section with keys."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _explained(
    problem: "ErrorDetails", location: Location, model: type[BaseModel], place_of: Callable[[Location, bool], str]
) -> str:
    key, kinds = path_of(location), annotations_at(model, _located(problem["loc"], model)[0])
    place = place_of(location, problem["type"] == "value_error")
    if problem["type"] in UNKNOWN:
        sections = annotations_at(model, _located(problem["loc"], model)[0][:-1])
        allowed = [name for section in sections if is_model(section) for name in fields_of(section)]
        return f"{place}: unknown key `{key}`{_hint(str(location[-1]), allowed)}"
    if problem["type"] == "missing":
        return f"{place}: `{key}` is missing"
    text = _words(problem, kinds)
    if problem["type"] == "value_error":
        return f"{place}: `{key}`: {text}" if key else f"{place}: {text}"
    units = "; lengths are metres, times seconds" if _is_number(problem["input"]) and float in kinds else ""
    given = "it has no value" if problem["input"] is None else f"it is {SHORT.repr(problem['input'])}"
    return f"{place}: `{key}`: {text} ({given}{units})"


def _words(problem: "ErrorDetails", kinds: list[Any]) -> str:
    """The problem in a user's words."""
    kind, given = OTHER_KIND.fullmatch(problem["type"]), problem["input"]
    if problem["type"] in ENTRIES:
        least, limit = ENTRIES[problem["type"]]
        number = problem["ctx"][limit]
        return f"{least} {number} {'entry is' if number == 1 else 'entries are'} expected"
    if kind is None:
        text = problem["msg"].removeprefix("Value error, ")
        return text[:1].lower() + text[1:]
    if kind[1] == "string" and isinstance(given, bool | int | float):
        return "text is expected: put it in quotation marks"
    if isinstance(given, str) and KINDS[kind[1]] == SECTION and (parts := unspaced(given)):
        return space_needed(*parts)
    numbers = readings(given.strip()) if isinstance(given, str) and not PLAIN.fullmatch(given) else {}
    if numbers and kind[1] in MAY_BE_NUMBERS:
        written = " or ".join(dict.fromkeys(f"{numbers[mark]:.12g}" for mark in (",", ".") if mark in numbers))
        return f"a decimal point is expected: {written}"
    return KINDS[kind[1]] + (_keys_of_section(given, kinds) if kind[1] == "model" else "")


def _meant(problems: Iterable["ErrorDetails"], model: type[BaseModel]) -> Iterator[Located]:
    """The problems with the locations of their keys. Where a value may be of several kinds, pydantic says why it is
    none of them: only what the kind lacks is kept that the value is nearest to."""
    kinds: dict[Location, dict[str, list[Located]]] = {}
    for number, problem in enumerate(problems):
        location, at, kind = _located(problem["loc"], model)
        place, name = ((number,), "") if kind is None else (at, kind)
        kinds.setdefault(place, {}).setdefault(name, []).append((location, problem))
    for candidates in kinds.values():
        yield from min(candidates.values(), key=_distance)


def _located(location: Location, model: type[BaseModel]) -> tuple[Location, Location, str | None]:
    """A problem's location without pydantic's names of kinds, and the first place at which such a name stood, with the
    name."""
    keys: Location = ()
    named: tuple[Location, str | None] = ((), None)
    kinds: list[Any] = [model]
    several = False
    for part in location:
        if several and isinstance(part, str):
            named = named if named[1] else (keys, part)
            several = False
            continue
        inner = [_choices(annotation) for kind in kinds for annotation in _inside(kind, part)]
        kinds = [choice for choices in inner for choice in choices]
        keys = (*keys, part)
        several = any(len(choices) > 1 for choices in inner)
    return keys, *named


def _distance(problems: list[Located]) -> tuple[int, bool, int]:
    """How far a value is from a kind with these problems: those that lie deeper in it, or are not of kind, are nearer;
    so are lists that may be longer."""
    deepest = max(len(location) for location, _ in problems)
    other = all(OTHER_KIND.fullmatch(problem["type"]) for _, problem in problems)
    longest = max(int(problem.get("ctx", {}).get("max_length", 0)) for _, problem in problems)
    return -deepest, other, -longest


def _keys_of_section(given: object, kinds: list[Any]) -> str:
    section = next(filter(is_model, kinds), None)
    fields = fields_of(section) if section else {}
    needed = [name for name, field in fields.items() if field.is_required()]
    if _is_number(given) and len(needed) == 1 and float in annotations_at(section, (needed[0],)):
        return f": {{{needed[0]}: {given}}}"
    return f": {', '.join(fields)}" if 0 < len(fields) <= MOST_KEYS else ""


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _inside(kind: Any, part: int | str) -> Iterator[Any]:
    """The types that a type gives a key of it, or an entry."""
    if is_model(kind):
        yield from (field.annotation for name, field in fields_of(kind).items() if name == part)
    elif isinstance(part, int):
        yield from (inner for inner in get_args(kind) if inner is not Ellipsis)
    elif _is_mapping(kind):
        yield get_args(kind)[1]


def _choices(annotation: Any) -> list[Any]:
    """The types that an annotation allows, beside none."""
    if get_origin(annotation) is Annotated:
        return _choices(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [inner for kind in get_args(annotation) for inner in _choices(kind) if inner is not NoneType]
    return [annotation]


def _is_mapping(annotation: Any) -> bool:
    return isinstance(get_origin(annotation), type) and issubclass(get_origin(annotation), Mapping)


def _hint(key: str, allowed: list[str]) -> str:
    if key.isdigit():
        return ": is it from a number with a decimal comma? A decimal point is expected, such as 2.5"
    stem = key.rsplit("_", 1)
    same_stem = [name for name in allowed if name.rsplit("_", 1)[0] == stem[0] and name != key]
    if len(stem) == 2 and stem[1] in UNITS and same_stem:
        return f": wrong unit? Use `{same_stem[0]}`"
    near = difflib.get_close_matches(key, allowed, 1)
    if near:
        return f": did you mean `{near[0]}`?"
    return f": allowed here are {', '.join(allowed)}" if allowed else ""
