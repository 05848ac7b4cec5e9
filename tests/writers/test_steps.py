"""Steps of an episode: which records and rewards they have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from support.fake_episodes import make_episode, small_config

from grasp_factory.core.episode import Episode
from grasp_factory.writers.exporters.steps import steps_of


def episode(video_hz: int) -> Episode:
    """Return an episode of 8 records at 10 Hz, from 0.1 s on, that succeeds at its end."""
    made = make_episode(small_config(video_hz=video_hz), 0, n_steps=8)
    streams, videos = dict(made.streams), dict(made.videos)
    streams["timestamp"] = np.arange(1, 9) / 10
    streams["reward"] = np.array([0, 0, 0, 0, 0, 0, 0, 1], np.float32)
    videos["timestamp"] = np.arange(1, len(videos["timestamp"]) + 1) / video_hz
    return replace(made, streams=streams, own_rate={**made.own_rate, "videos": videos})


def test_a_reward_between_two_frames_belongs_to_the_frame_before_it() -> None:
    steps = steps_of(episode(video_hz=4))
    assert steps.record.tolist() == [1, 4, 6]
    assert steps.reward.tolist() == [0, 0, 1]


def test_with_more_frames_than_records_a_reward_is_counted_once() -> None:
    steps = steps_of(episode(video_hz=20))
    assert steps.record.tolist() == [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7]
    assert steps.reward.tolist() == [*[0] * 15, 1]


def test_a_step_has_all_streams_at_its_record() -> None:
    made = episode(video_hz=4)
    steps = steps_of(made)
    assert set(steps.streams) == set(made.streams)
    for name, values in made.streams.items():
        np.testing.assert_array_equal(steps.streams[name], values[[1, 4, 6]], strict=True)
