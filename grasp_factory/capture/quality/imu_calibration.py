"""The noise of a session's IMUs as their calibration says it, in kalibr's imu.yaml form.

https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from grasp_factory.capture.quality.imu_noise import NoiseDensities
from grasp_factory.capture.session_reader import CALIBRATION_FOLDER
from grasp_factory.core.config.yaml_loader import MAX_BYTES, parse_yaml
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.place_tree import entries
from grasp_factory.core.serialization import is_number
from grasp_factory.core.text_format import size_text
from grasp_factory.errors import CaptureError, ConfigError, shown

_KEYS = ("accelerometer_noise_density", "gyroscope_noise_density")
_SUFFIXES = (".yaml", ".yml")
MOST_BYTES = 2**18
"""Of all YAML files of a session's calibrations together; one has a few kB."""


def noise_calibrations(session: Path) -> dict[str, NoiseDensities]:
    """Return the noise of IMUs by topic, from the calibration files of a session.

    Raises:
        CaptureError: if a file is no YAML, a noise is not above 0, or the files are too large.
        IrregularFileError: if a file is a link.
    """
    folder = place_of(session) / CALIBRATION_FOLDER
    if not folder.is_dir():
        return {}
    files = [folder / name for name in entries(folder).files if name.endswith(_SUFFIXES)]
    found: dict[str, NoiseDensities] = {}
    size = 0
    for file in files:
        content = file.read_bytes(DOCUMENT)
        if len(content) > MAX_BYTES:
            continue  # it is no calibration
        size += len(content)
        if size > MOST_BYTES:
            raise CaptureError(f"{folder}: its YAML files have more than {size_text(MOST_BYTES)}")
        found |= _of_file(file, content)
    return found


def _of_file(file: Place, content: bytes) -> dict[str, NoiseDensities]:
    """Return what a file says: of one IMU, or of several by name (imu0, imu1)."""
    try:
        data = parse_yaml(content.decode("utf-8"), str(file))
    except (ConfigError, UnicodeDecodeError) as error:
        raise CaptureError(f"{file} cannot be read: {shown(str(error))}") from None
    if not isinstance(data, Mapping):
        return {}
    imus = [data, *(each for each in data.values() if isinstance(each, Mapping))]
    return {str(imu.get("rostopic", "")): _densities(file, imu) for imu in imus if _is_imu(imu)}


def _is_imu(imu: Mapping[str, Any]) -> bool:
    return all(key in imu for key in _KEYS)


def _densities(file: Place, imu: Mapping[str, Any]) -> NoiseDensities:
    for key in _KEYS:
        if not is_number(imu[key]) or not 0 < imu[key] < 1e6:
            raise CaptureError(f"{file}: {key}: got {shown(imu[key])}, valid: a number above 0")
    return NoiseDensities(*(float(imu[key]) for key in _KEYS))
