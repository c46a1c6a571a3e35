"""Plugins' settings in a site file: checked against what each plugin takes, and asked whether they tell the scale."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from pydantic import ValidationError

from savmap.errors import PluginError, SavmapError, SiteError
from savmap.io.overrides import Location
from savmap.io.siteplaces import Places, explained
from savmap.rooms import load_class
from savmap.site import Site


def settings_problems(site: Site, plugins: Sequence[str], places: Places) -> Iterator[SavmapError]:
    """What is wrong with the plugins that are named, and with their settings for all rows and for each; each once."""
    told = set[str]()
    for name in dict.fromkeys(plugins):
        for problem in _of_plugin(site, name, places):
            if str(problem) not in told:
                told.add(str(problem))
                yield problem


def _of_plugin(site: Site, name: str, places: Places) -> Iterator[SavmapError]:
    try:
        config = load_class(name).Config
    except PluginError as error:
        named = ("plugins", name)
        yield PluginError(f"{places.of(named)}: {error}") if named in places.lines else error
        return
    for row in site.rows:
        try:
            config.model_validate(site.row_config(row, name))
        except ValidationError as error:
            yield from map(SiteError, explained(error, config, places, partial(_given, site, row, name)).values())


def _given(site: Site, row: str, plugin: str, location: Location) -> Location:
    """Where in the site file a plugin's setting was given: with the row or for all of them."""
    own = site.rows[row].plugins.get(plugin, {})
    return (*(("rows", row) if location and location[0] in own else ()), "plugins", plugin, *location)


def tells_scale(site: Site, row: str, plugins: Sequence[str]) -> bool:
    """Whether anything is given that might fix a row's scale: a reference, or a setting that its plugin says may do so."""
    known = site.row_references(row)
    settings = any(_scale_settings(site.row_config(row, name), name) for name in plugins)
    return settings or bool(known.camera_height_m or known.lengths or known.markers or len(known.points) > 1)


def _scale_settings(config: Mapping[str, Any], plugin: str) -> bool:
    """Whether any of a plugin's `scale_settings`, or any setting where it does not name them, is given."""
    named = getattr(load_class(plugin), "scale_settings", config)
    return any(config.get(key) is not None for key in named)
