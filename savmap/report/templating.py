"""Templates filled with records: the page and the figures."""

from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from savmap.errors import visible
from savmap.report.scene import swatch


def rendered(template: str, **values: Any) -> str:
    """A template filled, as text that can be encoded."""
    text = _environment().get_template(template).render(values)
    return "\n".join(visible(line.replace("\t", " ")) for line in text.split("\n"))


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
