"""Processes that stand for other platforms: another C library's sine, other kernels."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

WITHOUT_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4"}
"""The C library's sine for processors without FMA, which differs in last bits."""


def has_fma() -> bool:
    """Say whether the C library is one that has functions with and without FMA here."""
    cpu = Path("/proc/cpuinfo")
    flags = cpu.read_text(encoding="utf-8").split() if cpu.exists() else []
    return platform.libc_ver()[0] == "glibc" and "fma" in flags


needs_fma = pytest.mark.skipif(
    not has_fma(), reason="without FMA the C library has one sine only: no platform differs here"
)


def in_a_process(code: str, variables: dict[str, str]) -> str:
    """Run Python code in a process of its own, and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def command(*words: object, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, with more environment variables."""
    return subprocess.run(
        [sys.executable, "-m", "grasp_factory", *map(str, words)],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
