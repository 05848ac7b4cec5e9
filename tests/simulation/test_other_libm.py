"""The commands under a real other C library's sine, each in a process of its own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.damage import cut
from support.platform_processes import WITHOUT_FMA, command, needs_fma

from grasp_factory.core.platforms import PARTS
from grasp_factory.dataset.dataset import Dataset

pytestmark = [needs_fma, pytest.mark.slow]
SMALL = ("--resolution", "32x24", "--workers", 1, "--set", "block_size=1", "--quiet")
LIBM = f"libm ({PARTS['libm']})"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Return a store of two rows that was made here."""
    assert command("generate", "--n", 2, "--out", tmp_path / "ds.zarr", *SMALL).returncode == 0
    return tmp_path / "ds.zarr"


def test_verify_calls_no_difference_damage(store: Path) -> None:
    done = command("verify", store, "--deep", 2, "--workers", 1, "--json", **WITHOUT_FMA)
    told = json.loads(done.stdout)
    assert (done.returncode, told["problems"]) == (0, [])
    (note,) = told["notes"]
    assert "2 of 2 episodes simulated again were made on another platform" in note
    assert LIBM in note


@pytest.mark.soak
def test_repair_simulates_only_what_is_accepted(store: Path) -> None:
    cut("streams/tcp_pose/1.0.0")(store)
    refused = command("repair", store, "--workers", 1, **WITHOUT_FMA)
    assert refused.returncode == 1
    assert LIBM in refused.stdout
    accepted = ("repair", store, "--workers", 1, "--accept-other-platform")
    assert command(*accepted, **WITHOUT_FMA).returncode == 0
    first, second = Dataset(store).column("fingerprint").tolist()
    assert first != second


@pytest.mark.soak
def test_merge_takes_parts_of_one_seed_only_if_that_is_accepted(store: Path) -> None:
    there, out = store.with_name("there.zarr"), store.with_name("out.zarr")
    part = ("generate", "--n", 4, "--shard", "1/2", "--out", there, *SMALL)
    assert command(*part, **WITHOUT_FMA).returncode == 0
    here = store.with_name("here.zarr")
    assert command("generate", "--n", 4, "--shard", "0/2", "--out", here, *SMALL).returncode == 0
    refused = command("merge", out, here, there)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert LIBM in refused.stderr
    accepted = command("merge", out, here, there, "--accept-other-platform")
    assert accepted.returncode == 0
    assert accepted.stdout.count("warning:") == 1
    assert len(set(Dataset(out).column("fingerprint").tolist())) == 2
