"""Rerun recordings, read back by Rerun's own reader and held against the store."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.helpers import tree
from support.places import TINY
from support.scenes import cube_spec
from support.stored import varied, with_a_quarantined_row

from grasp_factory.apps.rerun import RRD, default_file, sdk
from grasp_factory.core.enums import label_names
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, pose_matrices
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError, UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.signals.plot_series import curve_groups, in_shown_unit, phase_spans
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

rr = pytest.importorskip("rerun")

from grasp_factory.apps.rerun import recording  # noqa: E402
from grasp_factory.apps.rerun.robot_urdf import seen_urdf  # noqa: E402
from grasp_factory.apps.rerun.words import episode_text  # noqa: E402

Run = Callable[..., tuple[int, str, str]]
Rows = list[tuple[float | None, dict[str, Any]]]


class Read:
    """A recording as Rerun's reader has it: by entity, rows of a time (s) and components."""

    def __init__(self, path: Path) -> None:
        reader = rr.chunk.RrdReader(path)
        (entry,) = reader.recordings()
        self.application, self.id = entry.application_id, entry.recording_id
        self.blueprints = len(reader.blueprints())
        self.timelines: set[str] = set()
        self.rows: dict[str, Rows] = {}
        for chunk in reader.stream(store=entry).to_chunks():
            self.timelines |= set(chunk.timeline_names)
            table = chunk.to_record_batch()
            times: list[float | None] = [None] * chunk.num_rows
            if not chunk.is_static:
                nanoseconds = table.column("time").to_numpy(zero_copy_only=False)
                times = (nanoseconds.astype(np.int64) / 1e9).tolist()
            names = [name for name in table.schema.names if ":" in name]
            columns = {name: table.column(name).to_pylist() for name in names}
            for i, time in enumerate(times):
                values = {name: column[i] for name, column in columns.items()}
                self.rows.setdefault(chunk.entity_path, []).append((time, values))

    def series(self, entity: str, component: str) -> tuple[Array, list[Any]]:
        """Return times and values of a component over time."""
        rows = [(t, v[component]) for t, v in self.rows[entity] if t is not None and component in v]
        rows.sort(key=lambda row: row[0])
        return np.array([time for time, _ in rows]), [value for _, value in rows]

    def static(self, entity: str, component: str) -> Any:
        """Return a component that does not change."""
        (found,) = [v[component] for t, v in self.rows[entity] if t is None and component in v]
        return found

    def poses(self, entity: str) -> tuple[Array, Array]:
        """Return times (n,) and transforms (n, 4, 4) of an entity."""
        times, places = self.series(entity, "Transform3D:translation")
        _, turns = self.series(entity, "Transform3D:quaternion")
        both = np.hstack([np.array(places)[:, 0], np.array(turns)[:, 0]])
        return times, pose_matrices(both)


def written(store: Path, index: int, folder: Path) -> tuple[Episode, Read]:
    dataset = Dataset(store)
    recording.write_recording(dataset, index, folder / "r.rrd")
    return dataset[index], Read(folder / "r.rrd")


@pytest.fixture(scope="module", params=["tiny", pytest.param("varied", marks=pytest.mark.slow)])
def both(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Episode, Read]:
    """Return an episode and its recording: as shipped, and with all that there can be."""
    store = TINY if request.param == "tiny" else varied()
    return written(store, 0, tmp_path_factory.mktemp("recording"))


class TestARecording:
    @pytest.mark.slow
    def test_has_one_clock_a_layout_and_a_name_that_stays(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        assert read.timelines == {"time"}
        assert read.blueprints == 1
        assert (read.application, read.id) == ("grasp_factory", episode.checksum())

    def test_has_every_scalar_at_its_time(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        com, rest = episode.columns["object_com"][0], episode.columns["rest_height"]
        groups = curve_groups(episode.streams, episode.imu, com, float(rest))
        assert {f"/series/{g.key}" for g in groups} == {
            entity for entity in read.rows if entity.startswith("/series/")
        }
        for group in map(in_shown_unit, groups):
            times, values = read.series(f"/series/{group.key}", "Scalars:scalars")
            clock = episode.imu if group.clock == "imu" else episode.streams
            np.testing.assert_allclose(times, clock["timestamp"], atol=1e-9)
            np.testing.assert_array_equal(np.array(values), np.asarray(group.values, np.float64))
            names = read.static(f"/series/{group.key}", "SeriesLines:names")
            assert names == [f"{name}, {group.units}" for name in group.names]

    def test_has_the_joints_where_the_encoders_saw_them(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        _, values = read.series("/series/joint_positions", "Scalars:scalars")
        np.testing.assert_array_equal(np.array(values), episode.streams["joint_positions"])

    def test_moves_the_robot_so_that_its_hand_is_where_the_tcp_was(
        self, both: tuple[Episode, Read]
    ) -> None:
        """All transforms from the base to the TCP's frame, one after the other."""
        episode, read = both
        model = ROBOTS[episode.spec.robot]
        parent: dict[str, tuple[str, Array]] = {}
        for _, values in read.rows["/robot/joints"]:
            entity = next(k for k in values if k.endswith("child_frame"))
            child = values[entity][0]
            place = values["Transform3D:translation"][0] + values["Transform3D:quaternion"][0]
            T = np.tile(pose_matrices(place), (episode.n_steps, 1, 1))
            parent[child] = (values["Transform3D:parent_frame"][0], T)
        moving = [name for name in read.rows if name.startswith("/robot/joints/")]
        assert len(moving) == len(model.arm_joints) + 2
        for entity in moving:
            times, T = read.poses(entity)
            np.testing.assert_allclose(times[1:], episode.streams["timestamp"], atol=1e-9)
            _, children = read.series(entity, "Transform3D:child_frame")
            assert children[0][0] in parent
            parent[children[0][0]] = (parent[children[0][0]][0], T[1:])
        frame, T = f"robot/{model.tcp_link}", np.eye(4)
        while frame != f"robot/{model.base_link}":
            frame, step = parent[frame]
            T = step @ T
        tcp = pose_matrices(episode.streams["tcp_pose"])
        np.testing.assert_allclose(T, tcp, atol=2e-4)
        assert read.static("/robot/base", "Transform3D:child_frame") == [frame]

    def test_has_every_object_where_it_was(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        for m in range(len(episode.spec.objects)):
            times, T = read.poses(f"/world/objects/{label_names(9)[5 + m]}")
            assert times[0] == 0.0
            np.testing.assert_allclose(times[1:], episode.streams["timestamp"], atol=1e-9)
            stored = pose_matrices(episode.streams["object_pose"][:, m])
            np.testing.assert_allclose(T[1:], stored, atol=1e-6)

    def test_has_every_image_without_loss(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        end = episode.streams["timestamp"][-1]
        for name, frames in episode.cameras.items():
            entity = f"/world/cameras/{name}"
            times, blobs = read.series(f"{entity}/rgb", "EncodedImage:blob")
            images = [
                cv2.imdecode(np.array(blob[0], np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
                for blob in blobs
            ]
            video, between = episode.videos.get(f"{name}/rgb", []), episode.videos.get("timestamp")
            np.testing.assert_array_equal(images, [frames.rgb[0], *video, frames.rgb[1]])
            expected = [0.0, *([] if between is None else between), end]
            np.testing.assert_allclose(times, expected, atol=1e-9)
            for kind, archetype in (("depth", "DepthImage"), ("segmentation", "SegmentationImage")):
                times, buffers = read.series(f"{entity}/{kind}", f"{archetype}:buffer")
                stored = getattr(frames, kind)
                np.testing.assert_allclose(times, [0.0, end], atol=1e-9)
                for buffer, image in zip(buffers, stored, strict=True):
                    data = np.array(buffer[0], np.uint8).tobytes()
                    assert data == np.ascontiguousarray(image).tobytes()
            _, metres = read.series(f"{entity}/depth", "DepthImage:meter")
            assert metres == [[1.0]] * 2

    def test_has_every_camera_where_it_was(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        for name, frames in episode.cameras.items():
            entity = f"/world/cameras/{name}"
            K = np.array(read.static(entity, "Pinhole:image_from_camera")).reshape(3, 3).T
            np.testing.assert_allclose(K, frames.intrinsics, rtol=1e-6)
            height, width = frames.depth.shape[1:]
            assert read.static(entity, "Pinhole:resolution") == [[width, height]]
            times, T = read.poses(entity)
            assert times[0] == 0.0
            np.testing.assert_allclose(T[[0, -1]], frames.T_world_camera, atol=1e-4)
            if episode.videos:
                shots = np.searchsorted(times, episode.videos["timestamp"] + 1e-6) - 1
                stored = episode.videos[f"{name}/T_world_camera"]
                np.testing.assert_allclose(T[shots], stored, atol=1e-4)

    def test_names_the_labels(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        context = read.static("/world", "AnnotationContext:context")[0]
        named = {row["class_id"]: row["class_description"]["info"]["label"] for row in context}
        assert named == dict(enumerate(label_names(len(episode.spec.objects))))

    def test_has_the_cloud_in_its_colours(self, both: tuple[Episode, Read], tmp_path: Path) -> None:
        _, read = both
        times, points = read.series("/world/cloud", "Points3D:positions")
        _, colors = read.series("/world/cloud", "Points3D:colors")
        assert len(times) == 2
        assert [len(cloud) for cloud in points] == [len(cloud) for cloud in colors]
        assert min(len(cloud) for cloud in points) > 1000

    def test_tells_the_phases_and_the_outcome(self, both: tuple[Episode, Read]) -> None:
        episode, read = both
        spans = phase_spans(episode.streams)
        times, states = read.series("/phase", "StateChange:state")
        assert [state[0] for state in states] == [span.name for span in spans]
        np.testing.assert_allclose(times, [span.start for span in spans], atol=1e-9)
        _, texts = read.series("/log", "TextLog:text")
        assert texts[-1] == [f"outcome: {episode.outcome.name.lower()}"]
        assert read.static("/episode", "TextDocument:text") == [episode_text(episode)]

    def test_is_verified_by_the_sdk(self, both: tuple[Episode, Read], tmp_path: Path) -> None:
        store = TINY if both[0].spec.robot == "kuka_iiwa" else varied()
        recording.write_recording(Dataset(store), 0, tmp_path / "v.rrd")
        said = subprocess.run(
            [sdk.viewer(), "rrd", "verify", tmp_path / "v.rrd"],
            env=sdk.viewer_environment(tmp_path), capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert "1 file verified without error" in said.stdout + said.stderr


def test_a_cloud_of_very_many_points_is_thinned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp_factory.apps.rerun.cameras.MOST_POINTS", 100)
    _, read = written(TINY, 1, tmp_path)
    _, points = read.series("/world/cloud", "Points3D:positions")
    cloud = Dataset(TINY).point_cloud(1)
    assert [50 < len(some) <= 100 for some in points] == [True, True]
    stored = {tuple(point) for point in np.round(cloud.points, 4).tolist()}
    assert {tuple(point) for point in np.round(np.array(points[0]), 4).tolist()} <= stored


def test_an_attempt_that_met_something_has_what_there_is(tmp_path: Path) -> None:
    episode, read = written(TINY, 2, tmp_path)
    assert episode.outcome.name == "COLLISION"
    _, states = read.series("/phase", "StateChange:state")
    assert {state[0] for state in states} <= {"pregrasp", "approach"}


def test_an_attempt_that_never_started_has_the_scene_alone(tmp_path: Path) -> None:
    with World() as world:
        episode = run_episode(world, cube_spec((0.30, 0.30, 0.026), resolution=(64, 48)))
    assert episode.n_steps == 0
    tiny = Dataset(TINY)

    class One:
        status, path, config, point_cloud = [1], TINY, tiny.config, tiny.point_cloud

        def __getitem__(self, index: int) -> Episode:
            return episode

    recording.write_recording(One(), 0, tmp_path / "r.rrd")  # type: ignore[arg-type]
    read = Read(tmp_path / "r.rrd")
    times, _ = read.series("/world/cameras/front/depth", "DepthImage:buffer")
    assert times.tolist() == [0.0]
    np.testing.assert_allclose(read.poses("/world/objects/target")[1][0][:3, 3],
                               episode.columns["object_rest_pose"][0, :3], atol=1e-6)  # fmt: skip
    assert "/phase" not in read.rows
    _, texts = read.series("/log", "TextLog:text")
    assert texts == [["outcome: left_workspace"]]


def test_a_mesh_is_named_by_a_file_that_is_there() -> None:
    from xml.etree import ElementTree

    for model in ROBOTS.values():
        robot = ElementTree.fromstring(seen_urdf(model.path(), (1.0, 0.5, 0.0)))
        files = [mesh.get("filename", "") for mesh in robot.iter("mesh")]
        assert files
        assert [name for name in files if not Path(name).is_file()] == []
        assert {
            color.get("rgba") for link in robot.iter("visual") for color in link.iter("color")
        } == {"1 0.5 0 1"}
        assert not list(robot.iter("collision"))


class TestCommand:
    def test_writes_a_recording_with_a_name_of_its_own(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        before = tree(TINY)
        assert run("rerun", TINY, 1) == (0, "tiny-1.rrd\n", "")
        assert [file.name for file in tmp_path.iterdir()] == ["tiny-1.rrd"]
        assert RRD.is_that_of(tmp_path / "tiny-1.rrd")
        assert tree(TINY) == before
        assert run("rerun", TINY, 2, "--out", "tiny-1.rrd")[0] == 0  # one is replaced
        assert Read(tmp_path / "tiny-1.rrd").id == Dataset(TINY)[2].checksum()

    @pytest.mark.parametrize(
        ("args", "said"),
        [
            (("9",), "has episodes 0 to 3"),
            (("0", "--out", "r.bin"), "a name that ends in .rrd"),
            (("0", "--out", "nowhere/r.rrd"), "the folder nowhere does not exist"),
            (("0", "--out", "mine.rrd"), "exists and is not a Rerun recording"),
        ],
    )
    def test_refuses_what_cannot_be(
        self,
        complaint: Callable[..., tuple[int, str]],
        tmp_path: Path,
        args: tuple[str, ...],
        said: str,
    ) -> None:
        (tmp_path / "mine.rrd").write_text("my diary")
        code, err = complaint("rerun", TINY, *args)
        assert code == 2
        assert said in err
        assert tree(tmp_path) == {"mine.rrd": b"my diary"}

    def test_says_of_a_quarantined_episode_that_there_is_nothing_to_show(
        self, complaint: Callable[..., tuple[int, str]], tmp_path: Path
    ) -> None:
        code, err = complaint("rerun", with_a_quarantined_row(tmp_path / "s.zarr"), 1)
        assert code == 1
        assert "episode 1 is quarantined: no luck with 1" in err

    def test_that_is_stopped_leaves_nothing(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def stop(*_: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(recording, "log_series", stop)
        assert run("rerun", TINY, 1)[0] == 130
        assert list(tmp_path.iterdir()) == []

    def test_names_what_is_missing(
        self,
        complaint: Callable[..., tuple[int, str]],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
        code, err = complaint("rerun", TINY, 0)
        assert code == 2
        assert "this needs rerun, which is not installed: pip install 'grasp-factory[rerun]'" in err
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.slow
    def test_writes_nothing_into_the_users_folders(self, tmp_path: Path) -> None:
        home = tmp_path / "home"
        home.mkdir()
        kept = {k: v for k, v in os.environ.items() if not k.startswith("XDG_")}
        subprocess.run(
            [sys.executable, "-W", "error", "-m", "grasp_factory", "rerun", TINY, "0",
             "--out", tmp_path / "r.rrd"],
            env={**kept, "HOME": str(home)}, check=True, capture_output=True,
        )  # fmt: skip
        assert list(home.iterdir()) == []
        assert (tmp_path / "r.rrd").is_file()

    def test_opens_the_viewer_on_it(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        opened: list[Path] = []
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("grasp_factory.apps.rerun.open_viewer", opened.append)
        assert run("rerun", TINY, 1, "--open") == (0, "tiny-1.rrd\n", "")
        assert opened == [Path("tiny-1.rrd")]


class TestTheViewer:
    def test_runs_without_statistics_on_this_machine_alone(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        told: list[tuple[list[str], dict[str, str]]] = []

        def pretend(command: list[Any], env: dict[str, str], **_: Any) -> Any:
            told.append(([str(word) for word in command], dict(env)))
            return subprocess.CompletedProcess(command, 0)

        monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
        monkeypatch.setattr(sdk.subprocess, "run", pretend)
        sdk.open_viewer(tmp_path / "r.rrd")
        (first, before), (second, env) = told
        assert first[1:] == ["analytics", "disable"]
        assert second[1:3] == ["--bind", "127.0.0.1"]
        assert second[-1] == str(tmp_path / "r.rrd")
        assert before == env
        assert "FORCE_RERUN_ANALYTICS" not in env
        assert env["XDG_CONFIG_HOME"] != os.environ.get("XDG_CONFIG_HOME")

    def test_has_them_off_as_it_says_itself(self, tmp_path: Path) -> None:
        quiet = sdk.viewer_environment(tmp_path)
        for words in (("disable",), ("config",)):
            said = subprocess.run(
                [sdk.viewer(), "analytics", *words],
                env=quiet, capture_output=True, text=True, check=True,
            )  # fmt: skip
        assert '"analytics_enabled": false' in said.stdout
        assert str(tmp_path) in said.stdout

    def test_that_cannot_run_here_is_told_of(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(command: list[Any], **_: Any) -> Any:
            return subprocess.CompletedProcess(command, int("analytics" not in command))

        monkeypatch.setattr(sdk.subprocess, "run", refuse)
        with pytest.raises(GraspFactoryError, match=r"ended with 1: .*open it\s+elsewhere"):
            sdk.open_viewer(tmp_path / "r.rrd")


def test_a_file_is_named_after_store_and_episode(tmp_path: Path) -> None:
    assert default_file(Path("a/grasps.zarr/"), 12) == Path("grasps-12.rrd")
    assert default_file(Path("a/odd"), 0) == Path("odd-0.rrd")


def test_a_place_for_no_recording_is_told_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown file format"):
        recording.write_recording(Dataset(TINY), 0, tmp_path / "r.txt")
