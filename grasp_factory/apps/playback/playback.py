"""Playing back a stored attempt: its recorded motion from any camera, frame by frame.

Nothing is simulated. The robot is set to the recorded joint positions and gripper width, and the
objects to their recorded poses. So the images show what is stored, independent of the machine and
the version that made it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp_factory.apps.pictures import painting
from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.apps.playback.track import Track, phase_at
from grasp_factory.apps.playback.video_file import check_video, frame_sink, nearest_fps
from grasp_factory.core.camera import Camera
from grasp_factory.core.config.cameras import CAMERAS, CameraConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.geometry import Pose
from grasp_factory.core.limits import VIDEO_PIXELS
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError, lookup
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.plugins import activate
from grasp_factory.simulation.images import Render
from grasp_factory.simulation.scene import Scene, build_scene, render_cameras
from grasp_factory.simulation.world.playback_world import PosedWorld

CAPTION = 28
"""Pixels below each frame for the caption."""
END_S = 1.0
"""Seconds for which the last frame stays; the whole video if the arm did not move."""
MOST_FRAMES = 20_000
FREE_CAMERA_FOV_DEG = 36.0
CLOSEST = 0.001
"""Minimum distance in metres between a free camera and its target."""
STEEP = 0.01
"""Horizontal share of a view below which up in the image is away from the robot (+x), not +z."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How time passes in a video."""

    fps: float = 25.0
    """Frames per second."""
    speed: float = 1.0
    """Seconds of the attempt in a second of the video."""

    def __post_init__(self) -> None:
        for name, low, high in (("fps", 1.0, 240.0), ("speed", 0.001, 100.0)):
            value = getattr(self, name)
            if not low <= value <= high:  # NaN as well
                raise UsageError(f"--{name} {value:g}: valid: {low:g} to {high:g}")

    def times(self, duration: float) -> list[float]:
        """Return the attempt's time (s) at each frame; the last time is repeated for ``END_S``.

        Raises:
            UsageError: if there are more than ``MOST_FRAMES`` frames.
        """
        step = self.speed / self.fps
        moving, still = math.ceil(duration / step), max(1, round(END_S * self.fps))
        if moving + still > MOST_FRAMES:
            raise UsageError(
                f"{moving + still} frames: valid: up to {MOST_FRAMES}; take a smaller --fps or a"
                " greater --speed"
            )
        return [*(i * step for i in range(moving)), *[duration] * still]


def stored_or_named_camera(spec: EpisodeSpec, name: str | None) -> CameraConfig:
    """Return the named camera of an episode or else of ``CAMERAS``; None for the episode's first.

    Raises:
        UnknownNameError: if there is no such camera; the message lists all names.
    """
    if name is None:
        return next(iter(spec.cameras.values()))
    named = {key: camera.config for key, camera in CAMERAS.items()}
    return lookup({**named, **spec.cameras}, "camera", name)


def free_camera(
    eye: tuple[float, float, float], target: tuple[float, float, float]
) -> CameraConfig:
    """Return a camera at any position in the world; ``eye`` and ``target`` are in metres.

    Raises:
        UsageError: if a position is too far away, or both are the same.
    """
    view = np.subtract(target, eye)
    away = float(np.linalg.norm(view))
    if away < CLOSEST:
        raise UsageError(f"--eye and --target are the same place: got {eye} and {target}")
    is_steep = np.linalg.norm(view[:2]) < STEEP * away
    return CameraConfig(
        eye=eye,
        target=target,
        up=(1.0, 0.0, 0.0) if is_steep else (0.0, 0.0, 1.0),
        fov_y_deg=FREE_CAMERA_FOV_DEG,
        near=0.05,
        far=min(max(4.0, 2.0 * away + 4.0), 100.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How an attempt is shown."""

    camera: str | None = None
    """One of the episode's, or of ``CAMERAS``; None for the episode's first."""
    place: CameraConfig | None = None
    """A free camera, instead of a named one."""
    resolution: tuple[int, int] | None = None
    """Width and height, pixels; None for that of the episode's images."""
    pace: Pace = Pace()
    caption: bool = True
    """Whether there is a strip with outcome, time and phase below each frame."""

    def __post_init__(self) -> None:
        if self.place is not None and self.camera is not None:
            raise UsageError("a place (--eye, --target) and a --camera: give one of them")
        if self.resolution and not all(16 <= side <= 4096 for side in self.resolution):
            width, height = self.resolution
            raise UsageError(f"--resolution {width}x{height}: valid: 16 to 4096 pixels a side")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoPlan:
    """A video that is checked and can be made."""

    dataset: Dataset
    index: int
    """Of the episode, in the store."""
    episode: Episode
    out: Path
    view: View
    camera: CameraConfig
    resolution: tuple[int, int]
    """Width and height of the camera's image, pixels, without the caption."""
    pace: Pace
    """The view's, with a rate that the file can have."""
    times: tuple[float, ...]
    """The attempt's time at each frame, s."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame, pixels, with its caption."""
        return self.resolution[0], self.resolution[1] + CAPTION * self.view.caption

    @property
    def pixels(self) -> int:
        """Pixels of all frames together."""
        return len(self.times) * self.size[0] * self.size[1]


class Playback:
    """One attempt in a posed world, seen by one camera."""

    def __init__(
        self,
        world: PosedWorld,
        episode: Episode,
        camera: CameraConfig,
        resolution: tuple[int, int],
    ) -> None:
        """Build the scene.

        Raises:
            RecipeError: if an object cannot be loaded.
            UnknownNameError: if the recipe contains an unknown name.
        """
        self._episode = episode
        self.track = Track.of(episode)
        seen_by = {"view": camera}
        spec = dataclasses.replace(episode.spec, cameras=seen_by, resolution=resolution)
        self._world = world
        self._scene: Scene = build_scene(world, spec)

    def render(self, time: float) -> tuple[Camera, Render]:
        """Return the camera with its pose and its image at a time (s) since the arm started."""
        posture, robot = self.track.at(time), self._scene.robot
        self._world.place_joints(robot.body, robot.arm, posture.joint_positions.tolist())
        self._world.place_joints(robot.body, robot.fingers, [posture.gripper_width / 2.0] * 2)
        for body, (x, y, z, *quat) in zip(self._scene.objects, posture.objects, strict=True):
            i, j, k, w = quat
            self._world.place_body(body, Pose((x, y, z), (i, j, k, w)))
        return render_cameras(self._scene)["view"]

    def frames(self, times: Iterable[float]) -> Iterator[tuple[float, BgrImage]]:
        """Yield time (s) and BGR image of every frame; repeated times are rendered only once."""
        shown: tuple[float, BgrImage] | None = None
        for time in times:
            if shown is None or shown[0] != time:
                rgb = self.render(time)[1].rgb
                shown = time, np.ascontiguousarray(rgb[..., ::-1])
            yield shown


def captioned(image: BgrImage, episode: Episode, time: float, speed: float) -> BgrImage:
    """Return a frame with a strip below: outcome, time, phase, and what is grasped.

    Text that does not fit is cut off at the right.
    """
    strip: BgrImage = np.full((CAPTION, image.shape[1], 3), painting.PAPER, np.uint8)
    middle, color = CAPTION // 2, painting.outcome_color(episode.outcome)
    word = episode.outcome.name.lower().replace("_", " ")
    x = 4 + painting.put_badge(strip, word, (4, middle), color, height=18) + 10
    pace = "" if speed == 1.0 else f" x{speed:g}"
    for text, width in (
        (f"{time:5.2f} s{pace}", 64 + 9 * len(pace)),
        (phase_at(episode, time), 84),
        (f"#{episode.spec.index} {episode.spec.objects[0].object_id}", 0),
    ):
        painting.put_text(strip, text, (x, middle), height=11)
        x += width
    return np.vstack([image, strip])


def plan_video(dataset: Dataset, index: int, out: Path, view: View) -> VideoPlan:
    """Check that the video of a stored attempt can be made, and return its plan.

    Args:
        dataset: The dataset with the attempt.
        index: Index of the episode, which must be in the store.
        out: Output file, ending in .mp4 or .gif; an existing video is replaced.
        view: How the attempt is shown.

    Raises:
        UsageError: if the video cannot be made.
        StoreError: if the episode is quarantined or cannot be read.
        LimitError: if all its frames have more pixels than the limits allow.
    """
    activate(dataset.config)
    pace = dataclasses.replace(view.pace, fps=nearest_fps(out, view.pace.fps))
    episode = dataset[index]
    plan = VideoPlan(
        dataset=dataset,
        index=index,
        episode=episode,
        out=out,
        view=view,
        camera=view.place or stored_or_named_camera(episode.spec, view.camera),
        resolution=view.resolution or episode.spec.resolution,
        pace=pace,
        times=tuple(pace.times(Track.of(episode).duration)),
    )
    check_video(out, plan.size, pace.fps, len(plan.times))
    VIDEO_PIXELS.check(plan.pixels, f"episode {index} of {dataset.path}")
    return plan


def draw_video(plan: VideoPlan, partial: Path, on_frame: Callable[[], None]) -> None:
    """Write the video of a stored attempt to an empty file, and call ``on_frame`` after each frame.

    Raises:
        StoreError: if data embedded in the store are damaged.
        RecipeError: if an object of the episode cannot be loaded.
        OSError: if it cannot be written.
    """
    embedded_assets.unpack(plan.dataset.path, plan.dataset.config)
    with (
        frame_sink(partial, plan.size, plan.pace.fps) as sink,
        PosedWorld(plan.dataset.config.renderer) as world,
    ):
        playback = Playback(world, plan.episode, plan.camera, plan.resolution)
        for time, image in playback.frames(plan.times):
            if plan.view.caption:
                sink.add(captioned(image, plan.episode, time, plan.pace.speed))
            else:
                sink.add(image)
            on_frame()
