"""Calibration of a camera in the words of other tools: K and distortion, kalibr's extrinsics."""

from __future__ import annotations

from typing import Any

from grasp_factory.core.config.cameras import CameraConfig, Mount
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, inverse, look_at, pose_matrices


def intrinsics(episode: Episode, camera: str) -> dict[str, Any]:
    """Return size (pixels) and K (row by row) of a camera, and its distortion: zeros."""
    height, width = episode.cameras[camera].rgb.shape[1:3]
    K = episode.cameras[camera].intrinsics.ravel().tolist()
    return {"width": width, "height": height, "K": K, "D": [0.0] * 5}


def kalibr_camera(episode: Episode, camera: str) -> dict[str, Any]:
    """Return a camera's entry of kalibr's file ``camchain-imucam.yaml``.

    https://github.com/ethz-asl/kalibr/wiki/yaml-formats: ``T_cam_imu`` maps the IMU's frame to the
    camera's. It is constant for a camera on the hand only; for another camera it is that of the
    first record. It is left out if the episode has no record.
    """
    images = episode.cameras[camera]
    height, width = images.rgb.shape[1:3]
    K = images.intrinsics
    settings = episode.spec.cameras[camera]
    is_on_hand = settings.mount is Mount.TCP
    T_cam_imu = _T_cam_imu(episode, settings, images.T_world_camera[0])
    pose = {} if T_cam_imu is None else {"T_cam_imu": T_cam_imu.tolist()}
    return pose | {
        "T_cam_imu_is_constant": is_on_hand,
        "camera_model": "pinhole",
        "intrinsics": [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])],
        "distortion_model": "radtan",
        "distortion_coeffs": [0.0] * 4,
        "resolution": [width, height],
        "timeshift_cam_imu": 0.0,
    }


def _T_cam_imu(episode: Episode, settings: CameraConfig, T_world_camera: Array) -> Array | None:
    T_tcp_imu = episode.imu["T_tcp_imu"]
    if settings.mount is Mount.TCP:
        return inverse(look_at(settings.eye, settings.target, settings.up)) @ T_tcp_imu
    if not episode.n_steps:
        return None
    T_world_tcp = pose_matrices(episode.streams["tcp_pose"][0])
    return inverse(T_world_camera) @ T_world_tcp @ T_tcp_imu
