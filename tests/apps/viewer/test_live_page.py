"""The page that follows a live session: what it is sent, what it shows, and to whom it is given."""

import http.client
import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from opened_page import until

from savmap.apps.viewer.live import LiveServer, events_of, live_page, plan_of
from savmap.maps.map_file import write_map
from savmap.types import FrameTable, RowMap, SiteMap, Structure, Trajectory

STATE = {"status": "walking", "advice": [], "frames": 3}


def site_map(probability: float = 1.0) -> SiteMap:
    vertices = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    part = Structure(
        "post 1",
        "post",
        vertices,
        np.full((2, 3, 3), 4e-6),
        ("low", "high"),
        np.array([[0, 1]]),
        {"probability": probability},
    )
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    return SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"posts": (part,)}, ())}, {"savmap": "0"})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "live.json").write_text(json.dumps(STATE))
    write_map(site_map(), tmp_path / "map.json")
    (tmp_path / "view.html").write_text("<title>latest</title>")
    return tmp_path


@pytest.fixture
def server(folder: Path) -> Iterator[LiveServer]:
    with LiveServer(folder) as served:
        thread = threading.Thread(target=served.run, daemon=True)
        thread.start()
        yield served
        served.stop()
        thread.join()


def answer(server: LiveServer, path: str, **headers: str) -> tuple[int, str]:
    port = int(server.address.rsplit(":", 1)[1].rstrip("/"))
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=600)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    reply = connection.getresponse()
    text = reply.read(60 if path == "/events" else None).decode() if reply.status == 200 else ""
    connection.close()
    return reply.status, text


def test_events_tell_of_the_state_and_of_each_new_map(folder: Path) -> None:
    events = events_of(folder)
    first = next(events)
    assert first.startswith(f"event: state\ndata: {json.dumps(STATE)}\n\nevent: map\n")
    (folder / "live.json").write_text(json.dumps(STATE | {"frames": 4}))
    assert next(events) == f"event: state\ndata: {json.dumps(STATE | {'frames': 4})}\n\n"
    write_map(site_map(0.5), folder / "map.json")
    (folder / "view.html").write_text("<title>later</title>")
    assert json.loads(next(events).split("data: ")[1])["elements"][0]["probability"] == 0.5


def test_plan_has_edges_sigma_and_probability(folder: Path) -> None:
    (element,) = plan_of(folder / "map.json")["elements"]  # type: ignore[misc]
    assert element == {"id": "post 1", "edges": [[0.0, 0.0, 0.0, 2.0]], "sigma_mm": 2.0, "probability": 1.0}


def test_a_new_map_is_told_of_once_its_page_is_there(folder: Path) -> None:
    events = events_of(folder)
    next(events)
    write_map(site_map(0.5), folder / "map.json")
    (folder / "live.json").write_text(json.dumps(STATE | {"frames": 4}))
    assert "event: map" not in next(events)


def test_plan_leaves_assumed_ends_out_of_sigma(tmp_path: Path) -> None:
    made = site_map()
    (part,) = made.rows["A"].structures["posts"]
    unsure = np.array([[4e-6], [4.0]])[..., None] * np.eye(3)
    part = replace(part, covariances=unsure, attributes={**part.attributes, "ends": "high assumed"})
    write_map(replace(made, rows={"A": replace(made.rows["A"], structures={"posts": (part,)})}), tmp_path / "map.json")
    (element,) = plan_of(tmp_path / "map.json")["elements"]  # type: ignore[misc]
    assert element["sigma_mm"] == 2.0


def test_a_map_that_is_not_there_has_no_elements(tmp_path: Path) -> None:
    assert plan_of(tmp_path / "map.json") == {"elements": []}


def test_page_events_and_map_are_served(server: LiveServer) -> None:
    assert answer(server, "/")[1] == live_page()
    assert answer(server, "/view.html")[1] == "<title>latest</title>"
    assert answer(server, "/events")[1].startswith("event: state")


def test_nothing_else_of_the_folder_is_given(server: LiveServer) -> None:
    assert answer(server, "/live.json")[0] == 404
    assert answer(server, "/../x")[0] in (400, 404)


def test_other_sites_are_refused(server: LiveServer) -> None:
    for path in ("/", "/events"):
        assert answer(server, path, Host="example.org")[0] == 421
        assert answer(server, path, Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="empty")[0] == 403


@pytest.mark.extra("browser")
def test_page_shows_what_to_do(server: LiveServer, folder: Path, chromium: Any) -> None:
    advice = {"code": "too-fast", "severity": "attention", "text": "Walk more slowly.", "arrow": "back"}
    state = STATE | {"advice": [advice], "footage_s": 3.0, "measured": 2, "elements": 1, "maps": 1, "problem": ""}
    (folder / "live.json").write_text(json.dumps(state))
    page = chromium.new_page()
    page.goto(server.address)
    page.wait_for_function("document.getElementById('text').textContent == 'Walk more slowly.'")
    assert page.evaluate("document.getElementById('bar').className") == "attention"
    page.wait_for_selector("#plan path", state="attached")
    assert page.evaluate("document.querySelector('#plan path').getAttribute('class')") == "fine"
    page.close()


@pytest.mark.extra("browser")
def test_page_says_how_the_walk_ended(server: LiveServer, folder: Path, chromium: Any) -> None:
    page = chromium.new_page()
    page.goto(server.address)
    checked = "1 of 1 row must be checked: A"
    ends = (
        ("mapping", "", "good", "The walk has ended. All that was recorded is being mapped."),
        ("mapped", "", "good", "Done: all is mapped, and nothing speaks against it."),
        ("mapped", checked, "attention", f"Done: all is mapped, but {checked}."),
        ("failed", "no row is seen", "stop", "The walk has ended, and no final map was made: no row is seen"),
    )
    for status, problem, severity, text in ends:
        figures = {"footage_s": 3.0, "measured": 3, "elements": 1, "maps": 0}
        state = STATE | figures | {"status": status, "problem": problem}
        (folder / "live.json").write_text(json.dumps(state))
        until(page, f"document.getElementById('text').textContent == {json.dumps(text)}")
        assert page.evaluate("document.getElementById('bar').className") == severity
        assert page.inner_text("#figures").split(" · ")[1] == ("3 frames" if status == "mapped" else "3 of 3 frames")
        assert page.inner_text("#problem") == ""
    page.close()
