"""The child process that converts objects: ``python -m grasp_factory.meshes.worker``.

Meshes are data of anybody's making, and their decomposition is native code. Here a crash ends
this process and nothing else, and its memory has a limit.
"""

from __future__ import annotations

import os
import resource
import sys
import warnings

from grasp_factory.errors import GraspFactoryError
from grasp_factory.meshes.base import UnusableError
from grasp_factory.meshes.job import Job, decode, encode, receive
from grasp_factory.records import from_plain, to_plain

MAX_MEMORY = 6 * 2**30
"""Bytes of address space; an ordinary object takes less than one."""
MISSING = "missing"


def main() -> None:
    """Answer jobs on the standard streams until the first one closes."""
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print what they like
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    while message := receive(sys.stdin.buffer):
        replies.write(_answer(message))
        replies.flush()


def _answer(message: bytes) -> bytes:
    try:
        from grasp_factory.meshes.convert import convert  # noqa: PLC0415
    except ImportError as error:
        return encode({MISSING: error.name or str(error)})
    plain, blobs = decode(message)
    try:
        found, files = convert(from_plain(Job, plain["job"]), blobs)
    except UnusableError as error:
        return encode({"refused": str(error)})
    except MemoryError:
        return encode({"failed": f"it takes more than {MAX_MEMORY // 2**30} GiB of memory"})
    except GraspFactoryError as error:  # a record's own checks: the numbers are beyond its bounds
        return encode({"refused": f"its conversion gave what no object has: {error}"})
    except Exception as error:
        why = (str(error).splitlines() or [""])[0][:200]
        return encode({"failed": f"its conversion failed: {type(error).__name__}: {why}"})
    return encode({"converted": to_plain(found)}, list(files.values()))


if __name__ == "__main__":
    main()
