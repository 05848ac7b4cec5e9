"""How the viewer is laid out when a recording is opened."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from grasp_factory.apps.rerun.cameras import CAMERAS
from grasp_factory.apps.rerun.clock import TIME
from grasp_factory.apps.rerun.series import LOG, PHASE, SERIES
from grasp_factory.signals.plot_series import CurveGroup

SHOWN = (
    *("joint_positions", "gripper_width", "pad_force", "wrist_force", "imu_specific_force"),
    "object_height",
)
"""Curves that are shown at first; the others are in other tabs."""
PLOTS_AT_ONCE = 3
EYE, TARGET = (1.5, -1.1, 0.8), (0.4, 0.0, 0.25)
"""Initial position and target of the view, metres: robot and workspace fill the view."""


def blueprint(cameras: Sequence[str], groups: Sequence[CurveGroup]) -> rrb.Blueprint:
    """Return the layout: scene and images on the left, curves on the right, text below."""
    hidden = [f"- /{CAMERAS}/{name}/{kind}/**" for name in cameras
              for kind in ("depth", "segmentation")]  # fmt: skip
    scene = rrb.Spatial3DView(
        origin="/",
        name="scene",
        contents=["+ /**", *hidden],
        eye_controls=rrb.EyeControls3D(position=EYE, look_target=TARGET, eye_up=(0.0, 0.0, 1.0)),
    )
    curves = sorted(groups, key=lambda group: group.key not in SHOWN)
    plots = [
        rrb.TimeSeriesView(origin=f"{SERIES}/{g.key}", name=f"{g.title}, {g.units}") for g in curves
    ]
    columns = [plots[i : i + PLOTS_AT_ONCE] for i in range(0, len(plots), PLOTS_AT_ONCE)]
    words = rrb.Tabs(
        rrb.TextDocumentView(origin="episode", name="episode"),
        rrb.TextLogView(origin=LOG, name="log"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, _images(cameras), row_shares=[3, 2]),
            rrb.Vertical(
                rrb.StateTimelineView(origin=PHASE, name="phase"),
                rrb.Tabs(
                    *(
                        rrb.Vertical(*column, name=", ".join(g.title for g in part))
                        for column, part in zip(columns, _parts(curves), strict=True)
                    )
                ),
                words,
                row_shares=[1, 5, 2],
            ),
            column_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIME),
        auto_views=False,
    )


def _parts(curves: Sequence[CurveGroup]) -> list[Sequence[CurveGroup]]:
    return [curves[i : i + PLOTS_AT_ONCE] for i in range(0, len(curves), PLOTS_AT_ONCE)]


def _images(cameras: Sequence[str]) -> rrb.Container:
    """Return a tab for each camera, with its images side by side."""
    return rrb.Tabs(
        *(
            rrb.Horizontal(
                *(
                    rrb.Spatial2DView(
                        origin=f"{CAMERAS}/{name}", name=kind, contents=[f"$origin/{kind}"]
                    )
                    for kind in ("rgb", "depth", "segmentation")
                ),
                name=name,
            )
            for name in cameras
        )
    )
