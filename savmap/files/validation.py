"""Content of files checked against pydantic models: for each mistake one line in a user's words, at the value's key."""

import difflib
import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from reprlib import Repr
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ValidationError

from savmap.errors import OutputError, SiteError
from savmap.files.yaml_text import Location as Location

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

UNKNOWN = ("extra_forbidden", "invalid_key", "unexpected_keyword_argument")
SHORT = Repr()
SHORT.maxstring = SHORT.maxother = 80
SHORT.maxlevel = 2
SECTION = "a section with keys is expected"
KINDS = {
    "float": "a number is expected",
    "int": "a whole number is expected",
    "bool": "true or false is expected",
    "string": "text is expected",
    "path": "a path is expected",
    "tuple": "a list is expected",
    "list": "a list is expected",
    **dict.fromkeys(("dict", "mapping", "model", "dataclass"), SECTION),
}
"""What is expected, by the first word of the types of pydantic's errors that say that a value is of another kind."""
OTHER_KIND = re.compile(rf"({'|'.join(KINDS)})_(type|parsing|parsing_size|from_float)")
LIMIT = re.compile("(greater|less)_than(_equal)?")
ENTRIES = {"too_short": ("at least", "min_length"), "too_long": ("at most", "max_length")}
MOST_KEYS = 8
"""Keys of a section that a line names."""
Model = TypeVar("Model", bound=BaseModel)
Schema = Mapping[str, Any]


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
    schema = schema_of(model)
    problems = [(_keys(problem, schema), problem) for problem in error.errors()]
    inner = {keys[:length] for keys, _ in problems for length in range(len(keys))}
    lines: dict[Location, str] = {}
    for keys, problem in sorted(problems, key=_likeliest):
        if keys not in inner:  # otherwise it is of another kind, of several, than the one that was meant
            location = at(keys)
            lines.setdefault(location, _explained(problem, location, keys, schema, place_of))
    return lines


@cache
def schema_of(model: type[BaseModel]) -> Schema:
    """A model's JSON Schema."""
    return model.model_json_schema()


def kinds_at(schema: Schema, location: Location) -> list[Schema]:
    """What may stand at a location by a model's JSON Schema: a schema for each kind of value; one without a type:
    anything."""
    kinds = list(_kinds(schema, schema))
    for part in location:
        kinds = [kind for section in kinds for inner in _inside(section, part) for kind in _kinds(inner, schema)]
    return kinds


def _kinds(node: Any, schema: Schema) -> Iterator[Schema]:
    if node is True:
        yield {}
    elif "$ref" in node:
        yield from _kinds(schema["$defs"][node["$ref"].rpartition("/")[2]], schema)
    elif "anyOf" in node:
        for choice in node["anyOf"]:
            yield from _kinds(choice, schema)
    elif node.get("type") != "null":
        yield node


def _inside(section: Schema, part: int | str) -> Iterator[Any]:
    if "type" not in section:
        yield section
    elif isinstance(part, int):
        items = section.get("items")
        yield from section["prefixItems"][part : part + 1] if "prefixItems" in section else [items] if items else ()
    elif (inner := section.get("properties", {}).get(part, section.get("additionalProperties"))) not in (None, False):
        yield inner


def _keys(problem: "ErrorDetails", schema: Schema) -> Location:
    """A problem's location without pydantic's names of kinds."""
    keys: Location = ()
    for part in problem["loc"]:
        if kinds_at(schema, (*keys, part)):
            keys = (*keys, part)
    return (*keys, problem["loc"][-1]) if problem["type"] in UNKNOWN else keys


def _likeliest(problem_at: tuple[Location, "ErrorDetails"]) -> tuple[bool, bool, int]:
    """Unknown keys first; of one value that several kinds refuse, what a kind says that it is of, the longest list."""
    _, problem = problem_at
    return (
        problem["type"] not in UNKNOWN,
        bool(OTHER_KIND.fullmatch(problem["type"])),
        -int(problem.get("ctx", {}).get("max_length", 0)),
    )


def _explained(
    problem: "ErrorDetails",
    location: Location,
    keys: Location,
    schema: Schema,
    place_of: Callable[[Location, bool], str],
) -> str:
    key, given, kind = path_of(location), problem["input"], problem["type"]
    place = place_of(location, kind == "value_error")
    if kind in UNKNOWN:
        allowed = [name for section in kinds_at(schema, keys[:-1]) for name in section.get("properties", ())]
        near = difflib.get_close_matches(str(keys[-1]), allowed, 1)
        hint = f": did you mean `{near[0]}`?" if near else f": allowed here are {', '.join(allowed)}" if allowed else ""
        return f"{place}: unknown key `{key}`{hint}"
    if kind == "missing":
        return f"{place}: `{key}` is missing"
    if kind in ENTRIES:
        least, limit = ENTRIES[kind]
        count = problem["ctx"][limit]
        text = f"{least} {count} {'entry is' if count == 1 else 'entries are'} expected"
    elif other := OTHER_KIND.fullmatch(kind):
        names = [name for section in kinds_at(schema, keys) for name in section.get("properties", ())]
        text = KINDS[other[1]]
        text += f": {', '.join(names)}" if text == SECTION and 0 < len(names) <= MOST_KEYS else ""
    else:
        text = problem["msg"].removeprefix("Value error, ")
        text = text[:1].lower() + text[1:]
    if kind == "value_error":
        return f"{place}: `{key}`: {text}" if key else f"{place}: {text}"
    number = LIMIT.fullmatch(kind) and any(inner.get("type") == "number" for inner in kinds_at(schema, keys))
    units = "; lengths are metres, times seconds" if number else ""
    return f"{place}: `{key}`: {text} ({'it has no value' if given is None else f'it is {SHORT.repr(given)}'}{units})"
