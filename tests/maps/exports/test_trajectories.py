"""Trajectories and recordings, read by the programs that they are for."""

import json
import os
import stat
import subprocess
import sys
import zipfile
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.apps.exchange.recordings import MapRecorder
from savmap.errors import OutputError
from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.jobs.api import export
from savmap.maps.exports.frames import world_from_site
from savmap.types import Floats, FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory

HOSTILE = '"\n</script>\u202e\\../x 日本'
PLACES = np.array([[0.0, 1, 0], [2.7, 1, 0], [2.7, 1.1, 0]])


def row(name: str, label: str = "bar 1") -> RowMap:
    thing = Structure(
        label,
        "bar",
        PLACES,
        np.tile(4e-6 * np.eye(3), (3, 1, 1)),
        ("a", "b", "c"),
        np.array([[0, 1], [1, 2]]),
        {"text": label},
    )
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("yxz", [[180, 5 * k, 3 * k] for k in range(4)], degrees=True).as_matrix()
    poses[:, :3, 3] = [[0.5 * k, 3.0, 1.5] for k in range(4)]
    table = FrameTable(np.arange(4) / 15, ("there", "there", "back", "back"))
    return RowMap(name, table, {}, Trajectory(np.arange(4), poses), {"things": (thing,)}, ())


def one_pass() -> SiteMap:
    whole = row("A")
    table = FrameTable(whole.frames.stamps_s, ("there",) * 4)
    return SiteMap({"A": RowMap("A", table, {}, whole.trajectory, whole.structures, ())}, {})


def _output(*command: str | Path) -> str:
    quiet = {**os.environ, "CI": "1"}  # else rerun reports to its maker, and writes to the home folder
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=quiet)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def poses_of(site: SiteMap) -> Floats:
    poses: Floats = world_from_site(None) @ next(iter(site.rows.values())).trajectory.world_from_rig
    return poses


def test_tum_is_a_table_of_poses(tmp_path: Path) -> None:
    site = one_pass()
    export(site, tmp_path / "a.tum")
    table = np.loadtxt(tmp_path / "a.tum")
    np.testing.assert_allclose(table[:, 1:4], poses_of(site)[:, :3, 3], atol=1e-8)
    turns = Rotation.from_quat(table[:, 4:]).as_matrix()
    np.testing.assert_allclose(turns, poses_of(site)[:, :3, :3], atol=1e-8)


def test_tum_is_read_by_evo(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface", reason="evo is no dependency")
    site = one_pass()
    export(site, tmp_path / "a.tum")
    read = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    np.testing.assert_allclose(read.poses_se3, poses_of(site), atol=1e-6)
    np.testing.assert_allclose(read.timestamps, np.arange(4) / 15, atol=1e-6)


def test_passes_are_not_mixed_in_one_tum_file(tmp_path: Path) -> None:
    site = SiteMap({"A": row("A")}, {})
    with pytest.raises(OutputError, match="one pass, and the map has 2: name a"):
        export(site, tmp_path / "a.tum")
    export(site, tmp_path / "a.zip", "tum")
    assert zipfile.ZipFile(tmp_path / "a.zip").namelist() == ["A/back.tum", "A/there.tum"]
    assert {stat.filemode(file.external_attr >> 16) for file in zipfile.ZipFile(tmp_path / "a.zip").filelist} == {
        "-rw-r--r--"
    }


def test_no_two_rows_share_a_folder(tmp_path: Path) -> None:
    names = ("A/1", "A_1", "Gang \xc4", "Gang \xd6", "x", "X")
    site = SiteMap(
        {name: row(name) for name in names}, {}, placements={n: Placement(0, 0, 0, np.eye(3)) for n in names}
    )
    export(site, tmp_path / "a.zip", "tum")
    files = zipfile.ZipFile(tmp_path / "a.zip").namelist()
    assert len({name.casefold() for name in files}) == 2 * len(names)
    export(site, tmp_path / "transforms.json", "nerfstudio")
    pictures = [frame["file_path"] for frame in json.loads((tmp_path / "transforms.json").read_text())["frames"]]
    assert len(set(pictures)) == 4 * len(names)


@pytest.mark.extra("validators")
def test_colmap_sees_vertices_where_savmap_does(tmp_path: Path) -> None:
    """A COLMAP pixel is savmap's and a half."""
    import pycolmap

    site = one_pass()
    export(site, tmp_path / "model.zip", "colmap")
    zipfile.ZipFile(tmp_path / "model.zip").extractall(tmp_path / "model")
    model = pycolmap.Reconstruction(tmp_path / "model")
    points = np.array([model.points3D[number].xyz for number in sorted(model.points3D)])
    np.testing.assert_allclose(points, PLACES @ world_from_site(None)[:3, :3].T, atol=1e-4)
    camera = next(iter(model.cameras.values()))
    for number, world_from_rig in enumerate(poses_of(site), 1):
        image = model.images[number]
        assert image.name == f"A/there/{round(1000 * (number - 1) / 15):08d}.jpg"
        rays = (points - world_from_rig[:3, 3]) @ world_from_rig[:3, :3]
        seen = camera.img_from_cam(image.cam_from_world() * points)
        np.testing.assert_allclose(seen, panorama_pixels_from_rays(rays, 1920) + 0.5, atol=1e-2)


def test_nerfstudio_has_poses_in_axes_of_opengl(tmp_path: Path) -> None:
    site = one_pass()
    export(site, tmp_path / "transforms.json", "nerfstudio")
    content = json.loads((tmp_path / "transforms.json").read_text())
    assert (content["camera_model"], content["fl_x"], content["w"]) == ("EQUIRECTANGULAR", 1920.0, 3840)
    camera = np.array(content["frames"][1]["transform_matrix"])
    rig = poses_of(site)[1]
    np.testing.assert_allclose(camera[:3, 3], rig[:3, 3], atol=1e-8)
    np.testing.assert_allclose(-camera[:3, 2], rig[:3, 2], atol=1e-8)
    np.testing.assert_allclose(camera[:3, 1], -rig[:3, 1], atol=1e-8)


@pytest.mark.extra("ros")
def test_mcap_holds_foxgloves_messages(tmp_path: Path) -> None:
    from mcap import reader

    site = SiteMap({"A": row("A", HOSTILE)}, {})
    export(site, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as stream:
        found = [
            (schema.name, channel.topic, json.loads(message.data))
            for schema, channel, message in reader.make_reader(stream).iter_messages()
        ]
    assert sorted(topic for _, topic, _ in found) == ["/drive/A/back", "/drive/A/there", "/map"]
    scene = next(message for name, _, message in found if name == "foxglove.SceneUpdate")
    (entity,) = scene["entities"]
    points = np.array([[point[axis] for axis in "xyz"] for point in entity["lines"][0]["points"]])
    np.testing.assert_allclose(points, PLACES[[0, 1, 1, 2]] @ world_from_site(None)[:3, :3].T, atol=1e-9)
    metadata = {pair["key"]: pair["value"] for pair in entity["metadata"]}
    assert (metadata["row"], metadata["sigma of b, mm"]) == ("A", "2.0 2.0 2.0")
    drive = next(message for _, topic, message in found if topic == "/drive/A/back")
    assert [pose["position"]["z"] for pose in drive["poses"]] == [3.0, 3.0]


@pytest.mark.extra("ros")
def test_a_recorder_replaces_maps_and_is_read_without_its_end(tmp_path: Path) -> None:
    from mcap.exceptions import EndOfFile
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    site = SiteMap({"A": row("A")}, {})
    with MapRecorder(tmp_path / "a.mcap", chunked=False) as recorder:
        recorder.say("Walk more slowly.", 3, 0.5)
        recorder.add(site, 1.0)
        recorder.add(site, 2.0)
        content = (tmp_path / "a.mcap").read_bytes()  # as a program leaves it that is killed now
    messages = []
    with suppress(EndOfFile):
        messages += (record for record in StreamReader(BytesIO(content)).records if isinstance(record, Message))
    assert [message.log_time for message in messages] == [500_000_000, *[1_000_000_000] * 3, *[2_000_000_000] * 3]
    advice, first, *_, second, _, _ = [json.loads(message.data) for message in messages]
    assert (advice["message"], advice["level"]) == ("Walk more slowly.", 3)
    assert (first["deletions"], [deletion["type"] for deletion in second["deletions"]]) == ([], [1])


@pytest.mark.extra("ros")
def test_a_recorder_without_room_says_so(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"a\.mcap: cannot be written \(no such file or directory"):
        MapRecorder(tmp_path / "none" / "a.mcap")


@pytest.mark.extra("ros")
def test_rosbag_holds_markers(tmp_path: Path) -> None:
    from mcap import reader
    from mcap_ros2 import decoder

    export(SiteMap({"A\n": row("A\n")}, {}), tmp_path / "a.mcap", "rosbag2")
    with (tmp_path / "a.mcap").open("rb") as stream:
        bag = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        assert bag.get_header().profile == "ros2"
        ((schema, channel, _, message),) = bag.iter_decoded_messages()
    assert (schema.name, channel.topic) == ("visualization_msgs/msg/MarkerArray", "/savmap/map")
    lines, text = message.markers
    assert lines.ns == "A\\n/things/bar"
    assert (lines.type, text.type, text.text, lines.header.frame_id) == (5, 9, "bar 1", "map")
    points = np.array([[point.x, point.y, point.z] for point in lines.points])
    np.testing.assert_allclose(points, PLACES[[0, 1, 1, 2]] @ world_from_site(None)[:3, :3].T, atol=1e-9)


@pytest.mark.extra("rerun")
def test_rerun_reads_its_recording(tmp_path: Path) -> None:
    export(SiteMap({"A": row("A")}, {}), tmp_path / "a.rrd")
    rerun = [sys.executable, "-m", "rerun", "rrd"]
    assert "verified without error" in _output(*rerun, "verify", tmp_path / "a.rrd")
    content = _output(*rerun, "print", tmp_path / "a.rrd").replace("\\", "")
    for entity in ("/map/A/things/bar 1", "/drive/A/there/rig", "/drive/A/back/rig"):
        assert entity in content
