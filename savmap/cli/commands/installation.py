"""Commands about savmap itself: which plugins it has, which files it takes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.speech import say


def plugins() -> None:
    """List the installed plugins."""
    for line in plugin_lines():
        say(line)


def schema(name: Annotated[str, typer.Argument(metavar="site|map", help="Which kind of file.")]) -> None:
    """Print the JSON Schema of site files or maps."""
    typer.echo(schema_of(name), nl=False)


def plugin_lines() -> Iterator[str]:
    """What is installed: name, classes, model, hooks; of a plugin that cannot be used, the reason."""
    from savmap.plugin.manager import installed, lacking, load_installed
    from savmap.plugin.protocol import implements

    loaded, laboratory = load_installed(), installed("savmap.lab")
    for name, point in installed().items():
        yield f"{name}  ({point.value})"
        if name in loaded.broken:
            yield f"  broken   {loaded.broken[name]}"
            continue
        plugin = loaded.classes[name]
        hooks = sorted(hook for hook in dir(plugin) if implements(plugin, hook))
        yield f"  classes  {', '.join(plugin.classes)}"
        yield f"  model    {plugin.model}"
        yield f"  network  {_network(plugin.model)}"
        yield f"  hooks    {', '.join(hooks)}"
        if name in laboratory:
            yield f"  lab      {laboratory[name].value}"
        if missing := lacking(plugin):
            names = ", ".join(missing)
            yield f"  lacks    {names}, without which it does less: pip install them, or savmap's extra of its name"


def _network(model: Path) -> str:
    """Of what kind a plugin's network is, and on what it runs; what is wrong with it where it cannot be read."""
    from savmap.errors import ModelError
    from savmap.vision.networks.segmenter import Segmenter, shortened

    try:
        network = Segmenter(model)
    except ModelError as error:
        return str(error)
    return f"{network}; gives {shortened(network.names)}"


def schema_of(name: str) -> str:
    """The JSON Schema of a kind of file: "site", with the settings of all installed plugins, or "map". Raises
    SiteError."""
    from savmap.errors import SiteError
    from savmap.maps.schema import schema_text as map_schema_text
    from savmap.plugin.manager import load_installed
    from savmap.site.schema import schema_text

    if name == "map":
        return map_schema_text()
    if name == "site":
        return schema_text(load_installed().classes)
    raise SiteError(f"schema {name}: there is one for `site` and one for `map`")
