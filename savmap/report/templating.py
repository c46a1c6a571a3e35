"""Templates filled with records: the page and the figures."""

from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from savmap.report.scene import swatch

# Neither HTML nor XML can hold control characters.
_CONTROLS = dict.fromkeys(code for code in (*range(32), *range(127, 160)) if code not in (9, 10))


def rendered(template: str, **values: Any) -> str:
    """A template filled, as text that can be encoded."""
    text = _environment().get_template(template).render(values)
    return text.translate(_CONTROLS).encode("utf-8", "replace").decode()


def resource(name: str) -> str:
    """A file that lies beside the templates."""
    return (files("savmap.report") / "templates" / name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("savmap.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["swatch"] = swatch
    return environment
