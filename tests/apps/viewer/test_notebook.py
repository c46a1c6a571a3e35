"""A map in a notebook: the summary is small, safe and whole, and the viewer's frame is served to the notebook alone."""

import base64
import re
import urllib.request
import webbrowser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from made_up_map import EVIL
from made_up_map import row as viewed_row
from made_up_page import drawings, row
from parsed_page import Element, parsed
from test_viewer import status

import savmap
from savmap.apps.viewer import notebook
from savmap.maps.map_file import write_map
from savmap.types import Drawing, MapWarning, RowMap, SiteMap, Verdict


@pytest.fixture(autouse=True)
def _plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    def drawn(own: RowMap, *_: object) -> Sequence[Drawing]:
        return drawings(own)

    assert savmap.load_map, "what gives maps lets notebooks show them"
    monkeypatch.setattr(notebook, "plugins_of_map", lambda site: dict.fromkeys(site.rows))
    monkeypatch.setattr(notebook, "drawings_of", drawn)


def shown(site: SiteMap) -> Element:
    text = site._repr_html_() or ""
    found = parsed(re.sub(r"<img ([^>]*)>", r"<img \1/>", text))
    assert "://" not in text
    assert not found.all("script")
    assert not [name for own in found.all() for name in own.given if name.startswith("on")]
    return found


def test_map_shows_its_rows_with_their_faces() -> None:
    warned = replace(row("B"), verdict=Verdict((MapWarning("uncertain-element", ("post 1",)),)))
    found = shown(SiteMap({"A": replace(row("A"), verdict=Verdict()), "B": warned}, {}, {"C": "no video"}))
    assert found.one("strong").text == "1 of 3 rows could not be mapped: C; 1 of 3 rows must be checked: B"
    cells = [[cell.text for cell in line.all("th") + line.all("td")] for line in found.one("tbody").all("tr")]
    assert cells[0] == ["C", "failed", "\u2013", "\u2013", "\u2013", "no video"]
    assert cells[1] == ["A", "trusted", "3", "4", "6.10", ""]
    assert cells[2][1] == "check"
    pictures = [picture.given["src"].partition("base64,")[2] for picture in found.all("img")]
    assert ["Row A" in base64.b64decode(text).decode() for text in pictures] == [True, False]


def test_map_shows_names_as_words() -> None:
    found = shown(SiteMap({EVIL: row(EVIL)}, {}, {"<b>": EVIL}))
    assert [line.one("th").text for line in found.one("tbody").all("tr")] == ["<b>", EVIL]
    assert not found.all("b")


def test_map_of_many_rows_stays_small() -> None:
    rows = {str(k): row(str(k), sections=15, levels=8) for k in range(30)}
    text = SiteMap(rows, {})._repr_html_() or ""
    assert len(text) < 200_000
    count = text.count("<img ")
    assert 3 < count < 30
    assert f"{30 - count} more rows: <code>savmap.view(site_map)</code>" in text


def test_map_of_plugins_that_are_not_here_is_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: SiteMap) -> None:
        raise savmap.SavmapError("plugin `racks` is not installed")

    assert savmap.load_map, "what gives maps lets notebooks show them"
    monkeypatch.setattr(notebook, "plugins_of_map", missing)
    found = shown(SiteMap({"A": row("A")}, {}))
    assert not found.all("img")
    assert "No pictures: plugin `racks` is not installed" in found.text


def test_view_is_opened_outside_of_notebooks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    write_map(SiteMap({"A": viewed_row("A")}, {}), tmp_path / "map.json")
    first, again = savmap.view(tmp_path), savmap.view(str(tmp_path / "map.json"), show=False)
    assert (first.page, first.written, again.written) == (tmp_path / "view.html", True, False)
    assert opened == [first.page.as_uri()]
    record = savmap.view(SiteMap({"A": viewed_row("A")}, {}))
    assert record.page.is_file()
    assert opened[1:] == [record.page.as_uri()]


def test_view_is_served_to_the_frame_that_has_its_key(tmp_path: Path) -> None:
    write_map(SiteMap({"A": viewed_row("A")}, {}), tmp_path / "map.json")
    view = savmap.view(tmp_path, show=False)
    frame = parsed(view._repr_html_()).one("iframe").given["src"]
    assert parsed(view._repr_html_()).one("iframe").given["src"] == frame
    headers = {"Sec_Fetch_Site": "same-site", "Sec_Fetch_Dest": "iframe"}
    assert status(frame, **headers) == 200
    assert status(frame.partition("?")[0], **headers) == status(f"{frame}x", **headers) == 403
    assert status(frame, Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="script") == 403
    with urllib.request.urlopen(frame) as answer:
        assert answer.read() == view.page.read_bytes()
    view.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(frame)


@pytest.mark.slow
def test_notebook_shows_map_and_viewer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    write_map(SiteMap({"A": viewed_row("A")}, {}), tmp_path / "map.json")
    cells = [
        "import savmap\nsite_map = savmap.load_map('map.json')",
        "site_map",
        "savmap.view('map.json')",
        "savmap.view(site_map)",
    ]
    book: Any = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": tmp_path}}).execute()
    table, beside, record = (cell.outputs[0].data["text/html"] for cell in book.cells[1:])
    assert "<table>" in table
    assert '<iframe src="http://127.0.0.1:' in beside
    assert "savmap-view-" in record
    assert (tmp_path / "view.html").is_file()
