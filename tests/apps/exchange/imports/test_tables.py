"""Tables of points as total stations and spreadsheets write them."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from savmap.apps.exchange.imports.records import ImportOptions, SurveyElement
from savmap.apps.exchange.imports.survey import elements_of
from savmap.errors import OutputError, SavmapError

LABELS = {"post": "post", "bar": "bar"}


def read(
    folder: Path, text: str | bytes, options: ImportOptions | None = None, name: str = "points.csv"
) -> list[SurveyElement]:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return list(elements_of(path, options or ImportOptions(), LABELS).elements)


@pytest.mark.parametrize(
    "text",
    [
        "id,label,x,y,z\np1,post,1.5,2.5,-3\np1,post,1.6,2.5,-3\n",
        "z_m;y_m;x_m;Label;ID\n-3;2,5;1,5;post;p1\n-3;2,5;1,6;post;p1\n",
        "ID\tX [mm]\tY (mm)\tZ in mm\tClass\np1\t1500\t2500\t-3000\tpost\np1\t1600\t2500\t-3000\tpost\n",
        'id,x/cm,y/cm,z/cm,label\np1,"150,0","250,0","-300,0",post\np1,"160,0","250,0","-300,0",post\n',
        "# from the field\n\nid;x mm;y mm;z mm;label\np1;1.500,0;2'500,0;-3 000,0;post\np1;1.600,0;2.500,0;-3.000,0;post\n",
    ],
    ids=["plain", "decimal commas", "tabs, millimetres", "quoted commas", "groups of digits"],
)
def test_one_element_however_it_is_written(tmp_path: Path, text: str) -> None:
    for coding in ("utf-8", "utf-8-sig", "utf-16", "cp1252"):
        (one,) = read(tmp_path, text.encode(coding))
        assert (one.structure.id, one.structure.label, one.frame) == ("p1", "post", "row")
        assert one.structure.vertices == pytest.approx(np.array([[1.5, 2.5, -3], [1.6, 2.5, -3]]))


NARROW = "\u202f"
CULTURES = {
    "en": ('"1,234.5"', '"-12,345"', ","),
    "en, millions": ("1234.5", '"-12,345"', "\t"),
    "de": ("1.234,5", "-12.345", ";"),
    "fr": (f"1{NARROW}234,5", f"-12{NARROW}345", ";"),
    "fr, spaces": ("1 234,5", "-12\u00a0345", ";"),
    "ch": ("1'234.5", "-12'345", ";"),
    "ch, typeset": ("1\u2019234.5", "-12\u2019345", ","),
}


@pytest.mark.parametrize("culture", CULTURES)
def test_numbers_are_read_as_each_culture_writes_them(tmp_path: Path, culture: str) -> None:
    x, y, part = CULTURES[culture]
    text = "\n".join(part.join(cells) for cells in (("code", "x", "y"), ("post 1", x, y)))
    (one,) = read(tmp_path, text)
    assert one.structure.vertices.tolist() == [[1234.5, -12345, 0]]


@pytest.mark.parametrize(
    ("cells", "part", "unit", "expected"),
    [
        (("1.234", "2.345"), ",", "m", [1.234, 2.345]),
        (("1,234", "2,345"), ";", "m", [1.234, 2.345]),
        (("1,234", "0,345"), "\t", "m", [1.234, 0.345]),
        (("1,234,567", "2,345"), "\t", "m", [1234567, 2345]),
        (("1,234", "2,345"), "\t", "m", "1,234 may be 1234 or 1.234: write digits without groups"),
        (("1,234", "2,345"), ";", "mm", "1,234 may be 1234 or 1.234"),
        (("1.234", "2.345"), ",", "mm", "1.234 may be 1.234 or 1234"),
        (("1,234", "2.345"), ";", "m", "decimals follow a comma in some numbers, and a point in others"),
        (("1,23,4", "2"), ";", "m", "x is 1,23,4, not a number"),
        (("12 34", "2"), ";", "m", "x is 12 34, not a number"),
        (("1.2.3", "2"), ";", "m", "x is 1.2.3, not a number"),
    ],
)
def test_nothing_is_taken_for_a_thousandth(
    tmp_path: Path, cells: tuple[str, str], part: str, unit: str, expected: list[float] | str
) -> None:
    text = part.join(("code", f"x_{unit}", f"y_{unit}")) + "\n" + part.join(("post 1", *cells))
    if isinstance(expected, str):
        with pytest.raises(OutputError, match=re.escape(expected)):
            read(tmp_path, text)
    else:
        (one,) = read(tmp_path, text)
        assert one.structure.vertices.tolist() == [[*expected, 0]]


def test_a_total_stations_list_needs_no_header(tmp_path: Path) -> None:
    text = "101,4321.500,8765.250,12.4,POST 1\n102,4321.600,8765.250,12.4,POST 1\n103,4322,8765,12,LAMP\n104,4323,8765,12,LAMP\n"
    columns = {"vertex": "1", "x": "2", "y": "3", "z": "4", "label": "5"}
    found = read(tmp_path, text, ImportOptions(columns, {"LAMP": "tube"}, placed=True), "points.txt")
    assert [(one.structure.label, len(one.structure.vertices), one.frame) for one in found] == [
        ("POST", 2, "world"),
        ("tube", 1, "world"),
        ("tube", 1, "world"),
    ]
    assert found[0].structure.vertex_labels == ("101", "102")


def test_names_of_axes_are_those_of_the_frame(tmp_path: Path) -> None:
    world = ImportOptions(placed=True)
    (one,) = read(tmp_path, "Code;Easting;Northing;Elevation\npost 1;1;2;3\n", world)
    assert one.structure.vertices.tolist() == [[1, 2, 3]]
    (one,) = read(tmp_path, "code;x;height\npost 1;1;3\n")
    assert one.structure.vertices.tolist() == [[1, 3, 0]]
    with pytest.raises(OutputError, match="places of the world need --map or --place"):
        read(tmp_path, "Code;Easting;Northing;Elevation\npost 1;1;2;3\n")


def test_rows_frames_and_texts_are_read(tmp_path: Path) -> None:
    text = "row,frame,id,label,x,y,z,text\nA,row,'=p,post,1,2,3,A21\nB,site,'=p,post,4,5,6,\n"
    a, b = read(tmp_path, text)
    assert (a.row, a.frame, a.structure.id, a.structure.attributes) == ("A", "row", "=p", {"text": "A21"})
    assert (b.row, b.frame, b.structure.attributes) == ("B", "site", {})
    assert {one.frame for one in read(tmp_path, text, ImportOptions(frame="world"))} == {"world"}


def test_an_unit_that_is_given_wins(tmp_path: Path) -> None:
    (one,) = read(tmp_path, "id,label,x_m,y_m\np,post,1000,2000\n", ImportOptions(unit="mm"))
    assert one.structure.vertices.tolist() == [[1, 2, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no table"),
        ("id,label,x,y,z\n", "holds no points"),
        ("id,label,a,b\np,post,1,2\n", "no column is x; there are id, label, a, b: say --columns x=NAME"),
        ("x,y,z\n1,2,3\n", "no column says what each point is of"),
        ("id,label,x,y\np,post,1,two\n", "line 2: y is two, not a number"),
        ("id,label,x,y\np,post,1,\n", "line 2: y is empty"),
        ("id,label,x,y\np,post,1,1e999\n", "line 2: y is 1e999"),
        ("id,label,x,y\np,post,1,1_0\n", "y is 1_0"),
        ("id,label,x,y\np,post,nan,1\n", "x is nan"),
        ('id,label,x,y\np,post,"1,5",2.5\n', "decimals follow a comma in some"),
        ("id,label,frame,x,y,z\np,post,moon,1,2,3\n", "frame is moon, not one of row, site, world"),
        (b"\xff\xfe\x00", "is not a text file"),
        ("id,label,x,y\n" + "a" * 200_000 + ",post,1,2\n", "is not a table"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(OutputError, match=message) as caught:
        read(tmp_path, text)
    assert "points.csv" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


def test_what_is_no_survey_by_its_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"surveys are read from \.csv"):
        read(tmp_path, "x", name="points.xlsx")
    with pytest.raises(OutputError, match="cannot be read"):
        elements_of(tmp_path / "none.csv", ImportOptions(), LABELS)


def test_a_column_that_is_not_there_is_told(tmp_path: Path) -> None:
    for wanted in ("east", "9", "0", "²"):
        with pytest.raises(OutputError, match=r"has no column .* \(--columns x\); there are id, x, y"):
            read(tmp_path, "id,x,y\np,1,2\n", ImportOptions({"x": wanted}))


CELLS = st.one_of(
    st.sampled_from(["x", "y", "z_mm", "id", "label", "frame", "post", "1", "1,5", "-2.5", "", "'=a", "#"]),
    st.text(max_size=5),
)


@pytest.mark.slow
@settings(max_examples=150)
@given(st.lists(st.lists(CELLS, max_size=6), max_size=6), st.sampled_from(";,\t"), st.binary(max_size=4))
def test_any_table_is_read_or_refused(tmp_path: Path, lines: list[list[str]], part: str, end: bytes) -> None:
    content = "\n".join(part.join(cells) for cells in lines).encode("utf-8", "replace") + end
    with suppress(SavmapError):
        assert all(np.isfinite(one.structure.vertices).all() for one in read(tmp_path, content))
