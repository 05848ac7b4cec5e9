"""The time series that only real episodes have: each sensor at its own times."""

from __future__ import annotations

from grasp_factory.core.field import Field
from grasp_factory.core.series_group import SeriesGroup

FORCE_TORQUE = SeriesGroup(
    name="force_torque",
    title="the force-torque sensor's series",
    dim="F",
    dimension_name="force_torque_sample",
    count="n_force_torque",
    rate=lambda rates: rates.capture.force_torque_hz if rates.capture else 0,
    is_real=True,
)
JOINTS = SeriesGroup(
    name="joints",
    title="the states of joints and gripper",
    dim="Q",
    dimension_name="joint_state",
    count="n_joint_states",
    rate=lambda rates: rates.capture.joints_hz if rates.capture else 0,
    is_real=True,
)
TAXELS = SeriesGroup(
    name="taxels",
    title="the tactile array's frames",
    dim="Z",
    dimension_name="taxel_frame",
    count="n_taxel_frames",
    rate=lambda rates: rates.capture.taxels_hz if rates.capture else 0,
    is_real=True,
)
REAL_GROUPS = (FORCE_TORQUE, JOINTS, TAXELS)


def _clock(group: SeriesGroup) -> Field:
    text = "when each sample was taken: time since the episode's start"
    return group.series("timestamp", (), "float64", text, units="s", is_real=True, always=True)


def _state(name: str, dims: tuple[str, ...], description: str, units: str) -> Field:
    return JOINTS.series(name, dims, "float64", description, units=units, is_real=True, gaps=True)


REAL_SERIES: tuple[Field, ...] = (
    _clock(FORCE_TORQUE),
    FORCE_TORQUE.series("wrench", (6,), "float64", "load on the sensor: force N, torque N m",
                        frame="sensor: the axes of the device", is_real=True, gaps=True),
    _clock(JOINTS),
    _state("positions", ("J",), "measured; NaN for joints that the arm does not have", "rad"),
    _state("velocities", ("J",), "measured", "rad/s"),
    _state("torques", ("J",), "measured", "N m"),
    _state("position_targets", ("J",), "commanded", "rad"),
    _state("gripper_width", (), "distance between the pads, measured", "m"),
    _state("gripper_width_target", (), "commanded", "m"),
    _state("gripper_force", (), "as the gripper reports it", "N"),
    _clock(TAXELS),
    TAXELS.series("pressure", ("X", "Y"), "float32", "value of each taxel, in the device's unit",
                  is_real=True, gaps=True),
)  # fmt: skip
"""The arrays of real devices, in the order of the schema."""
