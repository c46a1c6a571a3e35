"""The viewer's page as text, and what is written beside it."""

import hashlib
import re
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_map import EVIL, data_of, photo, places, row, site, stills

from savmap.apps.viewer import page as page_module
from savmap.apps.viewer.page import View, write_view
from savmap.apps.viewer.serve import ViewServer
from savmap.types import Evaluation, Score, SiteMap

NAME = "Süd/1 #"


def written(folder: Path, view: View) -> Path:
    write_view(view, folder / "view.html")
    return folder / "view.html"


def scripts(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*.js")}


def test_no_text_of_the_map_is_in_the_page(tmp_path: Path) -> None:
    page = written(tmp_path, View(site("A", EVIL), title=EVIL)).read_text(encoding="utf-8")
    assert "<img src=x" not in page
    assert page.count("<script") == 2
    assert page.count("</script") == 2
    assert "default-src 'none'" in page
    folder = Path(page_module.__file__).with_name("source")
    own = [file for file in folder.rglob("*.js") if "node_modules" not in file.parts]
    assert len(own) > 20
    assert not [file for file in own if re.search("(inner|outer)HTML|insertAdjacentHTML", file.read_text("utf-8"))]


def test_page_is_the_same_each_time(tmp_path: Path) -> None:
    first = written(tmp_path / "1", View(site("A"))).read_bytes()
    assert written(tmp_path / "2", View(site("A"))).read_bytes() == first


def test_coordinates_are_those_of_the_map(tmp_path: Path) -> None:
    (found,) = data_of(written(tmp_path, View(SiteMap({"A": row()}, {}))))["rows"]
    shapes = [shape for group in row().structures.values() for shape in group]
    places = np.array(found["positions"]).reshape(-1, 3) * 1e-5
    assert np.allclose(places, np.concatenate([shape.vertices for shape in shapes]), atol=1e-6)
    assert found["covariances"][:6] == [9e-6, 0, 0, 1.6e-5, 0, 1e-6]
    assert [entry["id"] for entry in found["structures"]] == [shape.id for shape in shapes]
    assert found["grade"] == "check"


def test_a_part_of_a_place_has_the_sizes_that_the_whole_has_not(tmp_path: Path) -> None:
    (found,) = data_of(written(tmp_path, View(SiteMap({"A": row()}, {}), places=places())))["rows"]
    corners = [10000, 0, 0, 280000, 410000, 0]
    assert found["places"] == [
        {"id": "bay 1", "sizes": {"clear width": [2.7, 0.0042]}, "corners": corners},
        {"id": "bay 1 / space 0", "sizes": {"clear height": [2.0, 0.0014]}, "corners": corners},
        {"id": "bay 1 / space 1", "sizes": {"clear height": [1.9, 0.002]}, "corners": corners},
        {"id": "bay 1 / space 2", "sizes": {}, "corners": corners},
    ]
    assert data_of(written(tmp_path, View(SiteMap({"B": row("B")}, {}), places=places())))["rows"][0]["places"] == []


def test_errors_of_a_survey_are_those_of_row_and_plugin(tmp_path: Path) -> None:
    both = replace(row(), structures={name: row().structures["things"][:3] for name in ("things", "others")})
    deviations = {"A": {"others": {"post 1": 0.0123, "post 2": np.inf}}, "B": {"things": {"post 1": 1.0}}}
    data = data_of(written(tmp_path, View(SiteMap({"A": both}, {}), Evaluation({"A": Score()}, deviations=deviations))))
    assert data["surveyed"] is True
    assert [entry["off"] for entry in data["rows"][0]["structures"]] == [None, None, None, 0.0123, "spurious", None]


def test_pictures_lie_beside_the_page(tmp_path: Path) -> None:
    name = NAME
    one = SiteMap({name: replace(row(), name=name)}, {})
    page = written(tmp_path, View(one, photos={name: photo()}, stills={name: stills()}))
    quoted = "S%C3%BCd%2F1 %23"
    names = {f"face/{quoted}.js", f"face/small/{quoted}.js", *(f"pano/{quoted}-{n:05d}.js" for n in (0, 6, 12, 18))}
    assert scripts(tmp_path) == names
    (found,) = data_of(page)["rows"]
    assert {*found["face"]["pictures"], *(one["path"] for one in found["stills"])} == names
    text = (tmp_path / f"pano/{quoted}-00006.js").read_text()
    assert re.fullmatch(r'savmapPart\("[^"]+", "data:image/jpeg;base64,[A-Za-z0-9+/=]+"\);\n', text)


def test_scripts_of_rows_that_are_gone_go(tmp_path: Path) -> None:
    two = SiteMap({"A": row(), "B": row("B")}, {})
    pictures: dict[str, Any] = {"photos": {"A": photo(), "B": photo()}, "stills": {"A": stills(), "B": stills()}}
    written(tmp_path, View(two, **pictures))
    (tmp_path / "face" / "own.js").write_text("alert(1)")
    (tmp_path / "face" / "renamed.js").write_bytes((tmp_path / "face" / "B.js").read_bytes())
    one = SiteMap({"A": row()}, {})
    own = {"face/A.js", "face/small/A.js", "face/own.js", "face/renamed.js"}
    page = written(tmp_path, View(one, photos={"A": photo()}))  # a map's stills cannot be made again
    assert len(data_of(page)["rows"][0]["stills"]) == 4
    assert scripts(tmp_path) == own | {f"pano/{name}-{n:05d}.js" for name in "AB" for n in (0, 6, 12, 18)}
    written(tmp_path, View(one, photos={"A": photo()}, stills={"A": stills()[:1]}))
    assert scripts(tmp_path) == own | {"pano/A-00000.js"}


def test_scripts_differ_in_more_than_case(tmp_path: Path) -> None:
    one = SiteMap({name: row(name) for name in ("a", "A", "B")}, {})
    page = written(tmp_path, View(one, photos=dict.fromkeys("aAB", photo()), stills=dict.fromkeys("aAB", stills()[:1])))
    found = scripts(tmp_path)
    assert len({path.casefold() for path in found}) == len(found) == 9
    assert {"face/A.js", "face/B.js"} < found
    shown = {entry["name"]: entry for entry in data_of(page)["rows"]}
    assert shown["a"]["face"]["pictures"][1] != shown["A"]["face"]["pictures"][1]
    assert {path for entry in shown.values() for path in entry["face"]["pictures"]} < found
    again = data_of(written(tmp_path, View(one)))["rows"]
    assert [entry["stills"] for entry in again] == [shown[entry["name"]]["stills"] for entry in again]


def test_large_joint_covariances_lie_beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = SiteMap({"A": row()}, {})
    assert "covariance" in data_of(written(tmp_path / "1", View(one)))["rows"][0]["joint"]
    monkeypatch.setattr(page_module, "MOST_JOINT", 100)
    assert data_of(written(tmp_path / "2", View(one)))["rows"][0]["joint"]["path"] == "joint/A.js"
    assert scripts(tmp_path / "2") == {"joint/A.js"}


def test_bundle_is_that_of_its_sources() -> None:
    folder = Path(page_module.__file__).parent
    files = {file.relative_to(folder / "source").as_posix(): file for file in (folder / "source").rglob("*.*")}
    own = [name for name in sorted(files) if re.fullmatch(r"(?!node_modules/).*\.(m?js|json)", name)]
    digest = hashlib.sha256(b"".join(files[name].read_bytes() for name in own)).hexdigest()
    head = (folder / "viewer.js").read_text(encoding="utf-8")[:2000]
    assert digest in head, "run `npm ci && npm run build` in savmap/apps/viewer/source"
    assert "three.js authors" in head


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    page = written(tmp_path, View(SiteMap({"A": row()}, {}), photos={"A": photo()}))
    (tmp_path / "secret.txt").write_text("secret")
    with ViewServer(page) as own:
        thread = threading.Thread(target=own.run)
        thread.start()
        yield own.address
        own.stop()
        thread.join()


def status(address: str, **headers: str) -> int:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    request = urllib.request.Request(address, headers=named)
    try:
        with urllib.request.urlopen(request) as answer:
            code: int = answer.status
            return code
    except urllib.error.HTTPError as error:
        error.close()
        return error.code


def test_server_gives_this_machine_the_page_and_nothing_else(server: str) -> None:
    assert server.startswith("http://127.0.0.1:")
    assert status(server) == status(f"{server}face/A.js") == 200
    assert {status(server + path) for path in ("secret.txt", "face/", "face/..%2fsecret.txt", "other/A.js")} == {404}
    assert status(f"{server}face/%ED%A0%80.js") in (400, 404)  # a name that no file has
    assert status(server, Host="attacker.example") == 421


def test_server_gives_other_sites_nothing(server: str) -> None:
    with urllib.request.urlopen(f"{server}face/A.js") as answer:
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
    for where in ("cross-site", "same-site"):
        assert status(f"{server}face/A.js", Sec_Fetch_Site=where, Sec_Fetch_Dest="script") == 403
        assert status(server, Sec_Fetch_Site=where, Sec_Fetch_Dest="iframe") == 403
        assert status(server, Sec_Fetch_Site=where, Sec_Fetch_Dest="document") == 200
    assert status(f"{server}face/A.js", Sec_Fetch_Site="same-origin", Sec_Fetch_Dest="script") == 200


@pytest.mark.parametrize(
    ("target", "host"),
    [("x.js", "localhost"), ("/", "["), ("/face/%00.js", "localhost")],
)
def test_server_refuses_malformed_requests(
    server: str, target: str, host: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection((server.split("/")[2].split(":")[0], int(server.split(":")[2][:-1]))) as link:
        link.sendall(f"GET {target} HTTP/1.0\r\nHost: {host}\r\n\r\n".encode())
        answer = link.makefile("rb").read()
    assert b" 400 " in answer.splitlines()[0]
    assert "Traceback" not in capfd.readouterr().err
