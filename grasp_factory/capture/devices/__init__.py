"""The table of devices. A new driver is a file in this folder with its class, and a row here."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.capture.devices.article_ft import ARTICLE_FT_MODEL
from grasp_factory.capture.devices.ati_net_ft import ATI_NET_FT_MODEL
from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.bmi088 import BMI088_MODEL
from grasp_factory.capture.devices.joints import JOINTS_MODEL
from grasp_factory.capture.devices.onrobot import ONROBOT_MODEL
from grasp_factory.capture.devices.opencv import OPENCV_MODEL
from grasp_factory.capture.devices.realsense import REALSENSE_MODEL
from grasp_factory.capture.devices.robotiq_ft300 import ROBOTIQ_FT300_MODEL
from grasp_factory.capture.devices.ros2 import ROS2_MODELS
from grasp_factory.capture.devices.rosbag import ROSBAG_MODELS
from grasp_factory.capture.devices.tactile_array import TACTILE_ARRAY_MODEL

DEVICES: Mapping[str, DeviceModel] = {
    model.name: model
    for model in (
        OPENCV_MODEL,
        REALSENSE_MODEL,
        BMI088_MODEL,
        ARTICLE_FT_MODEL,
        ATI_NET_FT_MODEL,
        ONROBOT_MODEL,
        ROBOTIQ_FT300_MODEL,
        TACTILE_ARRAY_MODEL,
        JOINTS_MODEL,
        *ROSBAG_MODELS,
        *ROS2_MODELS,
    )
}
"""Drivers by name."""
