"""Templates filled with records: the page and the figures."""

import base64
import hashlib
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from savmap.errors import visible
from savmap.report.scene import swatch

REPORT = "savmap.report"


def rendered(template: str, package: str = REPORT, **values: Any) -> str:
    """A template of a package, or of the report, filled, as text that can be encoded."""
    text = _environment(package).get_template(template).render(values)
    return "\n".join(visible(line.replace("\t", " ")) for line in text.split("\n"))


def rendered_page(template: str, package: str = REPORT, **values: Any) -> str:
    """A template of a whole page filled. It loads nothing, and only its own script may run in it (by its digest)."""
    script, style = resource("page.js"), resource("figure.css") + resource("page.css")
    return rendered(template, package, style=Markup(style), script=Markup(script), digest=digest(script), **values)


def digest(text: str) -> str:
    """SHA-256 of a text as base64, as a page's policy names it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def jpeg_address(content: bytes) -> str:
    """A JPEG as an address that needs no file."""
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode()}"


def resource(name: str) -> str:
    """A file that lies beside the templates."""
    return (files(REPORT) / "templates" / name).read_text(encoding="utf-8")


@cache
def _environment(package: str) -> Environment:
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in dict.fromkeys((package, REPORT))]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["swatch"] = swatch
    return environment
