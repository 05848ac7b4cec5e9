"""Videos of stored attempts: what is shown, when, and how the files get there."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.helpers import tree
from support.places import TINY
from support.scenes import cube_spec
from support.stored import varied, with_a_quarantined_row

from grasp_factory.apps.playback import playback
from grasp_factory.apps.playback.playback import (
    CAPTION,
    END_S,
    MOST_FRAMES,
    Pace,
    Playback,
    captioned,
    free_camera,
    stored_or_named_camera,
)
from grasp_factory.apps.playback.track import Track, phase_at
from grasp_factory.apps.playback.video_file import (
    GIF,
    MP4,
    FrameSink,
    check_video,
    frame_sink,
    nearest_fps,
)
from grasp_factory.apps.playback.video_process import write_video
from grasp_factory.core.enums import Phase
from grasp_factory.core.episode import Episode
from grasp_factory.core.limits import VARIABLE
from grasp_factory.core.output_file import written_aside
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import (
    GraspFactoryError,
    LimitError,
    StoreError,
    UnknownNameError,
    UsageError,
)
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World
from grasp_factory.simulation.world.playback_world import PosedWorld

Run = Callable[..., tuple[int, str, str]]

VISIBLE = 8
"""Grey values by which a pixel differs that anybody would see."""
OTHERWISE = 0.001
"""Share of pixels that may: those on edges that a float32 of a joint's angle moves."""


def differing(a: np.ndarray, b: np.ndarray) -> float:
    """Return the share of pixels that differ visibly."""
    return float((np.abs(a.astype(int) - b).max(axis=-1) > VISIBLE).mean())


@pytest.fixture(scope="module")
def episode() -> Episode:
    return Dataset(TINY)[0]


@pytest.fixture(scope="module")
def never_started() -> Episode:
    """Return an episode whose target lies where the arm does not work: there is no record."""
    with World() as world:
        return run_episode(world, cube_spec((0.30, 0.30, 0.026), resolution=(64, 48)))


class TestATrack:
    def test_is_what_was_recorded_at_every_record(self, episode: Episode) -> None:
        track = Track.of(episode)
        for i in range(0, episode.n_steps, 7):
            posture = track.at(float(episode.streams["timestamp"][i]))
            expected = episode.streams["joint_positions"][i]
            np.testing.assert_allclose(posture.joint_positions, expected, atol=1e-6)
            assert posture.gripper_width == pytest.approx(episode.streams["gripper_width"][i])
            np.testing.assert_allclose(
                posture.objects, episode.streams["object_pose"][i], atol=1e-6
            )

    def test_starts_at_home_with_the_objects_at_rest(self, episode: Episode) -> None:
        posture = Track.of(episode).at(0.0)
        np.testing.assert_array_equal(posture.objects, episode.columns["object_rest_pose"])
        assert np.abs(posture.joint_positions - episode.streams["joint_positions"][0]).max() < 0.01

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(time=st.floats(-1.0, 10.0))
    def test_lies_between_the_records_around_it(self, episode: Episode, time: float) -> None:
        track = Track.of(episode)
        posture = track.at(time)
        i = int(np.clip(np.searchsorted(track.timestamp, time, "right") - 1, 0, None))
        ends = track.joint_positions[[i, min(i + 1, len(track.timestamp) - 1)]]
        assert (posture.joint_positions >= ends.min(axis=0) - 1e-9).all()
        assert (posture.joint_positions <= ends.max(axis=0) + 1e-9).all()
        np.testing.assert_allclose(np.linalg.norm(posture.objects[:, 3:], axis=1), 1.0, atol=1e-9)

    def test_goes_the_short_way_between_a_quaternion_and_its_negative(self) -> None:
        turned = np.array([0.0, 0.0, 0.6, 0.8])
        objects = np.zeros((2, 1, 7))
        objects[0, 0, 3:], objects[1, 0, 3:] = turned, -turned
        track = Track(np.array([0.0, 1.0]), np.zeros((2, 7)), np.zeros(2), objects)
        np.testing.assert_allclose(np.abs(track.at(0.5).objects[0, 3:]), turned)

    def test_of_an_attempt_that_never_started_stands_still(self, never_started: Episode) -> None:
        track = Track.of(never_started)
        assert (never_started.n_steps, track.duration) == (0, 0.0)
        np.testing.assert_array_equal(
            track.at(3.0).objects, never_started.columns["object_rest_pose"]
        )


class TestAPace:
    @given(
        duration=st.floats(0.0, 8.0),
        fps=st.floats(1.0, 60.0),
        speed=st.floats(0.1, 4.0),
    )
    def test_shows_all_of_the_attempt_evenly_and_rests_at_its_end(
        self, duration: float, fps: float, speed: float
    ) -> None:
        times = Pace(fps=fps, speed=speed).times(duration)
        still = max(1, round(END_S * fps))
        assert times[0] == 0.0
        assert times[-still:] == [duration] * still
        gaps = np.diff(times[: len(times) - still + 1])
        assert (gaps <= speed / fps * (1 + 1e-9)).all()
        assert (gaps[:-1] >= speed / fps * (1 - 1e-9)).all()
        assert len(times) - still == pytest.approx(duration / speed * fps, abs=1.0)

    @pytest.mark.parametrize(
        "given", [{"fps": 0.0}, {"fps": 300.0}, {"speed": 0.0}, {"speed": float("nan")}]
    )
    def test_that_is_none_is_refused(self, given: dict[str, float]) -> None:
        with pytest.raises(UsageError, match=f"--{next(iter(given))} .*valid: "):
            Pace(**given)

    def test_with_no_end_of_frames_is_refused(self) -> None:
        with pytest.raises(UsageError, match=f"frames: valid: up to {MOST_FRAMES}"):
            Pace(fps=240.0, speed=0.001).times(5.0)


class TestAPlayback:
    def test_shows_what_the_camera_saw_before_and_after(self, episode: Episode) -> None:
        with PosedWorld() as world:
            camera = stored_or_named_camera(episode.spec, None)
            shown = Playback(world, episode, camera, episode.spec.resolution)
            for time, frame in ((0.0, 0), (shown.track.duration, 1)):
                camera_then, render = shown.render(time)
                assert differing(render.rgb, episode.cameras["front"].rgb[frame]) <= OTHERWISE
                np.testing.assert_allclose(
                    camera_then.T_world_camera, episode.cameras["front"].T_world_camera[frame]
                )

    def test_is_not_one_picture_for_all_times(self, episode: Episode) -> None:
        with PosedWorld() as world:
            camera = stored_or_named_camera(episode.spec, None)
            shown = Playback(world, episode, camera, episode.spec.resolution)
            early, late = (shown.render(time)[1].rgb for time in (0.0, 2.0))
        assert differing(early, late) > 100 * OTHERWISE

    @pytest.mark.slow
    @pytest.mark.parametrize("camera", ["front", "wrist"])
    def test_shows_every_frame_of_the_recorded_videos(self, camera: str) -> None:
        """Of a robot, objects, and a moving camera that the physics had moved."""
        for episode in Dataset(varied()):
            place = stored_or_named_camera(episode.spec, camera)
            with PosedWorld() as world:
                shown = Playback(world, episode, place, episode.spec.resolution)
                assert len(episode.videos["timestamp"]) > 10
                for i, time in enumerate(episode.videos["timestamp"]):
                    seen, render = shown.render(float(time))
                    assert differing(render.rgb, episode.videos[f"{camera}/rgb"][i]) <= OTHERWISE
                    np.testing.assert_allclose(
                        seen.T_world_camera,
                        episode.videos[f"{camera}/T_world_camera"][i],
                        atol=1e-5,
                    )

    def test_never_steps(self) -> None:
        with PosedWorld() as world, pytest.raises(GraspFactoryError, match="cannot step"):
            world.step()


class TestACamera:
    def test_of_the_store_goes_before_one_of_the_same_name(self, episode: Episode) -> None:
        own = dataclasses.replace(episode.spec.cameras["front"], fov_y_deg=77.0)
        spec = dataclasses.replace(episode.spec, cameras={"front": own})
        assert stored_or_named_camera(spec, "front").fov_y_deg == 77.0
        assert stored_or_named_camera(spec, None) is own

    def test_with_a_name_need_not_be_in_the_store(self, episode: Episode) -> None:
        assert list(episode.spec.cameras) == ["front"]
        assert stored_or_named_camera(episode.spec, "overhead").eye == (0.55, 0.0, 1.10)

    def test_without_a_name_in_any_table_is_refused(self, episode: Episode) -> None:
        with pytest.raises(UnknownNameError, match=r"did you mean 'front'.*overhead, wrist"):
            stored_or_named_camera(episode.spec, "frnt")

    def test_may_look_straight_down(self, episode: Episode) -> None:
        with PosedWorld() as world:
            place = free_camera((0.55, 0.0, 1.1), (0.55, 0.0, 0.0))
            down = Playback(world, episode, place, (64, 48)).render(0.0)[1].rgb
            overhead = stored_or_named_camera(episode.spec, "overhead")
            same = Playback(world, episode, overhead, (64, 48)).render(0.0)[1].rgb
        assert differing(down, same) == 0.0

    def test_needs_a_direction(self) -> None:
        with pytest.raises(UsageError, match="--eye and --target are the same place"):
            free_camera((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))

    @given(
        eye=st.tuples(*[st.floats(-9.0, 9.0)] * 3), target=st.tuples(*[st.floats(-9.0, 9.0)] * 3)
    )
    def test_sees_its_target_from_everywhere_else(self, eye: Any, target: Any) -> None:
        away = float(np.linalg.norm(np.subtract(target, eye)))
        if away < 2 * playback.CLOSEST:
            return
        assert free_camera(eye, target).far > away


class TestACaption:
    def test_stands_below_the_frame_and_tells_the_outcome(self, episode: Episode) -> None:
        frame = np.full((48, 320, 3), 7, np.uint8)
        good = captioned(frame, episode, 1.0, 1.0)
        assert good.shape == (48 + CAPTION, 320, 3)
        np.testing.assert_array_equal(good[:48], frame)
        lost = dataclasses.replace(episode, outcome=type(episode.outcome).LOST_IN_LIFT)
        assert not np.array_equal(good, captioned(frame, lost, 1.0, 1.0))
        assert not np.array_equal(good, captioned(frame, episode, 2.0, 1.0))
        assert not np.array_equal(good, captioned(frame, episode, 1.0, 0.25))

    def test_fits_into_the_smallest_image(self, episode: Episode) -> None:
        frame = np.zeros((16, 16, 3), np.uint8)
        assert captioned(frame, episode, 1.0, 1.0).shape == (16 + CAPTION, 16, 3)

    def test_names_the_phase_of_the_record_that_comes(self, episode: Episode) -> None:
        stamps, phases = episode.streams["timestamp"], episode.streams["phase"]
        for i in range(0, len(stamps), 11):
            assert phase_at(episode, float(stamps[i])) == Phase(int(phases[i])).name.lower()
        assert phase_at(episode, 0.0) == "pregrasp"
        assert phase_at(episode, 99.0) == Phase(int(phases[-1])).name.lower()

    def test_has_no_phase_where_nothing_was_recorded(self, never_started: Episode) -> None:
        assert phase_at(never_started, 0.0) == ""


def frames_of(path: Path) -> tuple[list[np.ndarray], float]:
    """Return the frames, BGR, and the rate of a video, as OpenCV reads it."""
    if path.suffix == ".gif":
        ok, animation = cv2.imreadanimation(str(path))
        assert ok
        assert len(set(animation.durations)) == 1
        return [frame[..., :3] for frame in animation.frames], 1000.0 / animation.durations[0]
    reader = cv2.VideoCapture(str(path))
    fps, frames = reader.get(cv2.CAP_PROP_FPS), []
    while (found := reader.read())[0]:
        frames.append(found[1])
    reader.release()
    return frames, fps


@contextlib.contextmanager
def video_file(path: Path, size: tuple[int, int], fps: float, frames: int) -> Iterator[FrameSink]:
    """Write a video as ``write_video`` does, with frames of our own."""
    check_video(path, size, fps, frames)
    with written_aside(path) as partial, frame_sink(partial, size, fps) as sink:
        yield sink


def grey(level: int, size: tuple[int, int] = (48, 32)) -> np.ndarray:
    return np.full((size[1], size[0], 3), level, np.uint8)


class TestAFile:
    @pytest.mark.parametrize("name", ["v.mp4", "v.GIF", "v.gif"])
    def test_has_the_frames_and_their_rate(self, tmp_path: Path, name: str) -> None:
        path = tmp_path / name
        with video_file(path, (48, 32), 20.0, 10) as sink:
            for i in range(10):
                sink.add(grey(20 * i))
        frames, fps = frames_of(path.rename(tmp_path / name.lower()))
        assert fps == pytest.approx(20.0)
        assert [round(float(frame.mean()), -1) for frame in frames] == [20.0 * i for i in range(10)]
        assert frames[0].shape == (32, 48, 3)
        assert [file.name for file in tmp_path.iterdir()] == [name.lower()]

    def test_of_odd_sides_is_a_pixel_larger(self, tmp_path: Path) -> None:
        with video_file(tmp_path / "v.mp4", (33, 17), 20.0, 2) as sink:
            sink.add(grey(90, (33, 17)))
            sink.add(grey(90, (33, 17)))
        frames, _ = frames_of(tmp_path / "v.mp4")
        assert [frame.shape for frame in frames] == [(18, 34, 3)] * 2
        assert np.abs(frames[0].astype(int) - 90).max() < 8

    @pytest.mark.parametrize("fps", [7.0, 15.0, 24.0, 30.0, 50.0])
    def test_of_a_gif_has_a_rate_that_gifs_have(self, tmp_path: Path, fps: float) -> None:
        rate = nearest_fps(tmp_path / "v.gif", fps)
        assert 100.0 / rate == pytest.approx(round(100.0 / rate))
        assert rate == pytest.approx(fps, rel=0.12)
        assert nearest_fps(tmp_path / "v.mp4", fps) == fps

    def test_of_a_gif_that_is_too_large_or_too_quick_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"needs 5\.5 GB of memory: take fewer frames"):
            check_video(tmp_path / "v.gif", (1920, 1080), 25.0, 888)
        with pytest.raises(UsageError, match="of a GIF, valid: up to 50"):
            check_video(tmp_path / "v.gif", (48, 32), 100.0, 8)
        check_video(tmp_path / "v.mp4", (1920, 1080), 100.0, 888)

    @pytest.mark.parametrize("name", ["v.avi", "v", "nowhere/v.mp4"])
    def test_that_cannot_be_is_refused(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(UsageError, match=name), video_file(tmp_path / name, (48, 32), 20.0, 1):
            pytest.fail("it was opened")

    @pytest.mark.parametrize("name", ["v.mp4", "v.gif"])
    def test_replaces_a_video_and_nothing_else(self, tmp_path: Path, name: str) -> None:
        path = tmp_path / name
        path.write_text("my diary")
        with pytest.raises(UsageError, match="exists and is not"):
            check_video(path, (48, 32), 20.0, 1)
        assert path.read_text() == "my diary"
        path.unlink()
        for level in (50, 200):
            with video_file(path, (48, 32), 20.0, 2) as sink:
                sink.add(grey(level))
                sink.add(grey(level))
        assert frames_of(path)[0][0].mean() == pytest.approx(200.0, abs=8.0)
        path.unlink()
        path.mkdir()
        with pytest.raises(UsageError, match="exists and is not"):
            check_video(path, (48, 32), 20.0, 1)

    @pytest.mark.parametrize("name", ["v.mp4", "v.gif"])
    @pytest.mark.parametrize("why", [KeyboardInterrupt, ValueError])
    def test_that_is_not_finished_leaves_what_was_there(
        self, tmp_path: Path, name: str, why: type[BaseException]
    ) -> None:
        with video_file(tmp_path / name, (48, 32), 20.0, 2) as sink:
            sink.add(grey(50))
        before = tree(tmp_path)

        def fail() -> None:
            with video_file(tmp_path / name, (48, 32), 20.0, 2) as sink:
                sink.add(grey(9))
                raise why

        with pytest.raises(why):
            fail()
        assert tree(tmp_path) == before

    def test_that_lacks_frames_is_no_video(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """As on a full disk, of which OpenCV says nothing."""

        class Full:
            def __init__(self, *how: Any) -> None:
                self._writer = writer(*how)

            def isOpened(self) -> bool:
                return bool(self._writer.isOpened())

            def write(self, image: np.ndarray) -> None:
                if image.mean() < 100.0:
                    self._writer.write(image)

            def release(self) -> None:
                self._writer.release()

        writer = cv2.VideoWriter
        monkeypatch.setattr(cv2, "VideoWriter", Full)

        def write() -> None:
            with video_file(tmp_path / "v.mp4", (48, 32), 20.0, 2) as sink:
                sink.add(grey(50))
                sink.add(grey(200))

        with pytest.raises(StoreError, match=r"v\.mp4 cannot be written: 1 of 2 frames"):
            write()
        assert list(tmp_path.iterdir()) == []

    def test_is_known_by_what_is_in_it(self, tmp_path: Path) -> None:
        for name, kind, other in (("v.mp4", MP4, GIF), ("v.gif", GIF, MP4)):
            with video_file(tmp_path / name, (48, 32), 20.0, 1) as sink:
                sink.add(grey(50))
            assert kind.is_that_of(tmp_path / name)
            assert not other.is_that_of(tmp_path / name)


class TestCommand:
    @pytest.mark.parametrize("name", ["v.mp4", "v.gif"])
    def test_writes_a_video_and_still_compares(
        self, run: Run, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        before = tree(TINY)
        code, out, err = run("replay", TINY, 2, "--video", name, "--fps", 10, "--json")
        facts, episode = json.loads(out), Dataset(TINY)[2]
        assert (code, err) == (0 if facts["same"] else 1, "")
        assert facts["recorded"] == "collision"
        assert tree(TINY) == before
        frames, fps = frames_of(tmp_path / name)
        duration = episode.streams["timestamp"][-1]
        assert facts["video"] == {
            "path": name, "frames": len(frames), "fps": 10.0, "size": [96, 72 + CAPTION]
        }  # fmt: skip
        assert fps == pytest.approx(10.0)
        assert len(frames) == int(np.ceil(duration * 10.0)) + round(END_S * 10.0)
        for frame, image in ((frames[0], 0), (frames[-1], 1)):
            stored = episode.cameras["front"].rgb[image][..., ::-1]
            assert np.abs(frame[:72].astype(int) - stored).mean() < 8.0
        assert np.abs(frames[0][:72].astype(int) - frames[-1][:72]).mean() > 8.0

    def test_shows_it_from_anywhere_slowly_and_large(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        how = ("--eye", "-0.2,0.7,0.5", "--target", "0.5,0,0.1", "--resolution", "160x120")
        more = ("--speed", 0.5, "--fps", 5, "--no-caption", "--video", "v.mp4")
        code, out, _ = run("replay", TINY, 2, *how, *more)
        assert code in {0, 1}
        assert out.endswith("v.mp4\n")
        frames, _ = frames_of(tmp_path / "v.mp4")
        duration = Dataset(TINY)[2].streams["timestamp"][-1]
        assert len(frames) == int(np.ceil(duration / 0.5 * 5)) + 5
        assert frames[0].shape == (120, 160, 3)

    @pytest.mark.parametrize(
        ("args", "said"),
        [
            (("--fps", 5), "--fps is for a video: add --video FILE.mp4"),
            (("--no-caption",), "--caption is for a video"),
            (("--video", "v.avi"), "v.avi"),
            (("--video", "v.mp4", "--camera", "frnt"), "did you mean 'front'"),
            (("--video", "v.mp4", "--eye", "1,0,1"), "set both"),
            (("--video", "v.mp4", "--eye", "1,0", "--target", "0,0,0"), "valid: X,Y,Z in metres"),
            (("--video", "v.mp4", "--eye", "1,0,1e9", "--target", "0,0,0"), "within 100 m"),
            (
                ("--video", "v.mp4", "--eye", "1,0,1", "--target", "0,0,0", "--camera", "front"),
                "give one of them",
            ),
            (("--video", "v.mp4", "--resolution", "8x8"), "16 to 4096 pixels a side"),
            (("--video", "v.mp4", "--fps", "nan"), "--fps nan: valid"),
            (("--video", "v.gif", "--fps", 240), "of a GIF"),
        ],
    )
    def test_refuses_what_cannot_be_before_anything_is_simulated(
        self,
        complaint: Callable[..., tuple[int, str]],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        args: tuple[object, ...],
        said: str,
    ) -> None:
        monkeypatch.setattr("grasp_factory.curation.replay.World", None)
        code, err = complaint("replay", TINY, 0, *args)
        assert code == 2
        assert said in err
        assert "Traceback" not in err
        assert list(tmp_path.iterdir()) == []

    def test_says_of_a_quarantined_episode_that_there_is_nothing_to_show(
        self, complaint: Callable[..., tuple[int, str]], tmp_path: Path
    ) -> None:
        store = with_a_quarantined_row(tmp_path / "s.zarr")
        code, err = complaint("replay", store, 1, "--video", "v.mp4")
        assert code == 1
        assert "episode 1 is quarantined: no luck with 1" in err
        assert not (tmp_path / "v.mp4").exists()

    def test_that_is_stopped_leaves_nothing(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def stop(*_: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(playback, "captioned", stop)
        code, _, _ = run("replay", TINY, 2, "--video", "v.mp4")
        assert code == 130
        assert list(tmp_path.iterdir()) == []


def test_an_attempt_that_never_started_is_a_picture_for_a_second(
    never_started: Episode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class One:
        status, path = [1], TINY
        config = Dataset(TINY).config

        def __getitem__(self, index: int) -> Episode:
            return never_started

    plan = playback.plan_video(One(), 0, tmp_path / "v.mp4", playback.View())  # type: ignore[arg-type]
    counted: list[None] = []
    playback.draw_video(plan, plan.out, lambda: counted.append(None))
    frames, fps = frames_of(tmp_path / "v.mp4")
    assert len(frames) == len(counted) == len(plan.times) == round(END_S * fps)
    assert frames[0].shape == (48 + CAPTION, 64, 3)


def test_a_video_of_too_many_pixels_is_refused_before_it_is_drawn(tmp_path: Path) -> None:
    view = playback.View(resolution=(4096, 4096), pace=Pace(fps=100.0, speed=0.1))
    with pytest.raises(LimitError, match=r"episode 2 of .*: a video with a number of pixels of"):
        playback.plan_video(Dataset(TINY), 2, tmp_path / "v.mp4", view)


@pytest.mark.usefixtures("isolated")
def test_a_video_is_drawn_in_a_process_with_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = playback.View(resolution=(2048, 2048))
    plan = playback.plan_video(Dataset(TINY), 2, tmp_path / "v.mp4", view)
    monkeypatch.setenv(VARIABLE, "video-seconds=1")
    with pytest.raises(LimitError, match="the video takes more than 1 s; if you trust this store"):
        write_video(plan)
    assert list(tmp_path.iterdir()) == []
