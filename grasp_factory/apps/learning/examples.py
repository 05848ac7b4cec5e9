"""Examples for learning: network inputs and labels from the episodes of a store."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import UNKNOWN, Phase
from grasp_factory.core.geometry import Array, pose_matrices
from grasp_factory.core.real_columns import Source
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.sensor_reader import IMAGES
from grasp_factory.errors import UnknownNameError, UsageError, lookup, shown
from grasp_factory.policies.networks.inputs import (
    IMAGE,
    TOUCH,
    WIDTH,
    Inputs,
    TouchWindow,
    image_of,
    take,
    touch_of,
    width_of,
)
from grasp_factory.signals.grasp_crop import CropShape, grasp_relief

TOUCH_STREAMS = ("timestamp", "phase", "tactile_wrench")
INPUTS = (IMAGE, WIDTH, TOUCH)
LOOKS_AT = ("depth", "segmentation")
AT_ONCE = 16
"""Images of each kind and camera in memory at once: 20 MB of depth at 640 x 480."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grasps:
    """Column values of some episodes."""

    rows: NDArray[np.int64]
    """(K,) row numbers in the store."""
    success: NDArray[np.bool_]
    """(K,)."""
    object_id: NDArray[np.str_]
    """(K,)."""
    T_world_tcp: Array
    """(K, 4, 4): the poses of the grasps."""
    width: Array
    """(K,) metres, before closing."""

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, places: NDArray[np.int64] | slice) -> Grasps:
        """Return the grasps at some positions."""
        return Grasps(**{field.name: getattr(self, field.name)[places] for field in fields(Grasps)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Examples(Grasps):
    """Network inputs of some episodes, with their column values."""

    inputs: Inputs

    def take(self, places: NDArray[np.int64] | slice) -> Examples:
        """Return the examples at some positions."""
        known = {field.name: getattr(self, field.name)[places] for field in fields(Grasps)}
        return Examples(inputs=take(self.inputs, places), **known)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExampleReader:
    """Reads examples from a store on demand.

    Attributes:
        dataset: The store; if it was opened with ``noise``, examples are noisy.
        uses: Names of the inputs to read.
    """

    dataset: Dataset
    uses: Sequence[str]
    crop: CropShape = field(default_factory=CropShape)
    touch: TouchWindow = field(default_factory=TouchWindow)

    def __post_init__(self) -> None:
        """Check the names of the inputs.

        Raises:
            UnknownNameError: for an unknown name, listing the valid ones.
            UsageError: if ``uses`` is empty.
        """
        if isinstance(self.uses, str):
            raise UsageError(f"uses: got {shown(self.uses)}, valid: a list, such as ['image']")
        for name in self.uses:
            if name in IMAGES:
                what = f"input {name!r}: it is an image of the whole scene"
                whole = f"ds.images(rows, camera, {name!r}, frame), or ds[i].cameras"
                raise UnknownNameError(f"{what}: {whole}; valid: {', '.join(INPUTS)}")
            lookup(dict.fromkeys(INPUTS), "input", name)
        if not self.uses:
            raise UsageError(f"uses: got no input, valid: some of {', '.join(INPUTS)}")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of each input of one example, by name."""
        size, samples = self.crop.size, self.touch.samples
        every = {IMAGE: (3, size, size), WIDTH: (1,), TOUCH: (2, 6, samples)}
        return {name: every[name] for name in self.uses}

    def usable(self, rows: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
        """Return the rows with a grasp among ``rows`` (None for all), ascending.

        With touch among the inputs, return only the rows that reached the lift. With the image, a
        real row must have a calibration of every camera.

        Raises:
            UsageError: if there is no such row.
        """
        rows = self.dataset.committed if rows is None else np.sort(rows)
        planned = np.isfinite(self.dataset.column("grasp_position")[rows]).all(axis=1)
        rows = rows[planned]
        if IMAGE in self.uses and "source" in self.dataset.columns:
            is_real = self.dataset.column("source")[rows] == Source.REAL
            seen = [self._is_calibrated(row) for row in rows[is_real].tolist()]
            rows = np.sort(
                np.concatenate([rows[~is_real], rows[is_real][np.array(seen, np.bool_)]])
            )
        if TOUCH in self.uses:
            rows = rows[[self._has_lift(row) for row in rows.tolist()]]
        if not len(rows):
            raise UsageError(f"{self.dataset.name} has no episodes with a grasp to learn from")
        return rows

    def grasps(self, rows: NDArray[np.int64]) -> Grasps:
        """Return the column values of usable rows, in their order."""
        column = self.dataset.column
        poses = np.concatenate(
            [column("grasp_position")[rows], column("grasp_quat_xyzw")[rows]], axis=1
        )
        return Grasps(
            rows=rows,
            success=column("success")[rows],
            # As text of fixed width: numpy 2.4's intersect1d crashes on two StringDType arrays
            # (numpy pull request 31609).
            object_id=np.array(column("object_id")[rows].tolist(), dtype=np.str_),
            T_world_tcp=pose_matrices(poses),
            width=column("grasp_width")[rows],
        )

    def read(self, rows: NDArray[np.int64], on_row: Callable[[], None] = lambda: None) -> Examples:
        """Return the examples of usable rows, in their order.

        Args:
            rows: Row numbers, as ``usable`` returns them.
            on_row: Called after each row.
        """
        grasps = self.grasps(rows)
        known = {field.name: getattr(grasps, field.name) for field in fields(Grasps)}
        return Examples(inputs=self.inputs(grasps, on_row), **known)

    def inputs(self, grasps: Grasps, on_row: Callable[[], None] = lambda: None) -> Inputs:
        """Return the network inputs of episodes, in their order.

        The episodes are read in the order of their rows, so that a block's files are opened once.

        Args:
            grasps: The episodes.
            on_row: Called after each episode.
        """
        count = len(grasps)
        inputs = {n: np.empty((count, *shape), np.float32) for n, shape in self.shapes.items()}
        if WIDTH in inputs:
            inputs[WIDTH] = width_of(grasps.width)
        order = np.argsort(grasps.rows, kind="stable")
        for start in range(0, count, AT_ONCE):
            places = order[start : start + AT_ONCE]
            rows = grasps.rows[places].tolist()
            scenes = self.dataset.scenes(rows, LOOKS_AT) if IMAGE in inputs else []
            for k, (place, row) in enumerate(zip(places.tolist(), rows, strict=True)):
                if IMAGE in inputs:
                    seen = scenes[k].values()
                    relief = grasp_relief(seen, grasps.T_world_tcp[place], self.crop)
                    inputs[IMAGE][place] = image_of(relief)
                if TOUCH in inputs:
                    series = self.dataset.series(row, *TOUCH_STREAMS)
                    inputs[TOUCH][place] = touch_of(series, self.touch)
                on_row()
        return inputs

    def _is_calibrated(self, row: int) -> bool:
        known = (self.dataset.calibration(row, name, 0) for name in self.dataset.config.cameras)
        return all(np.isfinite(values).all() for pair in known for values in pair)

    def _has_lift(self, row: int) -> bool:
        phase = self.dataset.series(row, "phase")["phase"]
        return bool(((phase >= Phase.LIFT) & (phase != UNKNOWN)).any())
