"""YAML that anybody may have written, within bounds, and with a line for each mistake.

Dates are read as text: none of our files holds one, and 2024-13-45 is not worth an error of its own.
"""

import re
from collections.abc import Iterable
from typing import Any, ClassVar

import yaml

from savmap.files.texts import SURROGATES

MOST_MB = 2.0
MOST_DEPTH = 50
PARSERS_DEPTH = "maximum nesting depth"
"""What newer versions of libyaml say of a text that is nested too deeply for itself; it reads ahead of the events, and
says so before their bound is passed."""
COLONS = ("could not find expected ':'", "mapping values are not allowed in this context")
"""What libyaml says of keys whose colon no space follows: of them and of the next line."""
MOST_VALUES = 100_000
"""With what aliases stand for: a site of 2000 rows has 60 000."""
MOST_LETTERS = 4000
LARGEST = 1e300
NO_TOKEN = "cannot start any token"
"""What libyaml says of a tab, with which YAML does not indent, and of some other characters, such as a backquote."""
TIMESTAMP = "tag:yaml.org,2002:timestamp"
TEXT = "tag:yaml.org,2002:str"
OTHERWISE_TEXT = {f"tag:yaml.org,2002:{kind}" for kind in ("int", "float", "bool", "null")}
NUMBERS = {f"tag:yaml.org,2002:{kind}" for kind in ("int", "float")}
LEADING_ZERO = re.compile(r"[-+]?0+[0-9][0-9_]*")
OTHER_BASE = re.compile(r"[-+]?0[bx]")
UNSPACED = re.compile(
    r"\s*(?:- +)*(?P<key>[^\s:\uff1a#'\"{}\[\],]+)(?: *\uff1a\s*(?P<wide>.*)|:(?!//|\\)(?P<value>[^\s:].*))"
)
"""A line, or a text, that would be a key and its value if a space stood behind the colon, and the colon were one: `\uff1a` is full-width."""
_Events: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class BoundError(yaml.MarkedYAMLError):
    """A text that may be YAML, but is not read: too deep, too much, or not to be written."""


class AsWritten(str):
    """A word that YAML 1.1 takes for a number that few people mean: 015 for 13, 1:30 for 90, 1_000, 0x1F. As text it is
    what was written."""

    __slots__ = ()

    @property
    def decimal(self) -> str:
        """The number that was most likely meant, with digits alone."""
        plain = self.replace("_", "")
        return str(int(plain)) if LEADING_ZERO.fullmatch(plain) else f"{yaml.safe_load(self):.12g}"


def unspaced(text: str) -> tuple[str, str] | None:
    """The key and the value of a line or text such as `side:right`, which is one word in YAML; None where it is nothing
    of the kind."""
    found = UNSPACED.match(text)
    return (found["key"], (found["value"] or found["wide"] or "").strip()) if found else None


def space_needed(key: str, value: str) -> str:
    """What to do about an unspaced key and value."""
    return f"a colon and a space stand between a key and its value: write `{key}: {value}`"


class _Loader(_Events):  # type: ignore[misc]
    """A safe loader without dates, that tells where a value cannot be made, and leaves keys as they are written: an
    aisle may be called 010 or no."""

    yaml_implicit_resolvers: ClassVar = {
        first: [(tag, pattern) for tag, pattern in resolvers if tag != TIMESTAMP]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        self.flatten_mapping(node)
        for key, _ in node.value:
            if key.tag in OTHERWISE_TEXT and not _is_plain_number(key.value):
                key.tag = TEXT
        return super().construct_mapping(node, deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode) and _means_other(node):
            return AsWritten(node.value)
        try:
            value = super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except (ValueError, TypeError, ArithmeticError, AttributeError, LookupError) as error:
            text = f"{node.value!a:.40}" if isinstance(node, yaml.ScalarNode) else "a section"
            kind = node.tag.rpartition(":")[2]
            raise _error(f"{text} is no {kind}", node.start_mark) from error
        if isinstance(value, int | float) and not -LARGEST < value < LARGEST:
            raise _error(f"{node.value:.20} is not a finite number", node.start_mark)
        return value


def _means_other(node: yaml.ScalarNode) -> bool:
    """Whether a word without quotation marks is a number in YAML 1.1 that reads otherwise to people."""
    text = node.value
    if node.style or not (node.tag in NUMBERS or node.tag == TEXT):
        return False
    if LEADING_ZERO.fullmatch(text):
        return True
    return node.tag in NUMBERS and bool("_" in text or ":" in text or OTHER_BASE.match(text))


def _is_plain_number(text: str) -> bool:
    """Whether a number and its text are one: 8 is, 010, 1_000 and 1.10 are not."""
    return text.isdecimal() and text == str(int(text))


def compose(text: str) -> yaml.Node | None:
    """The nodes of a YAML text. Raises YAMLError with one line as its `problem`, and, where it is known, a
    `problem_mark`."""
    require_bounded(text)
    return yaml.compose(text, Loader=_Loader)


def load(text: str) -> Any:
    """What a YAML text holds, with plain data alone. Raises YAMLError as `compose` does."""
    require_bounded(text)
    return yaml.load(text, Loader=_Loader)


def require_bounded(text: str) -> None:
    """Raise YAMLError for a text that is nested too deeply, holds too many or too long values, or half characters."""
    if SURROGATES.search(text):
        raise _error("it holds half a character", None)
    counts: dict[str, int | None] = {}
    sections: list[tuple[str | None, int]] = []
    total = 0
    for event in _events(text):
        if isinstance(event, yaml.CollectionStartEvent):
            sections.append((event.anchor, total))
            if event.anchor is not None:
                counts[event.anchor] = None
            total += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = sections.pop()
            if anchor is not None:
                counts[anchor] = total - before
        elif isinstance(event, yaml.AliasEvent):
            total += _meant(counts.get(str(event.anchor), 1), event)
        elif isinstance(event, yaml.ScalarEvent):
            _require_scalar(event)
            total += 1
            if event.anchor is not None:
                counts[event.anchor] = 1
        if len(sections) > MOST_DEPTH:
            raise _too_deep(event.start_mark)
        if total > MOST_VALUES:
            raise _error(
                f"it holds more than {MOST_VALUES} values, with those that aliases stand for", event.start_mark
            )


def _events(text: str) -> Iterable[Any]:
    try:
        yield from yaml.parse(text, Loader=_Events)
    except yaml.MarkedYAMLError as error:
        if PARSERS_DEPTH in str(error.problem):
            raise _too_deep(error.problem_mark) from error
        if str(error.problem) in COLONS:
            _require_spaced(text, error)
        raise


def _require_spaced(text: str, error: yaml.MarkedYAMLError) -> None:
    """Raise a plainer error where a line that the parser stopped at, or the one before it, lacks the space behind a
    colon."""
    last = error.problem_mark.line if error.problem_mark else -1
    first = error.context_mark.line if error.context_mark else last - 1
    for number, line in enumerate(text.split("\n")[: last + 1]):
        found = unspaced(line) if number >= first else None
        if found:
            mark = yaml.Mark("", 0, number, 0, None, 0)
            raise yaml.MarkedYAMLError(problem=space_needed(*found), problem_mark=mark) from error


def _meant(count: int | None, alias: Any) -> int:
    if count is None:
        raise _error(f"the alias *{alias.anchor:.20} stands inside what it means", alias.start_mark)
    return count


def _require_scalar(event: Any) -> None:
    if len(event.value) > MOST_LETTERS:
        raise _error(f"a text has {len(event.value)} letters; at most {MOST_LETTERS} are read", event.start_mark)
    if SURROGATES.search(event.value):
        raise _error("a text holds half a character", event.start_mark)


def _too_deep(mark: Any) -> BoundError:
    return _error(f"it is nested more than {MOST_DEPTH} deep", mark)


def _error(problem: str, mark: Any) -> BoundError:
    return BoundError(problem=problem, problem_mark=mark)


def problem_of(error: yaml.YAMLError) -> tuple[str, int | None]:
    """What is wrong with a YAML text, in one line, and in which line of it, from 1."""
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
    if NO_TOKEN in str(problem):
        problem = f"{problem}; if it is a tab, put spaces in its place"
    return " ".join(str(problem).split())[:300], None if mark is None else mark.line + 1
