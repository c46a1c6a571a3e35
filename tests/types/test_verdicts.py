import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from savmap.types import Doubt, ReferenceUse
from savmap.types.verdicts import MOST_WORDS, by_cause

ROOT = Path(__file__).parents[2]
MADE_FROM_FILES = {"savmap/maps/map_file.py"}
"""Of a doubt that was made elsewhere."""


def constants(node: ast.expr, names: dict[str, list[ast.expr]]) -> Iterator[str | None]:
    """The texts that an expression may be; None for one that is not written out."""
    if isinstance(node, ast.Constant):
        yield node.value if isinstance(node.value, str) else None
    elif isinstance(node, ast.IfExp):
        yield from constants(node.body, names)
        yield from constants(node.orelse, names)
    elif isinstance(node, ast.Name) and node.id in names:
        for value in names[node.id]:
            yield from constants(value, names)
    else:
        yield None


def bound(tree: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    for node in ast.walk(tree):
        for target in node.targets if isinstance(node, ast.Assign) else ():
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(target.elts, node.value.elts, strict=False)
                yield from ((name.id, value) for name, value in pairs if isinstance(name, ast.Name))
            elif isinstance(target, ast.Name):
                yield target.id, node.value


def headlines() -> Iterator[tuple[str, str | None]]:
    """Each place of the product that makes a doubt, and the headline that it writes out."""
    trees = {
        path.relative_to(ROOT).as_posix(): ast.parse(path.read_text())
        for folder in ("savmap", "plugins")
        for path in sorted((ROOT / folder).rglob("*.py"))
    }
    shared = {name: [value] for tree in trees.values() for name, value in bound(tree) if name.isupper()}
    for path, tree in trees.items():
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        calls = (
            (function, node)
            for function in functions
            for node in ast.walk(function)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Doubt"
        )
        for function, call in calls:
            names = {**shared}
            for name, value in bound(function):
                names.setdefault(name, []).append(value)
            if path not in MADE_FROM_FILES:
                yield from ((f"{path}:{call.lineno}", text) for text in constants(call.args[1], names))


def test_headlines_have_eight_words_and_no_names() -> None:
    found = dict(headlines())
    assert len(found) > 40
    assert not [place for place, text in found.items() if text is None]
    assert not [(place, text) for place, text in found.items() if not 0 < len(str(text).split()) <= MOST_WORDS]


def test_longer_headline_is_refused() -> None:
    with pytest.raises(ValueError, match="`headline` must have 1 to 8 words"):
        Doubt("shape", "upright 2 and upright 3 are 3.69 m apart, others 1.36 m")
    with pytest.raises(ValueError, match="one line"):
        Doubt("shape", "an upright may be missing", details=("one\ntwo",))


def test_line_has_headline_figure_action() -> None:
    doubt = Doubt("shape", "a lamp is odd", figure="3.1 m", action="look at it: light 1", details=("more",))
    assert doubt.line == "a lamp is odd: 3.1 m; look at it: light 1"
    assert Doubt("shape", "a lamp is odd").line == "a lamp is odd"


def repeated(number: int) -> Doubt:
    beam = f"bay {number} / beam 1"
    what, action = "odd and even frames put an element apart", f"look whether it is one element: {beam}"
    apart = f"{3.1 - 0.06 * abs(number - 20):.1f} cm apart"
    return Doubt("repeatability", what, (beam,), (number, 1.0, 0.0), figure=apart, action=action)


def test_one_cause_is_one_doubt() -> None:
    """Footage of another renderer, whose scale drifts, gave a line for each of 48 elements."""
    singles, other = [repeated(number) for number in range(1, 49)], Doubt("motion", "frames are missing")
    one, kept = by_cause([*singles[:20], other, *singles[20:]])
    assert one.figure == "48 elements, up to 3.1 cm apart"
    assert one.action == "look whether it is one element: bay 1 / beam 1, bay 2 / beam 1 and 46 more"
    assert one.structures == tuple(f"bay {number} / beam 1" for number in range(1, 49))
    assert one.details == tuple(doubt.line for doubt in singles)
    assert one.place == (20, 1.0, 0.0)
    assert kept == other
    assert by_cause([one, kept]) == (one, kept)


def test_beams_that_may_be_missing_are_one_doubt() -> None:
    what = "all frames show something that is not mapped"
    singles = [Doubt("support", what, action=f"look: beam near upright {number}") for number in range(18)]
    (one,) = by_cause(singles)
    assert (one.figure, one.action) == ("18 places", "look: beam near upright 0, beam near upright 1 and 16 more")


def test_other_actions_of_one_cause_are_its_first_ones() -> None:
    first, other = (
        Doubt("motion", "the camera turns away", figure=f"at {second} s", action=action)
        for second, action in ((1, "begin later, at 2.0 s"), (30, "end sooner, at 29.0 s"))
    )
    (one,) = by_cause([first, other])
    assert (one.figure, one.action) == ("2 times", first.action)
    assert one.details == (first.line, other.line)


@pytest.mark.parametrize(
    ("solved", "softened", "left_out", "state", "used"),
    [
        (14.16, None, False, "used", 0.003),
        (14.16, 0.51, False, "softened", 0.51),
        (13.66, 0.51, False, "contradicted", 0.51),
        (14.18, None, False, "contradicted", 0.003),
        (13.66, None, True, "left out", None),
    ],
)
def test_states_of_references(
    solved: float, softened: float | None, left_out: bool, state: str, used: float | None
) -> None:
    use = ReferenceUse("length", 14.162, 0.003, solved, "m", softened, left_out)
    assert (use.state, use.sigma_used) == (state, used)
