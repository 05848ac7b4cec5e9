"""A network of its own, with loopback alone: what a test sends in it reaches nobody else.

Run as a program, it holds a namespace (no arguments), or runs a command in that of a process:
``python network_namespace.py PID COMMAND...``.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

_NEW_USER, _NEW_NET = 0x10000000, 0x40000000
"""CLONE_NEWUSER and CLONE_NEWNET of linux/sched.h."""
_GET_FLAGS, _SET_FLAGS, _IS_UP = 0x8913, 0x8914, 1
"""SIOCGIFFLAGS and SIOCSIFFLAGS of linux/sockios.h, and IFF_UP."""
_READY = b"ready\n"


class NoNamespaceError(Exception):
    """This machine allows no network namespace; the message says why."""


@dataclass(frozen=True, slots=True)
class Namespace:
    """A network namespace, as long as the process lives that holds it."""

    pid: int

    def command(self, *command: object) -> list[str]:
        """Return the command line that runs a command in it."""
        return [sys.executable, __file__, str(self.pid), *map(str, command)]


@contextmanager
def network_namespace() -> Iterator[Namespace]:
    """Yield a new namespace.

    Raises:
        NoNamespaceError: if the machine allows none.
    """
    holder = subprocess.Popen(
        [sys.executable, __file__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert holder.stdin and holder.stdout and holder.stderr
    with holder:
        try:
            if holder.stdout.readline() != _READY:
                raise NoNamespaceError(holder.stderr.read().decode().strip().splitlines()[-1])
            yield Namespace(holder.pid)
        finally:
            holder.stdin.close()


def hold() -> None:
    """Make a namespace, and keep it until stdin ends."""
    _call("unshare", _NEW_NET | (0 if os.geteuid() == 0 else _NEW_USER))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(any_socket, _GET_FLAGS, request))[1]
        fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sh14x", b"lo", flags | _IS_UP))
    sys.stdout.buffer.write(_READY)
    sys.stdout.flush()
    sys.stdin.buffer.read()


def enter(pid: int) -> None:
    """Join the namespace of a process."""
    for name in ("net",) if os.geteuid() == 0 else ("user", "net"):
        with Path(f"/proc/{pid}/ns/{name}").open("rb") as file:
            _call("setns", file.fileno(), 0)


def _call(name: str, *arguments: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if getattr(libc, name)(*arguments):
        raise OSError(ctypes.get_errno(), f"{name}: {os.strerror(ctypes.get_errno())}")


if __name__ == "__main__":
    if len(sys.argv) == 1:
        hold()
    else:
        enter(int(sys.argv[1]))
        os.execvp(sys.argv[2], sys.argv[2:])
