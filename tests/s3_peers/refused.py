"""bin/check-s3: servers that ignore put-if-absent get no store, but one line.

Its argument is a folder with rclone/bin and s3rver/node_modules; what is not there is left out.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from support.places import TINY

KEY, BUCKET, NAME = "S3RVER", "bucket", "grasps.zarr"
"""Key and secret of the servers; s3rver takes no other."""
START_S = 60.0

Command = Callable[[Path, int, Path], list[str]]


def rclone(tools: Path, port: int, data: Path) -> list[str]:
    """Return the command of rclone's server; buckets are folders."""
    (data / BUCKET).mkdir()
    keys = ("--auth-key", f"{KEY},{KEY}", "--addr", f"127.0.0.1:{port}")
    return [str(tools / "rclone" / "bin" / "rclone"), "serve", "s3", *keys, str(data)]


def s3rver(tools: Path, port: int, data: Path) -> list[str]:
    """Return the command of s3rver."""
    where = ("-a", "127.0.0.1", "-p", str(port), "-d", str(data), "--configure-bucket", BUCKET)
    return [str(tools / "s3rver" / "node_modules" / ".bin" / "s3rver"), *where]


SERVERS: Mapping[str, Command] = {"rclone": rclone, "s3rver": s3rver}


def refused(command: list[str], port: int, data: Path) -> str:
    """Return the line that a writer gets from a server; raise SystemExit if it gets another."""
    environment = os.environ | {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": KEY,
        "GRASP_FACTORY_CACHE": str(data / "cache"),
    }  # fmt: skip
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        _wait_for(port)
        pack = (sys.executable, "-m", "grasp_factory", "pack", str(TINY), f"s3://{BUCKET}/{NAME}")
        done = subprocess.run(pack, env=environment, capture_output=True, text=True, check=False)
    finally:
        server.kill()
        server.wait()
    said = done.stderr.strip()
    if done.returncode != 2 or "ignores put-if-absent" not in said or "\n" in said:
        raise SystemExit(f"{command[0]}: exit code {done.returncode}: {said}")
    stored = {file.parent.name for file in (data / BUCKET).rglob("*") if file.is_file()}
    if stored != {NAME}:
        raise SystemExit(f"{command[0]}: more than the object that it was tried with: {stored}")
    return said


def _wait_for(port: int) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            return
        except OSError:
            time.sleep(0.1)
    raise SystemExit(f"no server at port {port}")


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        port: int = found.getsockname()[1]
        return port


def main() -> None:
    """Try each server."""
    tools = Path(sys.argv[1]).resolve()
    for name, of in SERVERS.items():
        with tempfile.TemporaryDirectory() as folder:
            port, data = _free_port(), Path(folder)
            command = of(tools, port, data)
            if not Path(command[0]).exists():
                print(f"{name}: left out, it is not in {tools}")
                continue
            print(f"{name}: {refused(command, port, data)}")


if __name__ == "__main__":
    main()
