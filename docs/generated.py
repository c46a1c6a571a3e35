"""Pages of the documentation that are made from the code when the site is built: all settings of a site file, and all commands."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

from savmap.cli.app import app
from savmap.site.schema import schema_text

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

PLUGINS = ("shelves", "lights", "signs")
"""Those that come with savmap, and whose settings are documented."""
LIMITS = {"exclusiveMinimum": "more than", "minimum": "at least", "exclusiveMaximum": "less than", "maximum": "at most"}
Schema = Mapping[str, Any]

SETTINGS = """# Settings

All keys of a [site file](../site-file.md) and of the plugins that come with savmap, from the code. `savmap schema site` prints them as a JSON
Schema for editors; [site.schema.json](../site.schema.json) is the published one.
"""
COMMANDS = """# Command line

All commands with their arguments and options, from the code. Every command ends with one of the [exit codes](../exit-codes.md).
"""


def on_files(files: "Files", config: "MkDocsConfig") -> "Files":
    """Add the generated pages (a hook of mkdocs)."""
    from mkdocs.structure.files import File

    for path, text in (("reference/settings.md", settings_page()), ("reference/command-line.md", commands_page())):
        files.append(File.generated(config, path, content=text))
    return files


def settings_page() -> str:
    """A table for every bay of a site file, in the order in which they refer to one another."""
    schema = json.loads(schema_text(PLUGINS))
    definitions = {"Site": schema, **schema["$defs"]}
    return "\n".join([SETTINGS, *(_section(name, definitions[name]) for name in _order(definitions))])


def _order(definitions: Mapping[str, Schema]) -> list[str]:
    """The site, what it refers to, what these refer to, and so on."""
    names = ["Site"]
    for name in names:
        names += [reference for reference in _references(definitions[name]) if reference not in names]
    return names


def _references(schema: Any) -> list[str]:
    if isinstance(schema, Mapping):
        inner = [name for key, value in schema.items() if key != "$defs" for name in _references(value)]
        return list(dict.fromkeys(([schema["$ref"].removeprefix("#/$defs/")] if "$ref" in schema else []) + inner))
    if isinstance(schema, list):
        return list(dict.fromkeys(name for value in schema for name in _references(value)))
    return []


def _section(name: str, schema: Schema) -> str:
    required = schema.get("required", ())
    rows = [
        f"| `{key}` | {_kind(value)} | {_default(key, value, required)} | {_prose(value.get('description', ''))} |"
        for key, value in sorted(schema["properties"].items())
    ]
    title = f"Plugin `{name}`" if name in PLUGINS else _title(name)
    table = ["| key | value | default | meaning |", "| --- | --- | --- | --- |", *rows]
    return "\n".join([f"## {title} {{#{_anchor(name)}}}", "", _prose(schema.get("description", "")), "", *table, ""])


def _title(name: str) -> str:
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name.rpartition(".")[2])
    return words.strip().removesuffix(" bay").capitalize()


def _anchor(name: str) -> str:
    return name.lower().replace(".", "-")


def _prose(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _default(key: str, schema: Schema, required: Sequence[str]) -> str:
    if key in required:
        return "required"
    value = schema.get("default")
    return "" if value in (None, {}, [], "") or isinstance(value, dict) else f"`{json.dumps(value)}`"


def _kind(schema: Schema) -> str:
    """What a value may be, in words, with links to bays."""
    if "$ref" in schema:
        name = schema["$ref"].removeprefix("#/$defs/")
        return f"[{_title(name)}](#{_anchor(name)})"
    if "anyOf" in schema:
        kinds = [_kind(choice) for choice in schema["anyOf"] if choice.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    return _plain_kind(schema)


def _plain_kind(schema: Schema) -> str:
    kind = schema.get("type", "value")
    if kind == "array":
        inner = schema.get("items") or schema.get("prefixItems", [{}])[0]
        return f"list of {_kind(inner)}"
    if kind == "object":
        inner = schema.get("additionalProperties")
        properties = " or ".join(dict.fromkeys(_kind(value) for value in schema.get("properties", {}).values()))
        return f"by name: {properties or (_kind(inner) if isinstance(inner, dict) else 'values')}"
    limits = [f"{words} {schema[key]:g}" for key, words in LIMITS.items() if key in schema]
    return ", ".join([{"string": "text", "boolean": "true or false"}.get(str(kind), str(kind)), *limits])


def commands_page() -> str:
    """A bay for every command."""
    group: Any = typer.main.get_command(app)
    return "\n".join([COMMANDS, *_commands(group, group.context_class(group, info_name="savmap"))])


def _commands(group: Any, context: Any) -> Iterator[str]:
    for name, command in group.commands.items():
        inner = command.context_class(command, info_name=name, parent=context)
        if hasattr(command, "commands"):
            yield from _commands(command, inner)
        else:
            text = command.get_help(inner)
            yield f"## {inner.command_path}\n\n```text\n{text}\n```\n"
