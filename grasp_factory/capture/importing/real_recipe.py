"""The recipe of a real episode: what it was cut from, and the settings of its store."""

from __future__ import annotations

from grasp_factory.capture.importing.timeline import EpisodeSpan
from grasp_factory.core.appearance import Surroundings
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import EpisodeSpec, ObjectSpec
from grasp_factory.core.recording_source import RecordingSource
from grasp_factory.core.splits import split_of

OBJECT_SET, POLICY = "real", "recorded"
"""Object set and policy of real episodes."""


def real_recipe(
    config: FactoryConfig, index: int, source: RecordingSource, grasped: str
) -> EpisodeSpec:
    """Return the recipe of a real episode.

    Args:
        config: of the store.
        index: of the episode.
        source: what it is cut from.
        grasped: the object's name.
    """
    object_id = f"{OBJECT_SET}/{grasped}"
    target = ObjectSpec(
        object_set=OBJECT_SET,
        object_id=object_id,
        family="",
        split=split_of(object_id),
        mass=None,
        lateral_friction=None,
        drop_pose=None,
    )
    return EpisodeSpec(
        index=index,
        seed=config.seed,
        robot=config.robot,
        policy=POLICY,
        policy_parameters={},
        objects=(target,),
        surroundings=Surroundings(),
        cameras=config.cameras,
        resolution=config.resolution,
        record_hz=config.record_hz,
        imu_hz=config.imu_rate,
        video_hz=config.video_hz,
        workspace=config.workspace,
        physics=config.physics,
        motion=config.motion,
        shake=config.shake,
        label=config.label,
        quality=config.quality,
        recording=source,
    )


def span_of(spec: EpisodeSpec) -> EpisodeSpan:
    """Return the time of a real episode."""
    assert spec.recording
    return EpisodeSpan(start_ns=spec.recording.start_ns, end_ns=spec.recording.end_ns)
