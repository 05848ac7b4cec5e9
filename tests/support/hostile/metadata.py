"""Metadata of arrays, and attributes and configs of stores."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from support.hostile.table import (
    ATTACKS,
    BYTES,
    DEEP,
    ESCAPE,
    Attack,
    coded,
    configured,
    edited,
    write,
)


def _text(name: str, text: str) -> Attack:
    return lambda store, outside: write(store / name, text.encode())


ATTACKS["a zarr.json that is nested 200,000 deep"] = _text("zarr.json", DEEP)
ATTACKS["an array's zarr.json that is nested deep"] = _text("episodes/spec/zarr.json", DEEP)
ATTACKS["a zarr.json with a number of 100,000 digits"] = _text(
    "zarr.json", '{"zarr_format": ' + "9" * 100_000 + "}"
)
ATTACKS["a zarr.json that is a number"] = _text("zarr.json", "7")
ATTACKS["a zarr.json that is no UTF-8"] = lambda s, o: write(s / "zarr.json", b"\xff\xfe{}")
ATTACKS["arrays of pickled objects"] = coded("episodes/spec", [{"name": "numcodecs.pickle"}])
ATTACKS["a codec that is a module's name"] = coded("episodes/spec", [{"name": "os.system"}])
ATTACKS["codecs that are no list"] = coded("episodes/spec", {"name": "bytes"})


def _nested(depth: int) -> Any:
    codec: Any = BYTES
    for _ in range(depth):
        codec = {
            "name": "sharding_indexed",
            "configuration": {
                "chunk_shape": [1, 1, 1],
                "codecs": [codec],
                "index_codecs": [BYTES],
                "index_location": "end",
            },
        }
    return codec


ATTACKS["a codec nested 100 deep"] = coded("streams/tcp_pose", [_nested(100)])
ATTACKS["a codec nested 20 deep"] = coded("streams/tcp_pose", [_nested(20)])
ATTACKS["a fill value of 10 MB"] = edited(
    "episodes/spec", lambda d: d.update(fill_value="x" * 10_000_000)
)
ATTACKS["an unknown type of values"] = edited("episodes/spec", lambda d: d.update(data_type="O"))
ATTACKS["a structured type of values"] = edited(
    "episodes/seed",
    lambda d: d.update(
        data_type={"name": "structured", "configuration": {"fields": [["a", "int64"]] * 5000}}
    ),
)
ATTACKS["texts of 2 GB each"] = edited(
    "episodes/spec",
    lambda d: d.update(
        data_type={"name": "fixed_length_utf32", "configuration": {"length_bytes": 2**31}}
    ),
)
ATTACKS["consolidated metadata of its own"] = edited(
    "",
    lambda d: d.update(
        consolidated_metadata={
            "kind": "inline",
            "must_understand": False,
            "metadata": {"../../home": {"zarr_format": 3, "node_type": "group", "attributes": {}}},
        }
    ),
)
ATTACKS["keys of chunks with another separator"] = edited(
    "episodes/spec",
    lambda d: d.update(
        chunk_key_encoding={"name": "default", "configuration": {"separator": "/../../home/docs/"}}
    ),
)
ATTACKS["a dimension with a name of 3 MB"] = edited(
    "streams/tcp_pose", lambda d: d.update(dimension_names=["x" * 3_000_000, None, None])
)


ATTACKS |= {
    "a config of images of 30000 x 30000": configured(resolution=[30000, 30000]),
    "a config of images of negative size": configured(resolution=[-5, 7]),
    "a config of images of no size": configured(resolution=[0, 0]),
    "a config with a rate of 0": configured(record_hz=0),
    "a config with a rate of 1e9": configured(record_hz=10**9),
    "a config with a block of 2^40 rows": configured(block_size=2**40),
    "a config with a block of no rows": configured(block_size=0),
    "a config with 3,000 objects": configured(clutter={"count": 3000}),
    "a config with a path as a robot": configured(robot="../../home/docs"),
    "a config with a camera that is a path": configured(
        cameras={"../../../home": {"eye": [1, 0, 1], "target": [0, 0, 0]}}
    ),
    "a config with a model that is a path": configured(
        models={"learned": "../../../../etc/passwd"}
    ),
    "a config with NaN": configured(label={"min_lift": float("nan")}),
    "a config with 20,000 keys": configured(**{f"k{i}": i for i in range(20_000)}),
    "a config that is a list": edited("", lambda d: d["attributes"].update(config=[1, 2])),
    "a config with escape sequences": configured(robot=ESCAPE, policies={ESCAPE: 1.0}),
    "versions with escape sequences": edited(
        "",
        lambda d: d["attributes"].update(
            versions={"grasp_factory": ESCAPE, "numpy": ESCAPE}, platform={"cpu": ESCAPE}
        ),
    ),
    "versions that are numbers": edited("", lambda d: d["attributes"].update(versions=7)),
    "sources that are a number": edited("", lambda d: d["attributes"].update(sources=7)),
    "attributes that are a list": edited("", lambda d: d.update(attributes=[])),
}


for _name, _shape_of in {
    "episodes/spec": [0], "episodes/outcome": [1], "streams/tcp_pose": [3, 1, 7],
    "episodes/checksum": [10, 2], "cameras/front/rgb": [10, 2, 24, 32, 4],
}.items():  # fmt: skip
    ATTACKS[f"{_name} has shape {_shape_of}"] = edited(
        _name, lambda document, shape=_shape_of: document.update(shape=shape)
    )
for _name, _type in {
    "episodes/outcome": "float64", "episodes/object_mass": "string", "episodes/spec": "int64",
    "streams/tcp_pose": "complex128", "cameras/front/rgb": "bool",
}.items():  # fmt: skip
    ATTACKS[f"{_name} is of type {_type}"] = edited(
        _name, lambda document, dtype=_type: document.update(data_type=dtype)
    )


def _shaped(height: int, width: int, kinds: tuple[str, ...]) -> Attack:
    """Change the size of images, without any chunks."""

    def shape(store: Path, outside: Path) -> None:
        for kind in kinds:
            folder = store / "cameras/front" / kind
            for chunk in folder.glob("[0-9]*"):
                chunk.unlink()
            edited(f"cameras/front/{kind}", lambda d: _resized(d, height, width))(store, outside)

    return shape


def _resized(document: dict[str, Any], height: int, width: int) -> None:
    document["shape"][2:4] = [height, width]
    sizes = [max(1, height), max(1, width)]
    document["chunk_grid"]["configuration"]["chunk_shape"][2:4] = sizes
    for codec in document["codecs"]:
        if "chunk_shape" in codec.get("configuration", {}):
            codec["configuration"]["chunk_shape"][2:4] = sizes


ATTACKS |= {
    "images of no size": _shaped(0, 0, ("rgb", "depth", "segmentation")),
    "images of 30000 x 1": _shaped(30000, 1, ("rgb", "depth", "segmentation")),
    "depth of another size": _shaped(10, 10, ("depth",)),
}
for _rows in (0, 1, 3):
    ATTACKS[f"streams of {_rows} steps"] = lambda store, outside, rows=_rows: [
        edited(
            f"streams/{path.name}",
            lambda d, rows=rows: d["shape"].__setitem__(1, rows),
        )(store, outside)
        for path in sorted((store / "streams").iterdir())
        if path.is_dir()
    ]  # type: ignore[return-value]
