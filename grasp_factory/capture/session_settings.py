"""The settings of a recorded session, ``session.yaml``, as plain data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from grasp_factory.capture.session_reader import SETTINGS_FILE
from grasp_factory.core.config.yaml_loader import MAX_BYTES, parse_yaml
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import place_of
from grasp_factory.errors import CaptureError, ConfigError, shown


def session_settings(session: Path) -> dict[str, Any]:
    """Return the settings with which a session was recorded.

    Raises:
        CaptureError: if the file is missing, or is no YAML mapping.
        IrregularFileError: if it is a link.
    """
    file = session / SETTINGS_FILE
    try:
        content = (place_of(session) / SETTINGS_FILE).read_bytes(DOCUMENT)
        if len(content) > MAX_BYTES:
            raise CaptureError(f"{file} is no session's settings: more than {MAX_BYTES} bytes")
        data = parse_yaml(content.decode("utf-8"), str(file))
    except OSError as error:
        why = error.strerror or error
        raise CaptureError(
            f"{session} is no session: {SETTINGS_FILE} in it cannot be read ({why}); valid: a"
            " folder that `grasp-factory capture run` made"
        ) from None
    except (ConfigError, UnicodeDecodeError) as error:
        raise CaptureError(f"{file} cannot be read: {shown(str(error))}") from None
    if not isinstance(data, dict):
        raise CaptureError(f"{file}: expected a mapping of keys, got {shown(data)}")
    return data
