"""Places: only regular files and directories below a root are opened, whatever their names are."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from grasp_factory.core.directories import MOST_OPEN, Root
from grasp_factory.core.limits import DEPTH, DOCUMENT, Limit
from grasp_factory.core.place import Place, place_at, place_of
from grasp_factory.core.place_tree import entries, files_below
from grasp_factory.core.regular_file import open_regular, read_part
from grasp_factory.errors import IrregularFileError, LimitError


@pytest.fixture
def inside(tmp_path: Path) -> Path:
    """Return a directory with a link to a directory beside it, to a file there, and a pipe."""
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "secret").write_text("secret")
    folder = tmp_path / "inside"
    (folder / "a").mkdir(parents=True)
    (folder / "a" / "file").write_text("own")
    (folder / "way").symlink_to(outside)
    (folder / "link").symlink_to(outside / "secret")
    (folder / "round").symlink_to("round")
    (folder / "up").symlink_to("..")
    os.mkfifo(folder / "pipe")
    return folder


@pytest.mark.parametrize("name", ["link", "way/secret", "round", "up/outside/secret", "pipe"])
def test_nothing_is_read_through_a_link_or_from_a_pipe(inside: Path, name: str) -> None:
    with pytest.raises(IrregularFileError, match=f"{inside}/{Path(name).parts[0]}"):
        (place_of(inside) / name).read_bytes(DOCUMENT)


@pytest.mark.parametrize("name", ["way/new", "up/outside/new"])
def test_nothing_is_written_through_a_link(inside: Path, name: str) -> None:
    place = place_of(inside) / name
    for change in (lambda: place.write(b"x"), place.mkdir, place.unlink, place.rmtree):
        with pytest.raises(IrregularFileError):
            change()
    assert [p.name for p in inside.with_name("outside").iterdir()] == ["secret"]


def test_a_link_in_place_of_a_file_is_replaced_and_not_followed(inside: Path) -> None:
    (inside / "link.partial").symlink_to(inside.with_name("outside") / "secret")
    (place_of(inside) / "link").write(b"new", durable=True)
    assert (inside / "link").read_bytes() == b"new"
    assert not (inside / "link").is_symlink()
    assert (inside.with_name("outside") / "secret").read_text() == "secret"


@pytest.mark.parametrize("inner", ["..", "../outside", "folder/../../outside", "folder/.."])
def test_no_place_leads_out_of_its_root(inside: Path, inner: str) -> None:
    with pytest.raises(IrregularFileError, match=r"no part may be '\.\.'"):
        place_of(inside) / inner
    assert (place_of(inside) / "a..b").inner == "a..b"


def test_a_removed_link_leaves_what_it_leads_to(inside: Path) -> None:
    (place_of(inside) / "link").unlink()
    (inside / "a" / "way").symlink_to(inside.with_name("outside"))
    (place_of(inside) / "a").rmtree()
    assert (inside.with_name("outside") / "secret").read_text() == "secret"


def test_the_root_itself_may_be_reached_through_a_link(inside: Path) -> None:
    (inside.parent / "short").symlink_to(inside)
    assert (place_of(inside.parent / "short") / "a" / "file").read_bytes(DOCUMENT) == b"own"


def test_a_larger_file_is_not_read(inside: Path) -> None:
    with pytest.raises(LimitError, match="file: a word of 3, valid: up to 2"):
        (place_of(inside) / "a/file").read_bytes(Limit("few", 2, "a word", is_count=True))


def test_a_place_knows_its_name_its_parent_and_what_is_there(inside: Path) -> None:
    place = place_of(inside) / "a" / "file"
    assert (place.name, place.parent.name, place.below(place.parent)) == ("file", "a", "file")
    assert (place.path, str(place)) == (inside / "a/file", f"{inside}/a/file")
    assert place.is_file() and place.parent.is_dir() and not place.is_dir()
    assert not (place / "below").exists() and not (place.parent / "other").exists()
    assert [p.name for p in place.parent.glob("f*")] == ["file"]
    assert place.parent.names() == ["file"]
    assert place_at(inside / "new").parent.is_dir()


def test_what_is_in_a_directory_has_three_kinds(inside: Path) -> None:
    found = entries(place_of(inside))
    assert (found.folders, found.files) == (["a"], [])
    assert found.others == ["link", "pipe", "round", "up", "way"]
    with pytest.raises(IrregularFileError, match="link"):
        list(files_below(place_of(inside)))


def test_deep_directories_are_refused(tmp_path: Path) -> None:
    (tmp_path / "/".join("d" * (DEPTH.usual + 2))).mkdir(parents=True)
    with pytest.raises(LimitError, match="depth"):
        list(files_below(place_of(tmp_path)))


def test_a_directory_that_was_made_again_is_found(inside: Path) -> None:
    place = place_of(inside) / "a"
    assert (place / "file").read_bytes(DOCUMENT) == b"own"
    (inside / "a").rename(inside / "b")
    (inside / "a").mkdir()
    (inside / "a" / "other").write_text("new")
    assert (place / "other").read_bytes(DOCUMENT) == b"new"
    with pytest.raises(FileNotFoundError):
        (place / "file").read_bytes(DOCUMENT)


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_few_directories_stay_open_and_none_of_a_root_that_is_not_used(tmp_path: Path) -> None:
    for i in range(2 * MOST_OPEN):
        (tmp_path / str(i)).mkdir()
        (tmp_path / str(i) / "file").write_text(str(i))
    before = descriptors()
    root = Root(tmp_path)
    for i in range(2 * MOST_OPEN):
        assert Place(root, f"{i}/file").read_bytes(DOCUMENT) == str(i).encode()
    assert descriptors() <= before + MOST_OPEN + 1
    del root
    Place(Root(tmp_path), "0/file").read_bytes(DOCUMENT)
    Place(Root(tmp_path), "1/file").read_bytes(DOCUMENT)
    assert descriptors() <= before + 4


def test_threads_read_through_the_same_directories(tmp_path: Path) -> None:
    count = 2 * MOST_OPEN
    for i in range(count):
        (tmp_path / str(i)).mkdir()
        (tmp_path / str(i) / "file").write_text(str(i))
    root, wrong = Root(tmp_path), []

    def read(start: int) -> None:
        for step in range(3 * count):
            i = (start + step * 7) % count
            if Place(root, f"{i}/file").read_bytes(DOCUMENT) != str(i).encode():
                wrong.append(i)

    threads = [threading.Thread(target=read, args=(40 * k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_parts_of_a_file_that_arrive_in_pieces_are_put_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_bytes(bytes(range(100)))
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda file, size, at: pread(file, min(size, 7), at))
    descriptor = (place_of(tmp_path) / "file").open()
    try:
        assert read_part(descriptor, 50, 20) == bytes(range(20, 70))
        assert read_part(descriptor, 50, 90) == bytes(range(90, 100))
    finally:
        os.close(descriptor)


def test_a_file_with_a_second_name_is_read_but_not_written(tmp_path: Path) -> None:
    (tmp_path / "one").write_text("x")
    (tmp_path / "two").hardlink_to(tmp_path / "one")
    os.close(open_regular(tmp_path / "two", os.O_RDONLY))
    with pytest.raises(IrregularFileError, match="second name"):
        open_regular(tmp_path / "two", os.O_WRONLY)


def test_nothing_has_a_name_that_is_too_long_for_the_disk(tmp_path: Path) -> None:
    place = place_of(tmp_path) / ("x" * 300) / "zarr.json"
    assert not place.exists()
    assert not place.parent.is_dir()
    assert not place.is_file()
