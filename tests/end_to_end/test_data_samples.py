"""The dataset that ships with the repository: today's reader reads it, today's code makes it."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys

import pytest
import zarr
from support.helpers import tree
from support.places import REPOSITORY

from grasp_factory.core.enums import Outcome
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.writers.zarr.metadata_checksum import SEAL

SAMPLES = REPOSITORY / "data_samples"


@pytest.fixture(scope="module")
def dataset():
    return Dataset(SAMPLES / "tiny.zarr")


def test_every_episode_is_there_and_whole(dataset):
    assert len(dataset) == 4
    assert list(dataset.committed) == [0, 1, 2, 3]
    assert all(dataset.verify(i) for i in range(4))


def test_it_shows_both_classes(dataset):
    outcomes = [episode.outcome for episode in dataset]
    assert Outcome.SUCCESS in outcomes
    assert set(outcomes) - {Outcome.SUCCESS}


def test_plain_zarr_reads_it():
    root = zarr.open_group(SAMPLES / "tiny.zarr", mode="r")
    assert root["cameras/front/rgb"].shape == (4, 2, 72, 96, 3)
    assert root["streams/joint_torques"].attrs["units"] == "N m"


def test_its_recipes_are_those_that_its_config_and_seed_give(dataset):
    for i in range(4):
        assert sample_spec(dataset.config, i) == dataset.spec(i)


@pytest.mark.slow
def test_the_stated_command_makes_it_again(dataset, tmp_path):
    text = (SAMPLES / "README.md").read_text()
    program, *arguments = shlex.split(re.findall(r"```\n(.*?)\n```", text, re.DOTALL)[0])
    assert program == "grasp-factory"
    out = tmp_path / "tiny.zarr"
    arguments[arguments.index("--out") + 1] = str(out)
    subprocess.run([sys.executable, "-m", "grasp_factory", *arguments, "--quiet"], check=True)
    here, there = Dataset(out).attributes, dataset.attributes
    differing = {key for key in here if here[key] != there.get(key)}
    assert differing <= {"platform", "versions", "created_by", FINGERPRINT, SEAL}
    if not differing & {"versions", FINGERPRINT}:  # whatever the machine is called
        made, stored = tree(out), tree(SAMPLES / "tiny.zarr")
        assert made.keys() == stored.keys()
        assert {name for name in made if made[name] != stored[name]} <= {"zarr.json"}
    else:
        assert [len(Dataset(out)), len(dataset)] == [4, 4]
