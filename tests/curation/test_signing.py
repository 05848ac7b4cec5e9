"""Signatures: what they cover, and by whom they are."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from support.helpers import tree
from support.places import TINY

from grasp_factory.curation.signing import (
    FOLDER,
    NAMESPACE,
    SIGNATURE,
    SUMS,
    check_signature,
    sign,
)
from grasp_factory.errors import MissingLibraryError, StoreError, StoreMismatchError, UsageError

pytestmark = pytest.mark.skipif(not shutil.which("ssh-keygen"), reason="needs OpenSSH")


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return Path(shutil.copytree(TINY, tmp_path / "grasps.zarr"))


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    for name in ("mine", "other"):
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
        subprocess.run(command, check=True)
    return folder


@pytest.fixture
def signed(store: Path, keys: Path) -> Path:
    sign(store, keys / "mine")
    return store


def problems(store: Path, keys: Path, name: str = "mine") -> tuple[str, ...]:
    return check_signature(store, keys / f"{name}.pub").problems


def test_a_signed_store_is_that_of_the_keys_owner(signed: Path, keys: Path) -> None:
    found = check_signature(signed, keys / "mine.pub")
    files = [file for file in signed.rglob("*") if file.is_file()]
    assert (found.files, found.problems) == (len(files) - 2, ())


def test_the_list_is_one_that_sha256sum_reads(signed: Path) -> None:
    lines = (signed / FOLDER / SUMS).read_text().splitlines()
    for line in lines:
        digest, name = line.split("  ", 1)
        assert digest == hashlib.sha256((signed / name).read_bytes()).hexdigest()
    assert len(lines) > 100


def test_a_store_signed_by_somebody_else_is_a_problem(signed: Path, keys: Path) -> None:
    (problem,) = problems(signed, keys, "other")
    assert "the signature is not by the key" in problem


def test_a_store_that_is_not_signed_is_a_problem(store: Path, keys: Path) -> None:
    assert problems(store, keys) == ("the store is not signed",)


def test_every_change_of_a_file_is_a_problem(signed: Path, keys: Path) -> None:
    (signed / "new").write_text("x")
    (signed / "episodes/seed/0").unlink()
    with (signed / "episodes/spec/0").open("ab") as file:
        file.write(b"x")
    assert problems(signed, keys) == (
        "'episodes/seed/0' is missing",
        "'episodes/spec/0' is changed since it was signed",
        "'new' is not signed",
    )


def test_a_list_that_was_written_again_is_a_problem(signed: Path, keys: Path) -> None:
    sums = signed / FOLDER / SUMS
    sums.write_text(sums.read_text().replace("  episodes/seed/0", "  episodes/seed/1"))
    assert "is not by the key" in problems(signed, keys)[0]


def test_a_signature_of_something_else_is_a_problem(signed: Path, keys: Path) -> None:
    sums = signed / FOLDER / SUMS
    command = ["ssh-keygen", "-q", "-Y", "sign", "-f", str(keys / "mine"), "-n", "git", str(sums)]
    sums.with_name(f"{SUMS}.sig").unlink()
    subprocess.run(command, check=True, capture_output=True)
    assert "is not by the key" in problems(signed, keys)[0]


def test_a_store_is_signed_again_after_a_change(signed: Path, keys: Path) -> None:
    (signed / "episodes/seed/0").write_bytes(b"other")
    sign(signed, keys / "other")
    assert problems(signed, keys, "other") == ()
    assert problems(signed, keys) != ()


def test_a_link_in_the_store_is_not_followed(signed: Path, keys: Path, run: Any) -> None:
    (signed / "new").symlink_to(keys / "mine")
    code, _, said = run("verify", signed, "--signed-by", keys / "mine.pub")
    assert code == 1
    assert "new is a link" in said


def test_the_command_reports_it_and_exits_with_1_for_a_problem(
    signed: Path, keys: Path, run: Any
) -> None:
    code, said, _ = run("verify", signed, "--signed-by", keys / "mine.pub")
    assert code == 0
    assert "as the owner of" in said
    code, said, _ = run("verify", signed, "--signed-by", keys / "other.pub")
    assert code == 1
    assert "get the store from its maker again" in said


def test_a_signature_is_no_foreign_file_of_the_store(signed: Path, run: Any) -> None:
    code, said, _ = run("verify", signed)
    assert code == 0
    assert "nothing reads it" not in said


def test_keys_that_cannot_be_used_are_errors(store: Path, keys: Path, tmp_path: Path) -> None:
    before = tree(store)
    with pytest.raises(UsageError, match="cannot sign"):
        sign(store, tmp_path / "nothing")
    assert tree(store) == before
    with pytest.raises(UsageError, match="is no public SSH key"):
        check_signature(store, keys / "mine")
    with pytest.raises(UsageError, match="cannot be read"):
        check_signature(store, tmp_path / "nothing")
    (tmp_path / "many").write_text('ssh-ed25519 AAAA\n* namespaces="x" ssh-ed25519 AAAA')
    assert problems(store, keys) == ("the store is not signed",)
    with pytest.raises(StoreMismatchError):
        sign(tmp_path / "no.zarr", keys / "mine")


def test_it_is_said_what_to_install(
    store: Path, keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(os.environ, "PATH", "")
    with pytest.raises(MissingLibraryError, match="install OpenSSH"):
        sign(store, keys / "mine")


def enlarge(file: Path) -> None:
    """Make a file larger than any disk has room for."""
    with file.open("ab") as opened:
        opened.truncate(2**40)


def test_a_large_file_that_is_not_on_the_disk_is_refused(signed: Path, keys: Path) -> None:
    enlarge(signed / "episodes/seed/0")
    for act in (lambda: problems(signed, keys), lambda: sign(signed, keys / "mine")):
        with pytest.raises(StoreError, match=r"seed/0 has 1\.\d TB, of which .* are on the disk"):
            act()


def test_files_that_were_not_signed_are_not_read(signed: Path, keys: Path) -> None:
    enlarge(signed / "new")
    counts: list[int] = []
    found = check_signature(signed, keys / "mine.pub", on_start=counts.append)
    assert found.problems == ("'new' is not signed",)
    assert counts == [found.files]


@pytest.mark.parametrize("name", ["pipe", "pipe.pub"])
def test_a_pipe_without_a_writer_is_no_key_and_nothing_waits(
    store: Path, tmp_path: Path, name: str
) -> None:
    os.mkfifo(tmp_path / name)
    before = tree(store)
    check = check_signature if name.endswith(".pub") else sign
    with pytest.raises(UsageError, match=name):
        check(store, tmp_path / name)
    assert tree(store) == before


def test_a_public_key_may_come_through_a_pipe_that_a_shell_has_opened(
    signed: Path, keys: Path
) -> None:
    reading, writing = os.pipe()
    os.write(writing, (keys / "mine.pub").read_bytes())
    os.close(writing)
    try:
        assert check_signature(signed, Path(f"/dev/fd/{reading}")).problems == ()
    finally:
        os.close(reading)


@pytest.mark.parametrize("line", ["\n", f"{'0' * 64}  {'x' * 5000}\n", f"{'0' * 64} x"])
def test_a_list_of_other_lines_is_refused_whoever_signed_it(
    signed: Path, keys: Path, line: str
) -> None:
    _signed_again(signed, keys, line * 3)
    assert problems(signed, keys) == ("its list of files is not in the form of sha256sum",)


def test_a_list_of_many_names_is_not_kept(signed: Path, keys: Path) -> None:
    _signed_again(signed, keys, f"{'0' * 64}  x\n" * 3000)
    files = [file for file in signed.rglob("*") if file.is_file()]
    assert len(problems(signed, keys)) == 1000 + len(files) - 2


def _signed_again(store: Path, keys: Path, text: str) -> None:
    """Let the owner of a key sign a text instead of the list of files."""
    (store / FOLDER / SUMS).write_text(text)
    (store / FOLDER / SIGNATURE).unlink()
    what = ["-n", NAMESPACE, str(store / FOLDER / SUMS)]
    command = ["ssh-keygen", "-Y", "sign", "-q", "-f", str(keys / "mine"), *what]
    subprocess.run(command, check=True)
