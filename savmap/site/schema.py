"""The JSON Schema of site files, with the settings of plugins, by which editors complete and check them."""

import json
import re
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from savmap.plugin.manager import load_class
from savmap.site.model import Site

TITLE = "savmap site file"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


class Untitled(GenerateJsonSchema):
    """Leaves out titles that only repeat keys."""

    def field_title_should_be_set(self, schema: object) -> bool:
        return False


def schema_text(plugins: Iterable[str]) -> str:
    """The JSON Schema of a site file, with the settings of the named plugins. Other plugins may stand in a file too,
    with any settings. Raises PluginError for one that is not installed."""
    schema = Site.model_json_schema(schema_generator=Untitled)
    settings = {name: _settings(name, load_class(name).Config, schema["$defs"]) for name in plugins}
    for section in (schema, schema["$defs"]["Row"]):
        section["properties"]["plugins"] |= {
            "type": "object",
            "properties": settings,
            "additionalProperties": {"type": ["object", "null"]},
        }
    text = json.dumps({"$schema": DIALECT, **schema, "title": TITLE}, indent=2, sort_keys=True) + "\n"
    return re.sub(r"(\\n)+", " ", text)  # line ends of docstrings


def _settings(name: str, config: type[BaseModel], definitions: dict[str, Any]) -> dict[str, Any]:
    """A plugin's settings, or nothing, by reference: its models go into `definitions` with the plugin's name before
    them."""
    schema = config.model_json_schema(ref_template=f"#/$defs/{name}.{{model}}", schema_generator=Untitled)
    inner = schema.pop("$defs", {})
    definitions.update({f"{name}.{key}": value for key, value in inner.items()})
    definitions[name] = schema
    return {"anyOf": [{"$ref": f"#/$defs/{name}"}, {"type": "null"}]}
