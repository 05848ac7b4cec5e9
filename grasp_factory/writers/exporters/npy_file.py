"""Reading a .npy file of a stranger: nothing is unpickled, and sizes are checked first."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from grasp_factory.core.limits import CHUNK
from grasp_factory.core.place import Place


def read_npy(place: Place) -> NDArray[Any]:
    """Return the array of a .npy file.

    Raises:
        ValueError: if it is no such file, holds Python objects, or is shorter than it says.
        OSError: if it cannot be read.
        LimitError: if it is too large.
    """
    data = io.BytesIO(place.read_bytes(CHUNK))
    if npy.read_magic(data) != (1, 0):
        raise ValueError(f"{place.name}: another version of .npy than 1.0")
    shape, is_fortran, dtype = npy.read_array_header_1_0(data)
    if dtype.hasobject:
        raise ValueError(f"{place.name}: it holds Python objects")
    rest = data.getbuffer()[data.tell() :]
    if math.prod(shape) * dtype.itemsize != len(rest):
        raise ValueError(f"{place.name}: {len(rest)} bytes for {dtype} {shape}")
    return np.frombuffer(rest, dtype).reshape(shape, order="F" if is_fortran else "C")
