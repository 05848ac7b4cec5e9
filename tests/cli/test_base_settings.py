"""What `generate` uses without an option: the config of a store, and `grasp-factory.yaml`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from support.fake_episodes import JOINTS, small_config
from support.plugin_files import POLICY, forget_plugins

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_request import CONFIG_KEYS
from grasp_factory.writers.zarr.store import prepare_store

Run = Callable[..., tuple[int, str, str]]
FILE = "grasp-factory.yaml"
CONFIG = small_config(seed=7, motion={"grip_force": 33.0})


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Work in an empty folder, and forget plugins afterwards."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    forget_plugins()


@pytest.fixture
def store(folder: Path) -> None:
    """Make ``s.zarr``, a store of ``CONFIG`` with 12 rows, in the folder."""
    prepare_store(folder / "s.zarr", CONFIG, JOINTS, 12, {})


def printed(run: Run, *options: object) -> tuple[FactoryConfig, dict[str, object], str]:
    """Return the config and the settings of a run with these options, and what stderr says."""
    code, out, err = run("generate", "--print-config", *options)
    assert code == 0, err
    plain = yaml.safe_load(out)
    config = {key: value for key, value in plain.items() if key in CONFIG_KEYS}
    return FactoryConfig.from_plain(config), plain, err


def refused(run: Run, *options: object) -> str:
    """Return the only line that the command says."""
    code, out, err = run("generate", *options)
    assert code == 2
    assert out == ""
    assert err.startswith("Error: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.usefixtures("store")
@pytest.mark.parametrize("options", [(), ("--shard", "1/4"), ("--seed", 7)])
def test_a_store_gives_its_config_and_its_number_of_episodes(run: Run, options: object) -> None:
    config, settings, said = printed(run, "--out", "s.zarr", *options)
    assert config == CONFIG
    assert settings["n"] == 12
    assert said == "Using the config of s.zarr.\n"


@pytest.mark.usefixtures("store")
def test_a_file_that_an_option_names_may_say_the_same_as_the_store(run: Run) -> None:
    Path("c.yaml").write_text("seed: 7\nn: 90", encoding="utf-8")
    config, settings, _ = printed(run, "--out", "s.zarr", "--config", "c.yaml")
    assert (config, settings["n"]) == (CONFIG, 90)


@pytest.mark.usefixtures("store")
@pytest.mark.parametrize(
    "options",
    [("--seed", 5), ("--set", "seed=5"), ("--config", "c.yaml"), ("--seed", 5, "--shard", "1/2")],
)
def test_an_option_against_the_store_is_one_line_that_names_the_difference(
    run: Run, options: object
) -> None:
    Path("c.yaml").write_text("seed: 5", encoding="utf-8")
    assert "it has seed: 7, and this run has 5" in refused(run, "--out", "s.zarr", *options)


@pytest.mark.slow
def test_a_store_grows_by_its_name_alone_to_the_bytes_of_one_run(run: Run) -> None:
    config = FactoryConfig(resolution=(32, 24), block_size=1, seed=3)
    for out, n in (("a.zarr", 1), ("whole.zarr", 2)):
        generate(config, n, out, workers=1)
    code, _, err = run("generate", "--out", "a.zarr", "--n", 2, "--workers", 1)
    assert code == 0, err
    assert "Using the config of a.zarr.\n" in err
    assert list(Dataset("a.zarr")["checksum"]) == list(Dataset("whole.zarr")["checksum"])


def test_the_file_of_the_folder_is_used_and_named(run: Run) -> None:
    Path(FILE).write_text("seed: 4\nn: 70\nworkers: 500", encoding="utf-8")
    config, settings, said = printed(run)
    assert (config.seed, settings["n"]) == (4, 70)
    assert said == f"Using {FILE} of this folder.\n"
    assert settings["workers"] == max(2, len(os.sched_getaffinity(0)))
    assert printed(run, "--seed", 6)[0].seed == 6
    assert run("generate", "--print-config", "--quiet")[2] == ""


def test_a_file_that_an_option_names_stands_in_place_of_the_folders_file(run: Run) -> None:
    Path(FILE).write_text("seed: 4", encoding="utf-8")
    Path("c.yaml").write_text("n: 3", encoding="utf-8")
    config, _, said = printed(run, "--config", "c.yaml")
    assert (config.seed, said) == (0, "")


@pytest.mark.usefixtures("store")
def test_a_store_stands_above_the_folders_file_and_the_difference_is_said(run: Run) -> None:
    Path(FILE).write_text("out: s.zarr\nseed: 4\nn: 90", encoding="utf-8")
    config, settings, said = printed(run)
    assert (config, settings["n"]) == (CONFIG, 90)
    assert said == f"Using the config of s.zarr, and not that of {FILE} (seed: 4 against 7).\n"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("out: ../x.zarr", "valid: a path in this folder"),
        ("out: /x.zarr", "valid: a path in this folder"),
        ("out: link/x.zarr", "valid: a path in this folder"),
        ("accept_other_platform: true", "this is an option"),
        ("policies: {evil.py:plan: 1}", "is code, which is run only if you name it"),
        ("policy_parameters: {evil.py:plan: {}}", "is code, which is run only if you name it"),
        ("robot: evil.py:ROBOT", "is code, which is run only if you name it"),
        ("object_sets: {./evil.py:SET: 1}", "is code, which is run only if you name it"),
        ("seeed: 1", "did you mean 'seed'?"),
        ("{", "is not valid YAML"),
    ],
)
def test_the_folders_file_decides_what_a_config_decides_and_no_more(
    run: Run, folder: Path, text: str, complaint: str
) -> None:
    Path("link").symlink_to(folder.parent)
    Path("evil.py").write_text("open('ran', 'w')", encoding="utf-8")
    Path(FILE).write_text(text, encoding="utf-8")
    assert complaint in refused(run)
    assert not Path("ran").exists()


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda file: os.symlink("c.yaml", file)])
def test_what_is_no_regular_file_of_the_folder_is_refused(
    run: Run, make: Callable[[str], None]
) -> None:
    Path("c.yaml").write_text("seed: 1", encoding="utf-8")
    make(FILE)
    assert "no regular file" in refused(run)


def test_code_that_the_folders_file_names_is_run_once_the_user_names_it_too(run: Run) -> None:
    Path("my_file.py").write_text(POLICY, encoding="utf-8")
    Path(FILE).write_text("policies: {my_file.py:plan: 1}", encoding="utf-8")
    assert "add --plugin my_file.py" in refused(run)
    for named in (("--plugin", "./my_file.py"), ("--policy", "my_file.py:plan")):
        assert printed(run, *named)[0].policies == {"my_file_plan": 1.0}
    prepare_store(Path("p.zarr"), printed(run, "--plugin", "my_file.py")[0], JOINTS, 1, {})
    said = printed(run, "--plugin", "my_file.py", "--out", "p.zarr")[2]
    assert said == f"Using the config of p.zarr, and {FILE} of this folder.\n"


def test_a_store_of_code_is_continued_with_its_file_alone(run: Run) -> None:
    Path("my_file.py").write_text(POLICY, encoding="utf-8")
    config, _, _ = printed(run, "--policy", "my_file.py:plan")
    prepare_store(Path("p.zarr"), config, JOINTS, 1, {})
    forget_plugins()
    code, _, said = run("generate", "--out", "p.zarr")
    assert (code, said.splitlines()[0]) == (2, "Using the config of p.zarr.")
    assert "add --plugin my_file.py, or --trust" in said.splitlines()[1]
    assert printed(run, "--out", "p.zarr", "--policy", "my_file.py:plan")[0] == config
    Path("my_file.py").write_text(f"{POLICY}\n# changed", encoding="utf-8")
    changed = refused(run, "--out", "p.zarr", "--policy", "my_file.py:plan")
    assert "my_file.py has changed since p.zarr was begun" in changed
    assert "it has policies" in refused(run, "--out", "p.zarr", "--policy", "uniform")
