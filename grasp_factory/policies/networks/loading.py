"""Saving and loading of models as safetensors files: arrays and a JSON header, but no code."""

# ruff: noqa: PLC0415

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from grasp_factory.core.json_text import parsed
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.errors import UsageError, shown
from grasp_factory.policies.networks.inputs import KINDS, TouchWindow
from grasp_factory.policies.networks.model import GraspModel
from grasp_factory.signals.grasp_crop import CropShape

KEY = "grasp_factory"
"""Key in the metadata of the safetensors header; its value is the JSON about the model."""
FORMAT = 1
LONGEST_HEADER = 2**20


def save_model(model: GraspModel) -> bytes:
    """Return the bytes of a model's file; equal models have equal bytes.

    Raises:
        MissingLibraryError: if torch or safetensors is not installed.
    """
    require("torch", "safetensors", extra="train")
    from safetensors.torch import save

    header = {
        "format": FORMAT,
        "kind": model.kind,
        "crop": to_plain(model.crop),
        "touch": to_plain(model.touch),
        "slope": model.slope,
        "offset": model.offset,
        "facts": model.facts,
    }
    state = {name: tensor.contiguous() for name, tensor in model.network.state_dict().items()}
    return bytes(save(state, {KEY: json.dumps(header, sort_keys=True)}))


def load_model(data: bytes, kind: str = "vision") -> GraspModel:
    """Return the model in a file's bytes.

    Args:
        data: The bytes that ``save_model`` returned.
        kind: The required kind, one of ``KINDS``, or "" for any.

    Raises:
        UsageError: if the file is not a model or is of another kind, or if torch or safetensors is
            not installed.
    """
    require("torch", "safetensors", extra="train")
    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load

    from grasp_factory.policies.networks.nets import GraspNet

    header = _header(data)
    found = header["kind"]
    if kind not in ("", found):
        raise UsageError(f"it is a model of kind {shown(found)}, valid: {kind}")
    try:
        crop = from_plain(CropShape, header["crop"], "crop")
        window = from_plain(TouchWindow, header["touch"], "touch")
        network = GraspNet(KINDS[found], crop.size)
        network.load_state_dict(load(data))
        slope, offset = float(header["slope"]), float(header["offset"])
        facts = dict(header["facts"])
    except (KeyError, TypeError, ValueError, OverflowError, RuntimeError, SafetensorError) as error:
        reason = str(error).splitlines()[0][:200]
        raise UsageError(f"its contents do not fit a model of kind {found}: {reason}") from None
    weights = [torch.tensor([slope, offset]), *network.state_dict().values()]
    if not all(torch.isfinite(tensor).all() for tensor in weights):
        raise UsageError("its weights are not all finite numbers")
    return GraspModel(
        kind=found, crop=crop, touch=window, network=network.eval(), slope=slope, offset=offset,
        facts=facts, sha256=hashlib.sha256(data).hexdigest(),
    )  # fmt: skip


def _header(data: bytes) -> Mapping[str, Any]:
    """Return this package's part of a safetensors header: 8 bytes with its length, then JSON.

    Raises:
        UsageError: if it is missing or its format is unknown.
    """
    length = int.from_bytes(data[:8], "little")
    try:
        if not 0 < length <= min(LONGEST_HEADER, len(data) - 8):
            raise ValueError("no safetensors header")
        header = parsed(parsed(data[8 : 8 + length])["__metadata__"][KEY])
        version, kind = header["format"], header["kind"]
        is_ours = version == FORMAT and kind in KINDS
    except (ValueError, KeyError, TypeError):
        raise UsageError(
            "it is no model of grasp-factory; `grasp-factory train` makes one"
        ) from None
    if not is_ours:
        raise UsageError(
            f"it is a model of format {shown(version)}, kind {shown(kind)};"
            f" valid: format {FORMAT}, kind {' or '.join(KINDS)}"
        )
    return dict(header)
