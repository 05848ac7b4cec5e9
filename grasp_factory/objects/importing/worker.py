"""The child process that converts objects: ``python -m grasp_factory.objects.importing.worker``.

Meshes come from strangers, and their decomposition is native code. A crash ends only this process,
and its memory is limited.
"""

from __future__ import annotations

import os
import resource
import sys
import warnings

from grasp_factory.core.process_end import end_with_parent
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.errors import GraspFactoryError
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.messages import Job, decode, encode, receive

MAX_MEMORY = 6 * 2**30
"""Bytes of address space; an ordinary object takes less than 1 GiB."""
CPU_LIMIT_S = 120
"""CPU seconds of all threads for one object; an ordinary one takes up to 15."""
MISSING = "missing"


def main() -> None:
    """Answer jobs on the standard streams until standard input closes."""
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print to standard output
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    end_with_parent()  # an importer that is killed cannot end this process
    warnings.simplefilter("ignore")
    while message := receive(sys.stdin.buffer):
        _limit_cpu()
        replies.write(_answer(message))
        replies.flush()


def _limit_cpu() -> None:
    """Limit the CPU time of the next object, which does not depend on the machine's load."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + CPU_LIMIT_S
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (limit if hard < 0 else min(limit, hard), hard))


def _answer(message: bytes) -> bytes:
    try:
        from grasp_factory.objects.importing.convert import convert  # noqa: PLC0415
    except ImportError as error:
        return encode({MISSING: error.name or str(error)})
    plain, blobs = decode(message)
    try:
        found, files = convert(from_plain(Job, plain["job"]), blobs)
    except UnusableError as error:
        return encode({"refused": str(error)})
    except MemoryError:
        return encode({"failed": f"it takes more than {MAX_MEMORY // 2**30} GiB of memory"})
    except GraspFactoryError as error:  # raised by the record's own checks
        return encode({"refused": f"its conversion made an invalid object: {error}"})
    except Exception as error:
        why = (str(error).splitlines() or [""])[0][:200]
        return encode({"failed": f"its conversion failed: {type(error).__name__}: {why}"})
    return encode({"converted": to_plain(found)}, list(files.values()))


if __name__ == "__main__":
    main()
