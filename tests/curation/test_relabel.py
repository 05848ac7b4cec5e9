"""New labels over stored measurements."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest
from support.helpers import tree
from support.scenes import default_episodes

from grasp_factory.cli.relabel import relabel as command
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.curation.relabel import relabel
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UnknownNameError, UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytestmark = pytest.mark.slow

EPISODES = 20


@pytest.fixture
def store(tmp_path):
    """A store of real episodes at low resolution."""
    from support.scenes import SMALL

    path = tmp_path / "ds.zarr"
    prepare_store(path, SMALL, 7, EPISODES, {"robot": ROBOTS["kuka_iiwa"].facts()})
    writer = ZarrWriter(path)
    for block in range(0, EPISODES, SMALL.block_size):
        rows = default_episodes(EPISODES)[block : block + SMALL.block_size]
        writer.write_block(block // SMALL.block_size, rows)
    return path


@pytest.mark.soak
def test_the_same_thresholds_give_the_same_labels(store):
    done = relabel(store, "again", LabelConfig())
    dataset = Dataset(store)
    assert done.changed == 0
    assert done.episodes == EPISODES
    assert np.array_equal(dataset.label("again"), dataset.column("outcome"))


def test_a_firmer_grip_than_any_leaves_no_success(store):
    done = relabel(store, "firmer", LabelConfig(min_grip_force=100.0))
    assert done.successes == 0
    assert done.successes_before > 0
    labels = Dataset(store).label("firmer")
    assert not (labels == Outcome.SUCCESS).any()


def test_a_lift_that_no_attempt_made_cannot_be_asked_for(store):
    with pytest.raises(UsageError, match=r"min_lift: got 0.3, valid: less than 0.2 m"):
        relabel(store, "higher", LabelConfig(min_lift=0.3))


def test_what_moved_in_the_hand_becomes_unstable(store):
    slips = Dataset(store).column("slip_distance")
    success = Dataset(store).column("success")
    bound = float(np.median(slips[success]))
    relabel(store, "steady", LabelConfig(max_slip_distance=bound))
    labels = Dataset(store).label("steady")
    assert ((labels == Outcome.SUCCESS) == (success & (slips <= bound))).all()
    assert ((labels == Outcome.UNSTABLE) == (success & (slips > bound))).all()


def test_nothing_else_in_the_store_changes(store):
    before = tree(store)
    relabel(store, "extra", LabelConfig(min_shake=0.5))
    after = {name: data for name, data in tree(store).items() if "labels" not in str(name)}
    assert after == before


def test_the_thresholds_stand_beside_the_label(store):
    import zarr

    relabel(store, "soft", LabelConfig(min_shake=0.0, min_lift=0.05))
    group = zarr.open_group(store, mode="r")["labels/soft"]
    assert group.attrs["thresholds"]["min_shake"] == 0.0
    assert group["outcome"].attrs["thresholds"]["min_lift"] == 0.05
    assert group["success"][:].dtype == bool


def test_a_name_is_taken_once(store):
    relabel(store, "mine", LabelConfig())
    with pytest.raises(UsageError, match="has a label 'mine' already"):
        relabel(store, "mine", LabelConfig(min_lift=0.15))
    assert Dataset(store).labels == ["mine"]


@pytest.mark.parametrize("name", ["", "a b", "../x", "a/b", ".x", "x" * 300])
def test_a_name_that_is_no_word_is_refused(store, name):
    with pytest.raises(UsageError, match="valid: letters, digits and _"):
        relabel(store, name, LabelConfig())


def test_a_shake_that_was_never_given_cannot_be_asked_for(store):
    with pytest.raises(UsageError, match=r"min_shake: got 2.0, valid: 0 to 1.0"):
        relabel(store, "hard", LabelConfig(min_shake=2.0))


def test_an_unknown_label_is_named(store):
    with pytest.raises(UnknownNameError, match="unknown label 'x'"):
        Dataset(store).label("x")


def test_the_command_does_it_and_says_so(store):
    command = [sys.executable, "-m", "grasp_factory", "relabel", str(store), "--name", "cli",
               "--min-grip-force", "100"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"labels/cli: 0 successes of {EPISODES} episodes")
    command = [*command[:6], "other", "--min-shake", "0", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["name"] == "other"
    stored = json.loads((store / "labels" / "other" / "zarr.json").read_bytes())["attributes"]
    assert stored["thresholds"]["min_shake"] == 0.0
    command = [*command[:6], "third", "--min-lift", "-1"]
    bad = subprocess.run(command, capture_output=True, text=True, check=False)
    assert bad.returncode == 2
    assert bad.stderr == "Error: min_lift: got -1.0, valid: 0.01 to 0.5 m\n"


def test_each_threshold_of_a_label_is_an_option_of_the_command() -> None:
    options = {name for option in command.params for name in option.opts}
    assert {f"--{field.name.replace('_', '-')}" for field in fields(LabelConfig)} < options
