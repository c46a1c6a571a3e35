"""YAML 1.2 as plain data with the line of each key, and plain data as YAML.

Keys are texts as they are written: an aisle may be called 010 or no. Dates are texts too: none of our files holds one.
"""

import io
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.representer import SafeRepresenter

from savmap.errors import CONTROLS, SiteError
from savmap.files.texts import SURROGATES, fault_of_path

Location = tuple[int | str, ...]
MOST_MB = 2.0
MOST_VALUES = 100_000
"""With what aliases stand for: a site of 2000 rows has 60 000."""
LARGEST = 1e300
TOO_DEEP = "it is nested too deeply, or an alias stands inside what it means"
TAGS = "tag:yaml.org,2002:"
VALUES = {f"{TAGS}{kind}" for kind in ("int", "float", "bool", "null")}
TEXTS = {f"{TAGS}{kind}" for kind in ("str", "timestamp", "value", "merge")}
WHOLE = re.compile(r"[-+]?\d+,\d+")
NUMBER = re.compile(r"[-+]?(\.\d+|\d+(\.\d*)?)([eE][-+]?\d+)?")


class YamlError(ValueError):
    """A text that is not read: what is wrong with it, in one line, and in which line of it, from 1, where known."""

    def __init__(self, problem: str, line: int | None = None) -> None:
        super().__init__(problem)
        self.line = line


@dataclass
class Document:
    """What a YAML text holds: plain data, the line, from 1, of every key and entry, the keys behind whose colon nothing
    stands (not even null), and the keys that stand twice in a section, with both lines."""

    content: Any = None
    lines: dict[Location, int] = field(default_factory=dict)
    empty: list[Location] = field(default_factory=list)
    doubles: list[tuple[Location, int, int]] = field(default_factory=list)


def load(text: str) -> Any:
    """What a YAML text holds, as plain data. Raises YamlError."""
    return document(text).content


def document(text: str) -> Document:
    """What a YAML text holds, and where. Raises YamlError."""
    yaml = YAML(typ="safe", pure=True)
    reader = _Reader(yaml)
    try:
        node = yaml.compose(text)
        if node is not None:
            reader.document.lines[()] = node.start_mark.line + 1
            reader.document.content = reader.value(node, ())
    except RecursionError:
        raise YamlError(TOO_DEEP) from None
    except YAMLError as error:
        mark, reason = getattr(error, "problem_mark", None), getattr(error, "reason", None)
        problem = " ".join(str(getattr(error, "problem", None) or reason or error).split())
        raise YamlError(problem[:300], None if mark is None else mark.line + 1) from error
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        if isinstance(error, YamlError):
            raise
        raise YamlError(f"it cannot be read ({error})"[:200]) from error  # ruamel.yaml's, of some broken texts
    return reader.document


def dumped(content: Mapping[Any, Any], flow: bool | None = False, width: int = 80) -> str:
    """Plain data as YAML that readers of 1.1, as ROS has, and of 1.2 read alike. flow: whether lists and sections
    stand on one line; None: those that hold none themselves."""
    yaml = YAML(typ="safe", pure=True)
    yaml.version, yaml.Representer = (1, 1), _Representer
    yaml.default_flow_style, yaml.width = flow, width
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    stream = io.StringIO()
    yaml.dump(content, stream)
    return stream.getvalue().partition("---\n")[2]


def path_text(path: str) -> str:
    """A path as YAML. Raises SiteError for one that no site file can name."""
    if fault_of_path(path):
        why = "is too long, or holds a line end, another control character or bytes that are no UTF-8"
        raise SiteError(f"{path}: no site file can name it, for its path {why}: rename it")
    return json.dumps(path, ensure_ascii=bool(CONTROLS.search(path)))  # some are line ends to YAML


class _Representer(SafeRepresenter):
    """Quotes the texts that are numbers in YAML 1.2 alone, such as 0e0."""


def _text(representer: SafeRepresenter, text: str) -> ScalarNode:
    node: ScalarNode = representer.represent_scalar(f"{TAGS}str", text, style="'" if NUMBER.fullmatch(text) else None)
    return node


_Representer.add_representer(str, _text)


class _Reader:
    """Makes a document of nodes."""

    def __init__(self, yaml: YAML) -> None:
        self.document = Document()
        self._constructor = yaml.constructor
        self._count = 0

    def value(self, node: Node, location: Location) -> Any:
        self._count += 1
        if self._count > MOST_VALUES:
            raise _error(f"it holds more than {MOST_VALUES} values, with those that aliases stand for", node)
        if isinstance(node, ScalarNode):
            return self._scalar(node)
        if isinstance(node, MappingNode) and node.tag == f"{TAGS}map":
            return self._mapping(node, location)
        if isinstance(node, SequenceNode) and node.tag == f"{TAGS}seq":
            return self._sequence(node, location)
        raise _error(f"values of the kind {node.tag} are not read", node)

    def _sequence(self, node: SequenceNode, location: Location) -> list[Any]:
        whole = [(a, b) for a, b in pairwise(node.value) if WHOLE.fullmatch(f"{a.value},{b.value}")]
        near = [(a, b) for a, b in whole if b.start_mark.index == a.end_mark.index + 1]
        if 0 < len(near) < len(whole):
            a, b = (part.value for part in near[0])
            raise _error(f"{a},{b} are two numbers: write {a}.{b}, or a space behind the comma", near[0][0])
        for number, value in enumerate(node.value):
            self.document.lines.setdefault((*location, number), value.start_mark.line + 1)
        return [self.value(value, (*location, number)) for number, value in enumerate(node.value)]

    def _mapping(self, node: MappingNode, location: Location) -> dict[str, Any]:
        content: dict[str, Any] = {}
        merged: list[Node] = []  # sections whose keys are filled in
        first: dict[str, int] = {}
        for key, value in node.value:
            if not isinstance(key, ScalarNode):
                raise _error("a key must be a text", key)
            if key.value == "<<" and not key.style:
                merged += value.value if isinstance(value, SequenceNode) else [value]
                continue
            name, inside, line = key.value, (*location, key.value), key.start_mark.line + 1
            _require_whole(key)
            if name in first:
                self.document.doubles.append((inside, first[name], line))
            first.setdefault(name, line)
            self.document.lines.setdefault(inside, line)
            if isinstance(value, ScalarNode) and not value.value and not value.style:
                self.document.empty.append(inside)
            content[name] = self.value(value, inside)
        for section in merged:
            if not isinstance(section, MappingNode):
                raise _error("a section is expected behind <<", section)
            content = {**self.value(section, location), **content}
        return content

    def _scalar(self, node: ScalarNode) -> Any:
        _require_whole(node)
        if node.tag in TEXTS:
            return node.value
        if node.tag not in VALUES:
            raise _error(f"values of the kind {node.tag} are not read", node)
        try:
            value = self._constructor.construct_object(node)
        except (ValueError, LookupError) as error:
            raise _error(f"{node.value!a:.40} is no {node.tag.removeprefix(TAGS)}", node) from error
        if (isinstance(value, float) and not math.isfinite(value)) or (isinstance(value, int) and abs(value) > LARGEST):
            raise _error(f"{node.value:.20} is not a finite number", node)
        return value


def _require_whole(node: ScalarNode) -> None:
    if SURROGATES.search(node.value):
        raise _error("a text holds half a character", node)


def _error(problem: str, node: Node) -> YamlError:
    return YamlError(problem, node.start_mark.line + 1)
