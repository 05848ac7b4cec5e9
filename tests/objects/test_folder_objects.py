from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.helpers import assert_same_tree
from support.tiny_archive import COLLISION, GEOMETRY, ITEM, VISUAL

from grasp_factory.core.cache import VARIABLE, cache_dir, digest, write
from grasp_factory.errors import ConfigError, StoreError, UsageError
from grasp_factory.objects.base import Compound
from grasp_factory.objects.folder import ConvexPart, Manifest, load_folder
from grasp_factory.objects.folder_archive import pack_folder, unpack_folder
from grasp_factory.objects.folder_cache import manifest_path, mesh_path

MANIFEST = Manifest(objects={"a": ITEM, "Größe/b": dataclasses.replace(ITEM, family="Größe")})
TEXT = MANIFEST.encoded()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "cache"
    monkeypatch.setenv(VARIABLE, str(path))
    for data in (COLLISION, VISUAL):
        write(mesh_path(path, digest(data)), data)
    write(manifest_path(path, digest(TEXT)), TEXT)
    return path


@pytest.fixture
def move(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Path]:
    """Return a function that makes the cache another one, which is empty."""

    def to_another() -> Path:
        monkeypatch.setenv(VARIABLE, str(tmp_path / "elsewhere"))
        return tmp_path / "elsewhere"

    return to_another


class TestLoading:
    def test_a_set_is_loaded_from_the_cache(self, cache: Path) -> None:
        objects = load_folder("mine", digest(TEXT))
        assert list(objects.models) == ["mine/Größe/b", "mine/a"]
        assert (objects.name, objects.size, objects.families) == ("mine", 2, ("Größe", "mesh"))
        model = objects.model("mine/a")
        assert isinstance(model.body, Compound)
        assert model.body.parts[0].shape == str(mesh_path(cache, digest(COLLISION)))
        assert model.body.visual[0].shape == str(mesh_path(cache, digest(VISUAL)))
        assert model.split_by == digest(b"a source")

    def test_a_set_is_read_once_per_process(self) -> None:
        assert load_folder("mine", digest(TEXT)) is load_folder("mine", digest(TEXT))

    @pytest.mark.parametrize("sha256", ["0" * 64, "../../etc/passwd", ""])
    def test_a_set_that_is_not_there_says_what_to_do(self, sha256: str) -> None:
        with pytest.raises(ConfigError, match=r"no imported objects .* run `grasp-factory objects"):
            load_folder("mine", sha256)

    @pytest.mark.parametrize("data", [COLLISION, VISUAL])
    def test_a_mesh_that_was_tampered_with_is_found_out(self, cache: Path, data: bytes) -> None:
        mesh_path(cache, digest(data)).write_bytes(data.replace(b"0.05", b"0.06"))
        with pytest.raises(ConfigError, match="lost or damaged a mesh of object set 'mine'"):
            load_folder("mine", digest(TEXT))

    def test_a_manifest_that_was_tampered_with_is_found_out(self, cache: Path) -> None:
        manifest_path(cache, digest(TEXT)).write_bytes(TEXT.replace(b"0.1", b"0.2"))
        with pytest.raises(ConfigError, match="no imported objects"):
            load_folder("mine", digest(TEXT))


class TestCache:
    def test_its_place_can_be_chosen(self, monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
        assert cache_dir() == cache
        monkeypatch.delenv(VARIABLE)
        monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
        assert cache_dir() == Path("/somewhere/grasp-factory")
        monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the standard
        assert cache_dir() == Path("~/.cache/grasp-factory").expanduser()

    def test_a_user_without_a_home_is_told_what_to_set(
        self, monkeypatch: pytest.MonkeyPatch, cache: Path
    ) -> None:
        def refuse(_: Path) -> Path:
            raise RuntimeError("Could not determine home directory.")

        monkeypatch.setattr(Path, "expanduser", refuse)
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
        assert cache_dir() == cache
        monkeypatch.delenv(VARIABLE)
        with pytest.raises(UsageError, match=f"no place for the cache: .*set {VARIABLE}"):
            cache_dir()

    @pytest.mark.parametrize("path", ["/tmp/é", "/tmp/" + "a" * 900])
    def test_a_place_that_the_engine_cannot_open_is_refused(
        self, monkeypatch: pytest.MonkeyPatch, path: str
    ) -> None:
        monkeypatch.setenv(VARIABLE, path)
        with pytest.raises(UsageError, match="ASCII paths"):
            cache_dir()


class TestRecords:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"lower": (0.0, 0.0, 0.1)}, "upper"),
            ({"com": (9.0, 0.0, 0.0)}, "com"),
            ({"axes_xyzw": (0.0, 0.0, 0.0, 2.0)}, "axes_xyzw"),
            ({"gyration_squared": (0.0, 1.0, 1.0)}, "gyration_squared"),
            ({"collision": "../x"}, "collision"),
            ({"visual": ""}, "collision"),
            ({"collision": "", "visual": ""}, "collision"),
        ],
    )
    def test_a_geometry_that_cannot_be_is_refused(
        self, change: dict[str, Any], message: str
    ) -> None:
        with pytest.raises(ConfigError, match=message):
            dataclasses.replace(GEOMETRY, **change)

    def test_a_solid_is_one_that_the_engine_knows(self) -> None:
        with pytest.raises(ConfigError, match="shape: got '/etc/passwd', valid: box, sphere"):
            ConvexPart(
                shape="/etc/passwd",
                size=(0.1, 0.1, 0.1),
                position=(0.0, 0.0, 0.0),
                quat_xyzw=(0.0, 0.0, 0.0, 1.0),
            )

    @pytest.mark.parametrize("name", ["", "a\nb", "x" * 2000])
    def test_a_name_can_be_printed(self, name: str) -> None:
        with pytest.raises(ConfigError, match="printable"):
            Manifest(objects={name: ITEM})

    def test_a_manifest_comes_back_as_it_was(self) -> None:
        assert Manifest.decoded(TEXT) == MANIFEST

    @pytest.mark.parametrize("data", [b"", b"[", b"[]", b"[" * 100_000, b"\xff", b'{"a": 1}'])
    def test_what_is_no_manifest_is_refused(self, data: bytes) -> None:
        with pytest.raises(ConfigError):
            Manifest.decoded(data)


def archive(members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return buffer.getvalue()


def members_with(mesh: bytes) -> dict[str, bytes]:
    """Return a consistent archive's members, with another collision mesh."""
    geometry = dataclasses.replace(GEOMETRY, collision=digest(mesh))
    manifest = Manifest(objects={"a": dataclasses.replace(ITEM, geometry=geometry)})
    return {
        "manifest.json": manifest.encoded(),
        f"{digest(mesh)}.obj": mesh,
        f"{digest(VISUAL)}.obj": VISUAL,
    }


GOOD = members_with(COLLISION)


class TestArchives:
    def test_a_set_travels_in_an_archive(self, cache: Path, move: Callable[[], Path]) -> None:
        packed = pack_folder(digest(TEXT))
        there = move()
        assert unpack_folder(packed) == digest(TEXT)
        assert_same_tree(cache, there)
        assert load_folder("mine", digest(TEXT)).size == 2
        assert pack_folder(digest(TEXT)) == packed

    def test_packing_what_is_damaged_is_an_error(self, cache: Path) -> None:
        mesh_path(cache, digest(VISUAL)).unlink()
        with pytest.raises(ConfigError, match="lost the mesh"):
            pack_folder(digest(TEXT))

    def test_an_archive_of_any_maker_is_taken(self) -> None:
        assert unpack_folder(archive(GOOD)) == digest(GOOD["manifest.json"])

    @pytest.mark.parametrize(
        ("data", "message"),
        [
            (b"", "no zip file"),
            (b"PK\x05\x06" + b"\0" * 17, "no zip file"),
            (archive(GOOD)[:-30], "no zip file"),
            (archive(GOOD).replace(b"0.05 0 0", b"0.06 0 0"), "no zip file: Bad CRC"),
            (archive(GOOD, zipfile.ZIP_DEFLATED), "compressed"),
            (archive({**GOOD, "../../evil": b"x"}), "not those that its manifest names"),
            (archive({**GOOD, "/etc/cron.d/evil": b"x"}), "not those that its manifest names"),
            (archive({"manifest.json": TEXT}), "not those that its manifest names"),
            (archive({}), "no manifest"),
            (archive({"manifest.json": b"[" * 100_000}), "no manifest"),
            (archive({**GOOD, "manifest.json": GOOD["manifest.json"] + b" "}), "not in the form"),
            (archive({**GOOD, f"{digest(VISUAL)}.obj": COLLISION}), "another content"),
            (archive(members_with(b"mtllib /etc/passwd\n" + COLLISION)), "lines that imports do"),
            (archive(members_with(COLLISION[:-1])), "lines that imports do"),
            (archive(members_with(COLLISION + b"f 1 2 5\n")), "a face without vertices"),
            (archive(members_with(COLLISION + b"f 0 1 2\n")), "a face without vertices"),
            (archive(members_with(COLLISION + b"v nan 0 0\n")), "lines that imports do"),
            (archive(members_with(b"")), "has no faces"),
            (archive(members_with(COLLISION + b"v 1e999 0 0\n")), "numbers that no object has"),
            (archive(members_with(COLLISION + b"v 0 -5 0\n")), "numbers that no object has"),
        ],
        ids=range(20),
    )
    def test_an_archive_with_anything_else_changes_nothing(
        self, data: bytes, message: str, move: Callable[[], Path]
    ) -> None:
        there = move()
        with pytest.raises(StoreError, match=f"an archive of objects cannot be used: .*{message}"):
            unpack_folder(data)
        assert not there.exists()

    def test_members_that_share_their_bytes_are_no_bomb(self) -> None:
        data = archive({"a": b"x" * 1000, "b": b"y"})
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            start = file.start_dir
        central = data[start : data.index(b"PK\x01\x02", start + 4)]
        copies = b"".join(central.replace(b"a", bytes([65 + i])) for i in range(20))
        end = b"PK\x05\x06" + b"\0" * 4 + b"\x14\0\x14\0"
        end += len(copies).to_bytes(4, "little") + start.to_bytes(4, "little") + b"\0\0"
        with pytest.raises(StoreError, match=r"too long or there twice|no zip file"):
            unpack_folder(data[:start] + copies + end)

    def test_numbers_that_no_object_has_are_refused(self) -> None:
        plain = json.loads(TEXT)
        plain["objects"]["a"]["mass"] = 1e9
        text = json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()
        with pytest.raises(StoreError, match=r"mass: got 1000000000.0"):
            unpack_folder(archive({**GOOD, "manifest.json": text}))
