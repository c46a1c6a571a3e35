"""Checking what a file says against a pydantic model, with one line for the first thing that is wrong."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, TypeVar

from pydantic import BaseModel, BeforeValidator, ValidationError

from savmap.errors import OutputError

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

Model = TypeVar("Model", bound=BaseModel)


def _with_text_keys(value: object) -> object:
    return {str(key): name for key, name in value.items()} if isinstance(value, Mapping) else value


ClassNames = Annotated[Mapping[str, str], BeforeValidator(_with_text_keys)]
"""A plugin's setting `class_names`: what its network's classes, by name or by number from 0, are called by the plugin."""


def checked(model: type[Model], content: object, where: str) -> Model:
    """`content` as `model`. Raises OutputError: `where`, the path inside it, and what is wrong there."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise OutputError(f"{where}: {one_line(error)}") from error


def path_of(problem: "ErrorDetails") -> str:
    """Where in the content a problem is: "rows.A.passes[0].fps"."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in problem["loc"])
    return "".join(parts).lstrip(".")


def text_of(problem: "ErrorDetails") -> str:
    """What is wrong, in pydantic's words."""
    return problem["msg"].removeprefix("Value error, ")


def one_line(error: ValidationError) -> str:
    """The first problem as "path: what", and how many more there are."""
    problems = error.errors(include_url=False, include_context=False)
    path, text = path_of(problems[0]), text_of(problems[0])
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{path}: {text}{more}" if path else f"{text}{more}"
