"""Reads samples from a driver of topics: ``python -m support.topic_reader DRIVER SETTINGS N OUT``.

OUT gets the arrays of the first N samples, ``np.savez``.
"""

from __future__ import annotations

import json
import sys
from dataclasses import fields
from itertools import islice

import numpy as np

from grasp_factory.capture.devices import DEVICES
from grasp_factory.errors import CaptureError


def main() -> int:
    name, settings, count, out = sys.argv[1:]
    device = DEVICES[name].make(json.loads(settings))
    try:
        device.open()
        samples = list(islice(device.samples(), int(count)))
    except CaptureError as error:
        print(f"CaptureError: {error}")
        return 1
    finally:
        device.stop()
        device.close()
    names = [field.name for field in fields(samples[0].payload)]
    arrays = {name: np.array([getattr(each.payload, name) for each in samples]) for name in names}
    times = {
        key: np.array([getattr(each, key) for each in samples]) for key in ("device_ns", "host_ns")
    }
    np.savez(out, **arrays, **times)
    assert device.counters.samples >= int(count)
    assert device.counters.implausible == 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
