"""Single keys set on the command line and by the environment."""

from pathlib import Path

import pytest

from savmap.errors import SiteError
from savmap.site.load import load_site
from savmap.site.model import Site
from savmap.site.overrides import overrides_of

SITE = """\
plugins:
  shelves: {threshold: 0.4}
references:
  camera_height_m: {value: 3.0, sigma: 0.02}
rows:
  A:
    passes:
      - {video: a.mp4, side: left}
      - {video: b.mp4, side: right}
  b.1:
    passes:
      - {video: c.mp4}
"""


def site(folder: Path, *options: str, **variables: str) -> Site:
    path = folder / "site.yaml"
    path.write_text(SITE, encoding="utf-8")
    return load_site(path, overrides_of(options, variables))


def test_options_set_keys_that_are_there_and_new_ones(tmp_path: Path) -> None:
    found = site(
        tmp_path,
        "references.camera_height_m.value=3.1",
        "rows.A.passes[1].fps=5",
        "rows.A.passes.0.start_s=2",
        "joint=off",
    )
    assert found.references.camera_height_m is not None
    assert found.references.camera_height_m.value == 3.1
    assert [one.rate for one in found.rows["A"].passes] == [15, 5]
    assert found.rows["A"].passes[0].start_s == 2
    assert found.joint is False


def test_values_are_yaml_and_null_removes_a_key(tmp_path: Path) -> None:
    found = site(
        tmp_path, 'rows."b.1".place={x_m: 1, z_m: 2, heading_deg: 180}', "plugins.shelves.threshold=null", "rows.A="
    )
    assert found.rows["b.1"].place is not None
    assert found.rows["b.1"].place.heading_deg == 180
    assert found.plugins["shelves"] == {}
    assert list(found.rows) == ["b.1"]


def test_variables_find_rows_whatever_their_case(tmp_path: Path) -> None:
    found = site(tmp_path, SAVMAP__ROWS__A__PASSES__0__FPS="4", SAVMAP__APPEARANCE="true", PATH="joint=false")
    assert found.rows["A"].passes[0].fps == 4
    assert found.appearance is True


def test_the_command_line_counts_more_than_the_environment(tmp_path: Path) -> None:
    assert site(tmp_path, "fps=6", SAVMAP__FPS="4").rows["A"].passes[0].fps == 6


@pytest.mark.parametrize(
    ("options", "variables", "message"),
    [
        (["references.camera_height_m.value=3000"], {}, "--set references.camera_height_m.value: `references.camera"),
        (["references.camera_heigth_m.value=3"], {}, "--set references.camera_heigth_m.value: unknown key"),
        (["rows.A.references.camera_height_m.sigma=0.1"], {}, "--set rows.A.references.camera_height_m.sigma: `rows.A"),
        ([], {"SAVMAP__ROWS__A__PASSES__0__SIDE": "up"}, "SAVMAP__ROWS__A__PASSES__0__SIDE: `rows.A.passes[0].side`"),
        ([], {"SAVMAP__ROWS__X__FPS": "4"}, "SAVMAP__ROWS__X__FPS: there is no row `x`; rows are A, b.1"),
        (
            ["rows.A.passes[2].fps=4"],
            {},
            "--set rows.A.passes[2].fps: `rows.A.passes` is a list; its entries are 0 to 1",
        ),
        (
            ["rows.A.passes[0].video.name=4"],
            {},
            "--set rows.A.passes[0].video.name: `rows.A.passes.0.video` is a value",
        ),
        (["fps"], {}, "--set fps: give a key and its value"),
        (["a..b=3"], {}, "--set a..b=3: give a key and its value"),
        (
            ["fps=[1"],
            {},
            "--set fps: `fps`: a number is expected (it is '[1'",
        ),
        (["rows.1." * 2000 + "fps=5"], {}, "--set " + ("rows.1." * 9)[:60] + ": give a key"),
        ([], {"SAVMAP__": "4"}, "SAVMAP__: put two underscores"),
        (["fps=0"], {"SAVMAP__FPS": "400"}, "--set fps: `fps`: input should be greater than 0"),
        (
            ["rows.A.passes[1].direction=+x"],
            {},
            "--set rows.A.passes[1].direction: `rows.A.passes[1]`: a face on the right",
        ),
        (["rows.A.passes[1].video=null"], {}, "--set rows.A.passes[1].video: `rows.A.passes[1].video` is missing"),
        (["layout.aisle_m=3"], {}, "--set layout.aisle_m: `layout.rack_m` is missing"),
    ],
)
def test_mistakes_name_the_option_or_the_variable(
    tmp_path: Path, options: list[str], variables: dict[str, str], message: str
) -> None:
    with pytest.raises(SiteError) as caught:
        site(tmp_path, *options, **variables)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_other_mistakes_still_name_their_line(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(SITE.replace("side: left", "side: up"), encoding="utf-8")
    with pytest.raises(SiteError, match=r"site.yaml:8: `rows.A.passes\[0\].side`"):
        load_site(path, overrides_of(["rows.A.passes[1].fps=5"], {}))


def test_names_that_differ_in_case_alone_need_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(SITE.replace("b.1", "a"), encoding="utf-8")
    assert load_site(path, overrides_of(["rows.A.fps=5"], {})).rows["A"].passes[0].fps == 5
    assert load_site(path, overrides_of([], {"SAVMAP__ROWS__A__FPS": "5"})).rows["a"].passes[0].fps == 5
