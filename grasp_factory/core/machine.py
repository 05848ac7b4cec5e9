"""Facts about this machine (processor, C library, kernels), which a store keeps as text."""

from __future__ import annotations

import ctypes
import platform
from pathlib import Path

import numpy as np

UNKNOWN = "unknown"
_LEVELS = {
    "x86-64-v1": "cmov cx8 fpu fxsr mmx sse sse2",
    "x86-64-v2": "cx16 lahf_lm pni popcnt sse4_1 sse4_2 ssse3",
    "x86-64-v3": "abm avx avx2 bmi1 bmi2 f16c fma movbe xsave",
    "x86-64-v4": "avx512bw avx512cd avx512dq avx512f avx512vl",
}
"""Microarchitecture level to the CPU flags that it adds, with the names of the Linux kernel."""
_LIBRARIES = "*openblas*"
_CORE_NAMES = (
    "scipy_openblas_get_corename64_",
    "openblas_get_corename64_",
    "openblas_get_corename",
)
"""Names of the same OpenBLAS function; the name depends on how the library was built."""


def platform_facts() -> dict[str, str]:
    """Return facts by name: machine, libc, cpu, level and kernels.

    The bytes of episodes do not depend on them.
    """
    told = _cpuinfo()
    return {
        "machine": platform.machine(),
        "libc": " ".join(platform.libc_ver()),
        "cpu": told.get("model name", "") or platform.processor(),
        "level": level(told.get("flags", "")),
        "kernels": f"OpenBLAS {_openblas()}, numpy {_numpy_features()}",
    }


def level(flags: str) -> str:
    """Return the x86-64 microarchitecture level of a processor with these flags."""
    found, has = UNKNOWN, set(flags.split())
    for name, needed in _LEVELS.items():
        if not has.issuperset(needed.split()):
            break
        found = name
    return found


def _cpuinfo() -> dict[str, str]:
    """Return the entries of /proc/cpuinfo for the first processor; empty if it cannot be read."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return {}
    lines = (line.partition(":") for line in text.partition("\n\n")[0].splitlines())
    return {key.strip(): value.strip() for key, _, value in lines}


def _openblas() -> str:
    """Return the name of the kernels that numpy's bundled OpenBLAS has chosen."""
    folder = Path(np.__file__).parent.with_name("numpy.libs")
    for file in sorted(folder.glob(_LIBRARIES)):
        try:
            library = ctypes.CDLL(str(file))
        except OSError:
            continue
        for name in _CORE_NAMES:
            if hasattr(library, name):
                get = getattr(library, name)
                get.restype = ctypes.c_char_p
                return (get() or b"").decode(errors="replace") or UNKNOWN
    return UNKNOWN


def _numpy_features() -> str:
    """Return the instruction sets that numpy uses here in addition to its baseline."""
    told = np.show_config(mode="dicts")  # type: ignore[call-overload, unused-ignore]
    features = told.get("SIMD Extensions", {}) if isinstance(told, dict) else {}
    return " ".join(features.get("found", [])) or "baseline"
