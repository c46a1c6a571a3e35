"""Checking what a file says against a pydantic model, with one line for the first thing that is wrong."""

from typing import TypeVar

from pydantic import BaseModel, ValidationError

from savmap.errors import OutputError

Model = TypeVar("Model", bound=BaseModel)


def checked(model: type[Model], content: object, where: str) -> Model:
    """`content` as `model`. Raises OutputError: `where`, the path inside it, and what is wrong there."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise OutputError(f"{where}: {one_line(error)}") from error


def one_line(error: ValidationError) -> str:
    """The first problem as "path: what", and how many more there are."""
    problems = error.errors(include_url=False, include_context=False)
    first = problems[0]
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    text = first["msg"].removeprefix("Value error, ")
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{path}: {text}{more}" if path else f"{text}{more}"
