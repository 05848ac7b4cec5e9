"""Commands of topics in a network namespace."""

from __future__ import annotations

import os
import subprocess
import sys

from support.network_namespace import Namespace
from support.places import REPOSITORY, TESTS

LONGEST_S = 120


class TopicCommands:
    """Runs ``capture`` in a namespace, several at the same time."""

    def __init__(self, namespace: Namespace) -> None:
        self._namespace = namespace
        self._processes: list[subprocess.Popen[str]] = []

    def start(self, *arguments: object) -> subprocess.Popen[str]:
        """Start ``grasp-factory capture ...``."""
        return self.start_python("grasp_factory", "capture", *arguments)

    def start_python(self, module: str, *arguments: object) -> subprocess.Popen[str]:
        """Start a module of Python."""
        command = (sys.executable, "-m", module, *arguments)
        process = subprocess.Popen(
            self._namespace.command(*command),
            env=os.environ | {"PYTHONPATH": f"{REPOSITORY}{os.pathsep}{TESTS}"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._processes.append(process)
        return process

    def run(self, *arguments: object) -> tuple[int, str, str]:
        """Run a command; return exit code, stdout and stderr."""
        return ended(self.start(*arguments))

    def kill(self) -> None:
        """Kill those that still run."""
        for process in self._processes:
            process.kill()
            process.communicate()


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Wait for a command; return exit code, stdout and stderr."""
    out, err = process.communicate(timeout=LONGEST_S)
    return process.returncode, out, err
