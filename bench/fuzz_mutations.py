"""Texts that are almost sound: structure-aware mutations (hypothesis) of trees of JSON or YAML, and of the bytes that they are written as."""

import copy
import json
import random
from collections.abc import Callable, Iterator
from typing import Any

import yaml
from hypothesis import strategies as st

Path = tuple[Any, ...]
Edit = Callable[[Any, Any, random.Random], Any]
LETTERS = "\x00\x07\x1b\x7f\x9b\r\n\t\u202e\u2028\ufeff\ud800\udfff=+-@,;\"'<>&`{}[]()$%#!|\\/*&:~0aZü日😀"
STRINGS = [
    *(
        "",
        ".",
        "..",
        "/",
        "~",
        "null",
        "yes",
        "0x",
        "1_:__",
        "-",
        "=1+1",
        "@SUM(A1)",
        "%s",
        "{0}",
        "{{7*7}}",
        "${HOME}",
    ),
    *(
        "NaN",
        "Infinity",
        "1e999",
        "2021-13-45",
        "99:99:99",
        "\x1b[2J\x1b]0;x\x07",
        "a\nend_header\nb",
        "a\x00b",
        "\ud800",
    ),
    *(
        "/dev/zero",
        "/dev/stdin",
        "file:///dev/zero",
        "http://[",
        "s3://",
        "nosuch://x",
        "../../../../etc/passwd",
        "a/" * 900,
    ),
    *("x" * 101, "x" * 300, "ü" * 150, "x" * 5000, "9" * 500, "<script>", "[bold]", "[/x]", "(a+)+$", "[A-Z", "\\"),
    *(
        "!!python/object/apply:os.system [id]",
        "*a",
        "&a",
        "<<",
        "A",
        "1",
        "left",
        "+x",
        "x",
        "pass 1",
        "upright 1 / left",
    ),
]
NUMBERS = [
    *(
        0,
        1,
        -1,
        2,
        3,
        255,
        10**6,
        2**31,
        2**63,
        -(2**63) - 1,
        10**30,
        10**400,
        0.0,
        -0.0,
        0.5,
        1e-9,
        5e-324,
        1e5,
        1e6 + 1,
    ),
    *(1e12, 1e154, 1e300, -1e300, 1.7976931348623157e308, float("inf"), float("-inf"), float("nan"), True, False, None),
]


def deep(depth: int, leaf: Any = 1) -> Any:
    """A value within so many lists."""
    for _ in range(depth):
        leaf = [leaf]
    return leaf


scalars = st.one_of(
    st.sampled_from(STRINGS),
    st.sampled_from(NUMBERS),
    st.text(st.sampled_from(LETTERS), max_size=12),
    st.integers(),
    st.floats(),
)
values = st.one_of(
    scalars,
    st.builds(deep, st.sampled_from([1, 2, 49, 60, 300])),
    st.lists(scalars, max_size=4),
    st.dictionaries(st.sampled_from(STRINGS), scalars, max_size=3),
)


def paths(tree: Any, at: Path = ()) -> Iterator[Path]:
    """The paths of all nodes but the root."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from paths(value, (*at, key))


def inside(tree: Any, path: Path) -> Any:
    """The node at a path."""
    for key in path:
        tree = tree[key]
    return tree


def _replace(here: Any, key: Any, rng: random.Random, value: Any) -> None:
    here[key] = value


def _delete(here: Any, key: Any, rng: random.Random, value: Any) -> None:
    del here[key]


def _repeat(here: Any, key: Any, rng: random.Random, value: Any) -> None:
    if isinstance(here, list):
        here[key:key] = [copy.deepcopy(here[key]) for _ in range(rng.choice([1, 2, 100]))]
    else:
        here[f"{key}2"] = copy.deepcopy(here[key])


def _rename(here: Any, key: Any, rng: random.Random, value: Any) -> None:
    if isinstance(here, dict):
        here[value if isinstance(value, str) else str(value)[:99]] = here.pop(key)
    else:
        here.append(value)


def _wrap(here: Any, key: Any, rng: random.Random, value: Any) -> None:
    here[key] = rng.choice([[here[key]], {"a": here[key]}, [here[key], value]])


def _nudge(here: Any, key: Any, rng: random.Random, value: Any) -> None:
    own = here[key]
    if isinstance(own, int | float) and not isinstance(own, bool):
        here[key] = rng.choice([-own, own * 1000, own // 7, -own - 1, str(own)[:400], [own], own + 1])
    elif isinstance(own, str):
        here[key] = rng.choice([own + "\n", own.upper(), own[:-1], own * 40, own + "\x1b[0m", "=" + own, [own]])
    else:
        here[key] = value


EDITS = (_replace, _replace, _delete, _repeat, _rename, _wrap, _nudge, _nudge)


def edited(tree: Any, choices: list[tuple[int, int, Any]]) -> Any:
    """A tree with edits at some of its nodes."""
    tree = copy.deepcopy(tree)
    for place, number, value in choices:
        rng = random.Random(place)
        known = list(paths(tree))
        if not known:
            break
        path = known[place % len(known)]
        EDITS[number](inside(tree, path[:-1]), path[-1], rng, value)
    return tree


def trees(seed: Any) -> st.SearchStrategy[Any]:
    """The seed with one to four edits."""
    choice = st.tuples(st.integers(0, 1 << 30), st.integers(0, len(EDITS) - 1), values)
    few = st.one_of(st.lists(choice, min_size=1, max_size=1), st.lists(choice, min_size=1, max_size=4))
    return few.map(lambda choices: edited(seed, choices))


def as_json(tree: Any) -> bytes:
    """A tree as JSON, with NaN and halves of surrogate pairs as JSON has them."""
    return json.dumps(tree, indent=1).encode()


def as_yaml(tree: Any) -> bytes:
    """A tree as YAML; as JSON, which is YAML too, where it cannot be."""
    try:
        return bytes(yaml.safe_dump(tree, sort_keys=False), "utf-8")
    except (yaml.YAMLError, UnicodeError, ValueError):
        return as_json(tree)


INSERTS = [
    *(
        b"[" * 200,
        b"{" * 60,
        b"&a ",
        b"*a ",
        b"<<: *a\n",
        b"!!float ",
        b"\x00",
        b"\xff",
        b"\xef\xbb\xbf",
        b"\r\n",
        b"1e999",
        b"---\n",
    ),
    *(b"\x1b", b'"', b"'", b"\\ud800", b"\t", b": ", b"- ", b"? ", b"| ", b"%YAML 9.9\n", b"9" * 5000, b"x" * 5000),
]
BOMBS = [
    b"a: &a [1,1,1,1,1,1,1,1,1]\n"
    + b"".join(b"%c: &%c [%s]\n" % (k + 1, k + 1, b",".join(9 * [b"*%c" % k])) for k in b"abcdefgh"),
    b"x0: &x0 {a: 1}\n" + b"".join(b"x%d: &x%d {<<: [*x%d, *x%d]}\n" % (k + 1, k + 1, k, k) for k in range(40)),
    b"# " + b"x" * (5 << 20) + b"\n",
    b"- 1\n" * 300_000,
]


def spoilt(content: bytes, kind: int, at: int, insert: bytes) -> bytes:
    """Bytes that were cut off, flipped, doubled, or had something put into them."""
    place = at % (len(content) + 1)
    if kind == 0:
        return content[:place]
    if kind == 1:
        changed = bytearray(content)
        for step in range(1 + at % 5):
            if changed:
                changed[(place + 37 * step) % len(changed)] ^= 1 << (at + step) % 8
        return bytes(changed)
    if kind == 2:
        end = place + 1 + at % 60
        return content[:end] + content[place:end] * (1 + at % 3) + content[end:]
    return content[:place] + insert + content[place:]


def texts(seed: Any, written: Callable[[Any], bytes], bombs: bool = False) -> st.SearchStrategy[bytes]:
    """Mutated trees as bytes, a third of them spoilt as bytes too, and now and then one that is large beyond reason."""
    whole = trees(seed).map(written)
    insert = st.one_of(st.sampled_from(INSERTS), st.binary(max_size=8))
    rough = st.builds(
        spoilt, st.one_of(whole, st.just(written(seed))), st.integers(0, 3), st.integers(0, 1 << 30), insert
    )
    kinds = [whole, whole, rough]
    if bombs:
        large = st.builds(lambda bomb: bomb + written(seed), st.sampled_from(BOMBS))
        kinds.append(st.integers(0, 19).flatmap(lambda number: large if number == 0 else whole))
    return st.one_of(*kinds)
