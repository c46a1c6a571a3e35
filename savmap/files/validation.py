"""Content of files checked against pydantic models, with one line for the first mistake."""

import difflib
from collections.abc import Callable, Mapping
from reprlib import Repr
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ValidationError

from savmap.errors import OutputError, SiteError
from savmap.files.mistakes import OF_KEY, annotations_at, fields_of, location_of, meant, words
from savmap.files.mistakes import Location as Location

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

UNKNOWN = ("extra_forbidden", "invalid_key")
SHORT = Repr()
SHORT.maxstring = SHORT.maxother = 80
UNITS = ("m", "mm", "cm", "s", "ms", "deg", "rad", "px", "fps")
Model = TypeVar("Model", bound=BaseModel)


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


def path_of(location: Location) -> str:
    """A location in the content as a path: "rows.A.passes[0].fps"."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return "".join(parts).lstrip(".")


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
    for own, problem in meant(problems, model):
        follows = problem["type"] == "too_short" and any(
            inner is not problem and inner["loc"][: len(problem["loc"])] == problem["loc"] for inner in problems
        )
        if not follows:
            first.setdefault(at(own), problem)
    return {location: _explained(problem, location, model, place_of) for location, problem in first.items()}


def _explained(
    problem: "ErrorDetails", location: Location, model: type[BaseModel], place_of: Callable[[Location, bool], str]
) -> str:
    key = path_of(location)
    place = place_of(location, problem["type"] == "value_error")
    if problem["type"] in UNKNOWN:
        allowed = _keys(model, problem["loc"][:-1])
        return (
            f"{place}: unknown key `{path_of((*location[:-1], str(location[-1])))}`{_hint(str(location[-1]), allowed)}"
        )
    if problem["type"] == "missing":
        return f"{place}: `{key}` is missing"
    text = words(problem, model)
    if problem["type"] == "value_error":
        return f"{place}: `{key}`: {text}" if key else f"{place}: {text}"
    number = isinstance(problem["input"], int | float) and not isinstance(problem["input"], bool)
    measured = (
        number and problem["loc"][-1:] != (OF_KEY,) and float in annotations_at(model, location_of(problem, model))
    )
    units = "; lengths are metres, times seconds" if measured else ""
    return f"{place}: `{key}`: {text} ({_given(problem['input'])}{units})"


def _given(value: object) -> str:
    return "it has no value" if value is None else f"it is {SHORT.repr(value)}"


def _keys(model: Any, location: Location) -> list[str]:
    """The keys that the model allows at a location, by its field annotations."""
    current = model
    for part in location:
        inner = _models_in(current)
        fields = fields_of(inner) if inner else {}
        current = fields[part].annotation if isinstance(part, str) and part in fields else current
    inner = _models_in(current)
    return list(fields_of(inner)) if inner else []


def _models_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        model = _models_in(argument)
        if model:
            return model
    return None


def _hint(key: str, allowed: list[str]) -> str:
    if key.isdigit():
        return ": is it from a number with a decimal comma? A decimal point is expected, such as 2.5"
    stem = key.rsplit("_", 1)
    same_stem = [a for a in allowed if a.rsplit("_", 1)[0] == stem[0] and a != key]
    if len(stem) == 2 and stem[1] in UNITS and same_stem:
        return f": wrong unit? Use `{same_stem[0]}`"
    near = difflib.get_close_matches(key, allowed, 1)
    if near:
        return f": did you mean `{near[0]}`?"
    return f": allowed here are {', '.join(allowed)}" if allowed else ""
