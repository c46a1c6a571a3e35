"""Site files of any names and numbers: what is written is read as it was meant, whatever is broken is one line."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from savmap.errors import SiteError
from savmap.site.load import load_site
from savmap.site.overrides import overrides_of
from savmap.site.references import references_of
from savmap.site.sections import ReferenceSection

NAMES = st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), min_size=1, max_size=8).filter(
    lambda name: name.strip(". ") and name.isprintable()
)
SIGMAS = st.floats(1e-6, 10)
METRES = st.floats(-999, 999)
PLAIN = settings(max_examples=80)


def known(values: st.SearchStrategy[float]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({"value": values, "sigma": SIGMAS})


def more(**fixed: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({"value": METRES, "sigma": SIGMAS} | fixed)


PAIRS = st.tuples(NAMES, NAMES).filter(lambda pair: pair[0] != pair[1])
AXES = st.sampled_from(["x", "y"])
REFERENCES = st.fixed_dictionaries(
    {},
    optional={
        "camera_height_m": known(st.floats(0.11, 49)),
        "travel_m": st.floats(0.6, 999),
        "lengths": st.lists(more(value=st.floats(1e-3, 999), between=PAIRS.map(list), axis=AXES), max_size=3),
        "points": st.lists(more(vertex=NAMES, axis=st.sampled_from(["x", "y", "z"])), max_size=3),
    },
)
PASSES = st.lists(
    st.fixed_dictionaries(
        {"video": st.just("a.mp4")},
        optional={"start_s": st.floats(0, 1e5), "fps": st.floats(0.1, 120), "side": st.sampled_from(["left", "right"])},
    ),
    min_size=1,
    max_size=3,
)
ROWS = st.fixed_dictionaries({"passes": PASSES}, optional={"references": REFERENCES, "appearance": st.booleans()})
SITES = st.fixed_dictionaries(
    {"rows": st.dictionaries(NAMES, ROWS, min_size=1, max_size=3)},
    optional={"references": REFERENCES, "fps": st.floats(0.1, 120), "joint": st.booleans()},
)


@PLAIN
@given(SITES)
def test_a_site_that_is_written_is_read(tmp_path: Path, content: dict[str, Any]) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(
        json.dumps(content, ensure_ascii=False), encoding="utf-8"
    )  # PyYAML's 1.1 leaves 0E0, a number of 1.2, bare
    site = load_site(path)
    assert list(site.rows) == list(content["rows"])
    for name, row in content["rows"].items():
        read = site.rows[name]
        assert [one.start_s for one in read.passes] == [one.get("start_s", 0.0) for one in row["passes"]]
        wanted = [one.get("fps", content.get("fps", 15.0)) for one in row["passes"]]
        assert [one.rate for one in read.passes] == wanted
        given_keys = {**content.get("references", {}), **row.get("references", {})}
        assert site.row_references(name).model_dump(
            mode="json", include=set(given_keys)
        ) == ReferenceSection.model_validate(given_keys).model_dump(mode="json", include=set(given_keys))


@PLAIN
@given(REFERENCES)
def test_references_keep_their_numbers(content: dict[str, Any]) -> None:
    section = ReferenceSection.model_validate(content)
    assert ReferenceSection.model_validate(section.model_dump(mode="json")) == section
    made = references_of(section)
    height = content.get("camera_height_m")
    assert [(one.value_m, one.sigma_m) for one in made.camera_heights] == (
        [(height["value"], height["sigma"])] if height else []
    )
    for one, given_length in zip(made.lengths, content.get("lengths", []), strict=True):
        assert {one.start, one.end} == set(given_length["between"])
        assert (one.value_m, one.sigma_m, one.axis) == tuple(given_length[key] for key in ("value", "sigma", "axis"))
    for point, given_point in zip(made.points, content.get("points", []), strict=True):
        assert point.position_m["xyz".index(given_point["axis"])] == given_point["value"]
        assert sum(coordinate is not None for coordinate in point.position_m) == 1


@PLAIN
@given(st.text(max_size=60))
def test_any_text_is_a_site_or_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "site.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(SiteError) as caught:
        load_site(path)
    assert str(caught.value).startswith(str(path))


@PLAIN
@given(st.text(min_size=1, max_size=20), st.text(max_size=20))
def test_any_option_is_an_override_or_one_line(key: str, value: str) -> None:
    said = ""
    try:
        (one,) = overrides_of([f"{key}={value}"], {})
        said = one.place
    except SiteError as error:
        said = str(error)
    assert said.startswith("--set ")
