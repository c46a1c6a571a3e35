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
    variables = sorted(name for name in environment if name.startswith(PREFIX))
    return (
        *(_from_variable(name, environment[name]) for name in variables),
        *(_from_option(option) for option in options),
    )


def applied(content: Mapping[str, Any], overrides: Iterable[Override]) -> tuple[dict[str, Any], dict[Location, str]]:
    """A site's content with overrides applied, and which of its keys they set, with the places where they were said.

    Keys that are there are found whatever their case, where only one fits. Raises SiteError naming the override for a
    row, or an entry of a list, that is not there.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(content))
    places: dict[Location, str] = {}
    for one in overrides:
        location = _set(changed, one)
        places.pop(location, None)
        places[location] = one.place
    return changed, places


def _from_variable(name: str, text: str) -> Override:
    _require_short(name)
    keys = tuple(name.removeprefix(PREFIX).split("__"))
    if not all(keys):
        raise SiteError(f"{name}: put two underscores between keys, such as {PREFIX}ROWS__A__FPS")
    return Override(name, tuple(key.lower() for key in keys), _value(text))


def _from_option(option: str) -> Override:
    path, equals, text = option.partition("=")
    path = path.strip()
    _require_short(f"--set {path}")
    found = list(KEYS.finditer(path))
    if not equals or not found or "".join(one.group() for one in found) != path:
        raise SiteError(f"--set {option}: give a key and its value, such as rows.A.fps=5")
    place = f"--set {path}"
    return Override(place, tuple(next(filter(None, one.groups())) for one in found), _value(text))


def _require_short(place: str) -> None:
    if len(place) > MOST_LETTERS:
        raise SiteError(f"{place[:60]}...: the key has more than {MOST_LETTERS} letters")


def _value(text: str) -> Any:
    """What a text means as YAML; the text itself where it is none, such as `[A-Z]+`: its key then tells what is wrong
    with it."""
    try:
        return yaml_text.load(text)
    except yaml_text.YamlError:
        return text


def _set(content: dict[str, Any], one: Override) -> Location:
    """Set one value in `content`, or take its key away where it is null; the location of the key."""
    location: Location = ()
    inside: Any = content
    for key in one.keys[:-1]:
        own = _key(inside, key, location, one)
        location = _within(location, inside, own)
        if isinstance(inside, MutableMapping) and inside.get(own) is None:
            inside[own] = {}
        inside = inside[own]
    last = _key(inside, one.keys[-1], location, one)
    if one.value is None and isinstance(inside, MutableMapping):
        inside.pop(last, None)
    else:
        inside[last] = one.value
    return _within(location, inside, last)


def _within(location: Location, inside: Any, own: Any) -> Location:
    return *location, own if isinstance(inside, list) else str(own)


def _key(inside: Any, key: str, location: Location, one: Override) -> Any:
    """The key of a section, or number in a list, that an override means."""
    if isinstance(inside, list):
        return _number(inside, key, location, one)
    if not isinstance(inside, MutableMapping):
        raise SiteError(f"{one.place}: {_text(location)} is a value, {inside!r}, and has no keys")
    names = {own: str(own) for own in inside}
    exact = [own for own, name in names.items() if name == key]
    near = exact or [own for own, name in names.items() if name.lower() == key.lower()]
    if len(near) > 1:
        raise SiteError(f"{one.place}: {key} may be {' or '.join(map(str, near))}; use --set")
    if not near and location == ("rows",):
        raise SiteError(f"{one.place}: there is no row `{key}`; rows are {', '.join(names.values())}")
    return near[0] if near else key


def _number(inside: list[Any], key: str, location: Location, one: Override) -> int:
    if not key.isdigit() or int(key) >= len(inside):
        raise SiteError(f"{one.place}: {_text(location)} is a list; its entries are 0 to {len(inside) - 1}, not {key}")
    return int(key)


def _text(location: Location) -> str:
    return f"`{'.'.join(map(str, location))}`"
