"""How soon the browse page shows 100,000 rows, over a real socket: makes a store, serves, measures.

    PYTHONPATH=tests python -m benchmarks.bench_browse [OPTIONS]

The rows are those of ``bench_index``. What one episode takes (images, series, cloud) is measured on
the store of ``--store``, whose images have a size that people use, one request after the other; the
60 thumbnails over 6 connections, as browsers do. Times are medians but for what is cold, which is
there once.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.bench_index import make
from support.browse_process import Running, browsing

REPEATS = 7
CONNECTIONS, THUMBS = 6, 60
FIRST_PAGE_S = 1.0
"""Bound of the first page: the document, the library, the rows and a histogram."""
FIRST_PAGE = (
    *("/", "/static/main.js", "/static/style.css", "/api/library"),
    *("/api/episodes?limit=60", "/api/histogram?column=outcome"),
)
LATER = (
    "/api/episodes?where=policy%3Duniform&sort=-lift_height",
    "/api/histogram?column=lift_height",
    "/api/neighbours/0/500?sort=-lift_height",
    "/api/ids?where=success%3Dtrue",
)


class Client:
    """A connection that stays open."""

    def __init__(self, server: Running) -> None:
        self._connection = server.connect()

    def get(self, address: str) -> bytes:
        self._connection.request("GET", address)
        answer = self._connection.getresponse()
        body = answer.read()
        assert answer.status == 200, (address, body[:200])
        return body


def clock(function: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the median milliseconds of some calls."""
    took = []
    for _ in range(repeats):
        started = time.perf_counter()
        function()
        took.append(1e3 * (time.perf_counter() - started))
    return statistics.median(took)


def thumbs(server: Running, rows: Iterable[int]) -> float:
    """Return the seconds of thumbnails that a browser asks for at once."""
    clients = [Client(server) for _ in range(CONNECTIONS)]
    addresses = [f"/thumb/0/{row}.jpg" for row in rows]
    parts = [addresses[k::CONNECTIONS] for k in range(CONNECTIONS)]
    started = time.perf_counter()
    with ThreadPoolExecutor(CONNECTIONS) as pool:
        todo = zip(clients, parts, strict=True)
        list(pool.map(lambda job: [job[0].get(address) for address in job[1]], todo))
    return time.perf_counter() - started


def many_rows(path: Path) -> bool:
    """Print what the grid of a large store takes; return whether the first page is soon there."""
    started = time.perf_counter()
    with browsing(path) as server:
        print(f"start, with the index made: {time.perf_counter() - started:.1f} s")
    started = time.perf_counter()
    with browsing(path) as server:
        print(f"start, with the index there: {time.perf_counter() - started:.1f} s")
        client = Client(server)
        started = time.perf_counter()
        for address in FIRST_PAGE:
            client.get(address)
        first = time.perf_counter() - started
        print(f"first page of {FIRST_PAGE_S:.1f} s at most: {first:.2f} s")
        for address in (*FIRST_PAGE, *LATER):
            took = clock(lambda address=address: client.get(address))
            print(f"  {address:58} {took:8.1f} ms {len(client.get(address)) / 1e3:8.0f} kB")
        rows = [row["row"] for row in json.loads(client.get("/api/episodes"))["rows"]]
        print(f"60 thumbnails of small images: cold {thumbs(server, rows):.2f} s,", end=" ")
        print(f"warm {thumbs(server, rows):.2f} s")
    return first <= FIRST_PAGE_S


def one_episode(path: Path, index: Path) -> None:
    """Print what the page of one episode takes, row by row so that nothing is kept."""
    with browsing(path, "--index", index) as server:
        client = Client(server)
        library = json.loads(client.get("/api/library"))["stores"][0]
        camera, size = library["cameras"][0], "x".join(map(str, library["resolution"]))
        print(f"{path.name}: {library['committed']} episodes, {size}")
        rows = [row["row"] for row in json.loads(client.get("/api/episodes?limit=200"))["rows"]]
        for address in (
            *("/api/episode/0/{}", "/api/series/0/{}", "/api/tactile/0/{}", "/cloud/0/{}/0"),
            *(f"/image/0/{{}}/{camera}/{kind}/0.png" for kind in ("rgb", "depth", "overlay")),
        ):
            todo = iter(rows[100:])
            body = client.get(address.format(rows[99]))
            took = clock(lambda address=address, todo=todo: client.get(address.format(next(todo))))
            print(f"  {address.format('R'):58} {took:8.1f} ms {len(body) / 1e3:8.0f} kB")
        print(f"60 thumbnails: cold {thumbs(server, rows[:THUMBS]):.2f} s,", end=" ")
        print(f"warm {thumbs(server, rows[:THUMBS]):.2f} s")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--store", type=Path)
    options = parser.parse_args()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=options.folder)))
        if options.rows:
            make(folder / "benchmarks.bench.zarr", options.rows)
            is_soon = many_rows(folder / "benchmarks.bench.zarr")
        if options.store:
            one_episode(options.store, folder / "store.sqlite")
    if options.rows and not is_soon:
        raise SystemExit("the first page takes too long")


if __name__ == "__main__":
    main()
