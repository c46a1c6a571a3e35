"""Single keys of a site file set from outside: by `--set rows.A.fps=5`, and by variables such as
SAVMAP__ROWS__A__FPS=5.

The command line counts more than the environment, and both more than the file. Values are YAML, or else text; null
takes a key away.
"""

import copy
import re
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from savmap.errors import SiteError
from savmap.files import yaml_text
from savmap.files.validation import Location

MOST_LETTERS = 500
"""Of the keys of an override."""
PREFIX = "SAVMAP__"
KEYS = re.compile(r'(?:^|\.)(?:"(?P<quoted>[^"]+)"|(?P<plain>[^."\[\]=]+))|\[(?P<number>\d+)\]')


@dataclass(frozen=True)
class Override:
    """A value for the key at the end of `keys`, and where it was said: an option or a variable."""

    place: str
    keys: tuple[str, ...]
    value: Any


def overrides_of(options: Iterable[str], environment: Mapping[str, str]) -> tuple[Override, ...]:
    """Overrides in the order in which they are applied. Raises SiteError for one that cannot be understood."""
    overrides = []
    for name in sorted(name for name in environment if name.startswith(PREFIX)):
        keys = name.removeprefix(PREFIX).lower().split("__")
        if not all(keys) or len(name) > MOST_LETTERS:
            raise SiteError(f"{name:.60}: put two underscores between keys, such as {PREFIX}ROWS__A__FPS")
        overrides.append(Override(name, tuple(keys), _value(environment[name])))
    for option in options:
        path, equals, text = option.partition("=")
        matches = list(KEYS.finditer(path := path.strip())) if len(path) <= MOST_LETTERS else []
        if not equals or not matches or "".join(match.group() for match in matches) != path:
            raise SiteError(f"--set {option:.60}: give a key and its value, such as rows.A.fps=5")
        names = tuple(next(filter(None, match.groups())) for match in matches)
        overrides.append(Override(f"--set {path}", names, _value(text)))
    return tuple(overrides)


def applied(content: Mapping[str, Any], overrides: Iterable[Override]) -> tuple[dict[str, Any], dict[Location, str]]:
    """A site's content with overrides applied, and which of its keys they set, with the places where they were said.

    Keys that are there are matched whatever their case, where only one fits. Raises SiteError naming the override for a
    row, or an entry of a list, that is not there.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(content))
    places: dict[Location, str] = {}
    for override in overrides:
        location = _set(changed, override)
        places.pop(location, None)
        places[location] = override.place
    return changed, places


def _value(text: str) -> Any:
    """What a text means as YAML; the text itself where it is none, such as `[A-Z]+`: its key then tells what is wrong
    with it."""
    try:
        return yaml_text.load(text)
    except yaml_text.YamlError:
        return text


def _set(content: dict[str, Any], override: Override) -> Location:
    """Set one value in `content`, or take its key away where it is null; the location of the key."""
    location: Location = ()
    section: Any = content
    for key in override.keys[:-1]:
        name = _key(section, key, location, override)
        location = (*location, name)
        if isinstance(section, MutableMapping) and section.get(name) is None:
            section[name] = {}
        section = section[name]
    last = _key(section, override.keys[-1], location, override)
    if override.value is None and isinstance(section, MutableMapping):
        section.pop(last, None)
    else:
        section[last] = override.value
    return *location, last


def _key(section: Any, key: str, location: Location, override: Override) -> Any:
    """The key of a section, or number in a list, that an override means."""
    where = f"{override.place}: `{'.'.join(map(str, location))}`"
    if isinstance(section, list):
        if not key.isdigit() or int(key) >= len(section):
            raise SiteError(f"{where} is a list; its entries are 0 to {len(section) - 1}, not {key}")
        return int(key)
    if not isinstance(section, MutableMapping):
        raise SiteError(f"{where} is a value, {section!r}, and has no keys")
    near = [name for name in section if name == key] or [name for name in section if name.lower() == key.lower()]
    if len(near) > 1:
        raise SiteError(f"{override.place}: {key} may be {' or '.join(near)}; use --set")
    if not near and location == ("rows",):
        raise SiteError(f"{override.place}: there is no row `{key}`; rows are {', '.join(section)}")
    return near[0] if near else key
