import ast
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from savmap.types import MapWarning, ReferenceUse
from savmap.types.verdicts import WARNINGS, WarningCode, by_code

ROOT = Path(__file__).parents[2]


def codes_of_the_product() -> Iterator[tuple[str, str | None]]:
    """Each place of the product that makes a warning, and the code that it writes out."""
    for folder in ("savmap", "plugins"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "MapWarning":
                    code = node.args[0].value if isinstance(node.args[0], ast.Constant) else None
                    yield f"{path.relative_to(ROOT).as_posix()}:{node.lineno}", str(code) if code else None


def test_there_are_twelve_codes_and_each_is_used() -> None:
    found = dict(codes_of_the_product())
    assert [place.split(":")[0] for place, code in found.items() if code is None] == ["savmap/maps/schema.py"]
    assert {*found.values()} - {None} == {*WARNINGS} == {*get_args(WarningCode)}
    assert len(WARNINGS) <= 12


def test_the_page_on_verdicts_explains_each_code() -> None:
    page = (ROOT / "docs" / "verdict.md").read_text(encoding="utf-8")
    rows = (f"| `{code}` | {kind.headline} | {kind.explanation} | {kind.action} |" for code, kind in WARNINGS.items())
    assert [row for row in rows if row not in page] == []


def test_unknown_codes_and_texts_of_several_lines_are_refused() -> None:
    with pytest.raises(ValueError, match="must be one of uncertain-element, "):
        MapWarning("odd-shape")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="one line"):
        MapWarning("camera-motion", details=("one\ntwo",))


def test_line_has_code_headline_figure_action() -> None:
    warning = MapWarning("uncertain-element", ("light 1",), "P 0.43", details=("more",))
    what = "uncertain-element: it is uncertain whether an element exists"
    assert warning.line == f"{what}, P 0.43; look whether it is there: light 1"
    assert MapWarning("uncertain-element").line == f"{what}; look whether it is there"


def test_a_warning_of_elements_says_nothing_of_the_others() -> None:
    assert not MapWarning("uncertain-element", ("light 1",)).of_row
    assert MapWarning("reference-conflict", ("camera height",)).of_row


def repeated(number: int) -> MapWarning:
    apart = 3.1 - 0.06 * abs(number - 20)
    where = (f"bay {number} / beam 1",), f"{apart:.1f} cm apart", (number, 1.0, 0.0)
    return MapWarning("inconsistent-element", *where, size=apart)


def test_one_code_is_one_warning() -> None:
    """Footage of another renderer, whose scale drifts, gave a line for each of 48 elements."""
    singles, other = [repeated(number) for number in range(1, 49)], MapWarning("missing-frames")
    one, kept = by_code([*singles[:20], other, *singles[20:]])
    assert one.figure == "48 elements, the worst 3.1 cm apart"
    assert one.action == "look whether it is one element: bay 20 / beam 1, bay 1 / beam 1 and 46 more"
    assert {*one.subjects} == {f"bay {number} / beam 1" for number in range(1, 49)}
    assert one.details == tuple(f"{single.subjects[0]}: {single.figure}" for single in singles)
    assert one.place == (20, 1.0, 0.0)
    assert kept == other
    assert by_code([one, kept]) == (one, kept)


def test_several_times_are_counted() -> None:
    first, other = (MapWarning("camera-motion", figure=f"at {second} s", size=second) for second in (1, 30))
    (one,) = by_code([first, other, first])
    assert one.figure == "2 times, the worst at 30 s"
    assert one.details == ("at 1 s", "at 30 s")


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
