"""Features of TensorFlow Datasets: how an array is stored, and what ``features.json`` says of it.

The file is a message Feature of
https://github.com/tensorflow/datasets/blob/master/tensorflow_datasets/proto/feature.proto in JSON.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from grasp_factory.writers.exporters.images import png
from grasp_factory.writers.exporters.tfrecord_file import FeatureList

_CLASSES = "tensorflow_datasets.core.features"
_ZLIB_LEVEL = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class TfdsFeature:
    """One array of an episode, or of each step, with its encoding.

    TFDS stores numbers as int64 or float32; other types keep their values as bytes only.
    """

    shape: tuple[int | None, ...]
    """Without the steps; None for a length that differs between episodes."""
    dtype: str
    """Of numpy, or ``string``."""
    encoding: str
    """``none``, ``bytes``, ``zlib`` or ``png``."""

    @classmethod
    def of(cls, values: NDArray[Any], shape: tuple[int | None, ...]) -> TfdsFeature:
        """Return the feature of such values, as numbers or texts where TFDS keeps all bits."""
        dtype = "string" if values.dtype.kind == "U" else values.dtype.name
        is_code = shape == () and values.dtype.kind in "bui"
        is_plain = is_code or dtype in ("string", "float32")
        return cls(shape=shape, dtype=dtype, encoding="none" if is_plain else "bytes")

    def encode(self, values: NDArray[Any], *, steps: bool) -> FeatureList:
        """Return what an example holds of an episode's values, or with ``steps`` of each step's."""
        if self.dtype == "string":
            return [text.encode() for text in values.ravel().tolist()]
        if self.encoding == "none":
            return values
        return [self._bytes(value) for value in (values if steps else values[None])]

    def _bytes(self, value: NDArray[Any]) -> bytes:
        if self.encoding == "png":
            return png(value)
        data = value.astype(value.dtype.newbyteorder("<")).tobytes()
        return zlib.compress(data, _ZLIB_LEVEL) if self.encoding == "zlib" else data

    def to_json(self) -> dict[str, Any]:
        """Return its part of ``features.json``."""
        sides = {"dimensions": [str(-1 if side is None else side) for side in self.shape]}
        shape = sides if self.shape else {}
        if self.encoding == "png":
            about = {"shape": shape, "dtype": self.dtype, "encodingFormat": "png"}
            return {"pythonClassName": f"{_CLASSES}.image_feature.Image", "image": about}
        about = {"shape": shape, "dtype": self.dtype, "encoding": self.encoding}
        return {"pythonClassName": f"{_CLASSES}.tensor_feature.Tensor", "tensor": about}


def features_json(features: Mapping[str, TfdsFeature]) -> dict[str, Any]:
    """Return ``features.json`` of features by name; a name has its groups before a slash.

    The group ``steps`` is a data set of its own, with an element for each step.
    """
    top = _group(features)
    steps = top["featuresDict"]["features"]["steps"]
    top["featuresDict"]["features"]["steps"] = {
        "pythonClassName": f"{_CLASSES}.dataset_feature.Dataset",
        "sequence": {"feature": steps, "length": "-1"},
    }
    return top


def _group(features: Mapping[str, TfdsFeature]) -> dict[str, Any]:
    nodes: dict[str, Any] = {}
    groups: dict[str, dict[str, TfdsFeature]] = {}
    for name, feature in features.items():
        group, _, rest = name.partition("/")
        if rest:
            groups.setdefault(group, {})[rest] = feature
        else:
            nodes[name] = feature.to_json()
    nodes |= {name: _group(members) for name, members in groups.items()}
    return {
        "pythonClassName": f"{_CLASSES}.features_dict.FeaturesDict",
        "featuresDict": {"features": nodes},
    }
