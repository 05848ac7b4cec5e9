"""The factory: every episode once, the same whatever happens, and an honest account of it."""

from __future__ import annotations

import dataclasses
import errno
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from support.fake_episodes import make_episode, small_config
from support.helpers import assert_same_tree, tree
from support.scale import soak_only

from grasp_factory.cli import run_progress
from grasp_factory.core import progress
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.place import Place, place_of
from grasp_factory.curation import replay
from grasp_factory.curation.verify.blocks import BlockChecker
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import (
    ConfigError,
    GraspFactoryWarning,
    RecipeError,
    StoreBusyError,
    StoreError,
    StoreMismatchError,
    UnknownNameError,
    UsageError,
)
from grasp_factory.factory import block_maker, platform_check
from grasp_factory.factory import generate as factory
from grasp_factory.factory.block_job import Made, block_range
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_records import RunPlan
from grasp_factory.robots import ROBOTS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.world import World
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.block_attempt import BlockAttempt
from grasp_factory.writers.zarr.column_segments import segments
from grasp_factory.writers.zarr.lock import StoreLock

pytestmark = pytest.mark.slow

CONFIG = small_config()  # blocks of 4
TINY = FactoryConfig(resolution=(32, 24), block_size=2)
Simulate = Callable[[World, EpisodeSpec], Episode]


def pretend(world: World, spec: EpisodeSpec) -> Episode:
    """Return an episode that follows from its recipe, without physics."""
    made = make_episode(CONFIG, spec.index)
    target = spec.objects[0]
    columns = dict(made.columns) | {
        "policy": spec.policy,
        "object_set": target.object_set,
        "split": target.split,
    }
    return dataclasses.replace(made, spec=spec, columns=columns)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Callable[[Simulate], None]:
    """Replace the simulation; only for runs in this process."""
    return lambda simulate: monkeypatch.setattr(block_maker, "run_episode", simulate)


@pytest.fixture(autouse=True)
def quick(request: pytest.FixtureRequest, fake: Callable[[Simulate], None]) -> None:
    if "real_physics" not in request.fixturenames:
        fake(pretend)


@pytest.fixture
def real_physics() -> None:
    """Ask for the simulation itself."""


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "ds.zarr"


def whole_of(n: int, folder: Path) -> Path:
    """Return a store of so many pretended episodes, made in one run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(block_maker, "run_episode", pretend)
        generate(CONFIG, n, folder / "ds.zarr", workers=1)
    return folder / "ds.zarr"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of ten episodes, which no test changes."""
    return whole_of(10, tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def twelve(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of twelve episodes, which no test changes."""
    return whole_of(12, tmp_path_factory.mktemp("twelve"))


@pytest.fixture
def ten(whole: Path, out: Path) -> Path:
    """Return a copy of the store of ten episodes, with the diary beside it."""
    shutil.copytree(whole.parent, out.parent, dirs_exist_ok=True)
    return out


class TestARun:
    def test_makes_every_episode_and_counts_it_once(self, out: Path) -> None:
        summary = generate(CONFIG, 10, out, workers=1)
        assert (summary.asked, summary.made, summary.already_there) == (10, 10, 0)
        dataset = Dataset(out)
        assert dataset.committed.tolist() == list(range(10))
        assert summary.store == summarise(dataset)
        assert summary.episodes_per_second == pytest.approx(10 / summary.seconds, rel=0.01)

    def test_says_first_what_it_will_do_and_then_each_episode(self, out: Path) -> None:
        told: list[Any] = []
        generate(CONFIG, 6, out, workers=1, on_start=told.append, on_episode=told.append)
        plan, *made = told
        assert isinstance(plan, RunPlan)
        assert (plan.episodes, plan.to_make, plan.blocks, plan.workers) == (6, 6, (0, 1), 1)
        assert [m.index for m in made] == list(range(6))
        dataset = Dataset(out)
        for m in made:
            assert m.outcome == dataset[m.index].outcome.name.lower()
            assert m.policy == dataset[m.index].spec.policy

    def test_stores_what_the_recipe_gives(self, whole: Path) -> None:
        for i, episode in enumerate(Dataset(whole)):
            assert episode.spec == sample_spec(CONFIG, i)
            assert episode.checksum() == pretend(None, episode.spec).checksum()  # type: ignore[arg-type]

    def test_stores_the_robots_facts(self, whole: Path) -> None:
        assert Dataset(whole).attributes["robot"] == ROBOTS["kuka_iiwa"].facts()

    def test_again_makes_nothing_and_changes_no_byte(self, ten: Path) -> None:
        before = tree(ten.parent)
        summary = generate(CONFIG, 10, ten, workers=1)
        assert tree(ten.parent) == before
        assert (summary.made, summary.already_there) == (0, 10)
        assert summary.episodes_per_second is None
        assert summary.store.committed == 10

    def test_for_fewer_episodes_leaves_the_others(self, ten: Path) -> None:
        summary = generate(CONFIG, 3, ten, workers=1)
        assert (summary.made, summary.already_there, summary.store.episodes) == (0, 3, 10)

    def test_that_grows_gives_the_same_bytes_as_one_for_all(self, out: Path, whole: Path) -> None:
        for n in (2, 6, 10):
            summary = generate(CONFIG, n, out, workers=1)
        assert (summary.made, summary.already_there) == (4, 6)
        assert_same_tree(out, whole)


@pytest.mark.parametrize(("shown", "lines"), [(True, 4), (None, 0), (False, 0)])
def test_a_run_from_python_shows_its_progress_without_a_terminal_if_asked(
    out: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    shown: bool | None,
    lines: int,
) -> None:
    monkeypatch.setattr(progress, "LINE_S", 0.0)
    generate(CONFIG, 4, out, workers=1, progress=shown)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == lines
    assert all(re.fullmatch(r"\d of 4 episodes after .*, success .* %", line) for line in said)


class TestARunThatIsStopped:
    def test_keeps_its_blocks_and_goes_on_to_the_same_bytes(self, out: Path, whole: Path) -> None:
        def stop_at_six(made: Made) -> None:
            if made.index == 6:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            generate(CONFIG, 10, out, workers=1, on_episode=stop_at_six)
        assert Dataset(out).committed.tolist() == [0, 1, 2, 3]
        summary = generate(CONFIG, 10, out, workers=1)
        assert (summary.made, summary.already_there) == (6, 4)
        assert_same_tree(out, whole)

    def test_says_how_many_episodes_are_discarded(self, out: Path) -> None:
        follower = run_progress.RunProgress(quiet=True)

        def stop_at_six(made: Made) -> None:
            follower.episode(made)
            if made.index == 6:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            generate(CONFIG, 10, out, workers=1, on_episode=stop_at_six)
        assert run_progress.stopped_text(out, follower.made) == (
            f"Stopped: 4 episodes are in {out}, 3 of unfinished blocks are discarded; run the same"
            " command again to continue."
        )

    def test_by_a_bug_quarantines_the_episode_and_says_which_error_it_was(
        self, out: Path, fake: Callable[[Simulate], None]
    ) -> None:
        def breaks(world: World, spec: EpisodeSpec) -> Episode:
            return pretend(world, spec) if spec.index < 5 else 1 / 0  # type: ignore[return-value]

        fake(breaks)
        assert generate(CONFIG, 8, out, workers=1, max_failures=1.0).store.quarantined == 3
        dataset = Dataset(out)
        assert dataset.committed.tolist() == [0, 1, 2, 3, 4]
        assert dataset.column("error")[6] == "ZeroDivisionError: division by zero"
        assert dataset.spec(6) == sample_spec(CONFIG, 6)

    def test_lets_the_store_go(self, out: Path) -> None:
        def stop(_made: Made) -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            generate(CONFIG, 4, out, workers=1, on_episode=stop)
        with StoreLock(out):
            pass


class TestGrowingACutBlock:
    """Ten episodes in blocks of four: 8 and 9 are alone in theirs."""

    def test_makes_no_episode_again(self, ten: Path, fake: Callable[[Simulate], None]) -> None:
        def only_new(world: World, spec: EpisodeSpec) -> Episode:
            assert spec.index >= 10, "it is there"
            return pretend(world, spec)

        fake(only_new)
        made: list[Made] = []
        summary = generate(CONFIG, 16, ten, workers=1, on_episode=made.append)
        assert (summary.made, summary.already_there) == (6, 10)
        assert [one.index for one in made] == list(range(10, 16))
        assert summary.store.committed == 16

    @pytest.mark.parametrize("writes", [1, 60, *soak_only(0, 30, 75)])
    def test_loses_none_on_the_way(
        self, ten: Path, twelve: Path, monkeypatch: pytest.MonkeyPatch, writes: int
    ) -> None:
        want = {i: Dataset(ten)[i].checksum() for i in (8, 9)}
        left = writes

        stage = BlockAttempt.stage

        def fails_later(attempt: BlockAttempt, file: Place, data: bytes) -> None:
            nonlocal left
            if left == 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            left -= 1
            stage(attempt, file, data)

        with monkeypatch.context() as patch, pytest.raises(StoreError, match="No space left"):
            patch.setattr(BlockAttempt, "stage", fails_later)
            generate(CONFIG, 12, ten, workers=1)
        dataset = Dataset(ten, checked=True)
        assert dataset.committed.tolist() == list(range(10))
        assert {i: dataset[i].checksum() for i in (8, 9)} == want
        files = BlockChecker(ten)
        assert [p.what for p in files(range(2, 3), lambda row: None).problems if p.episode > 9] == [
            "is missing, as are others up to 11"
        ]
        generate(CONFIG, 12, ten, workers=1)
        assert_same_tree(ten, twelve)


def test_quarantined_episodes_are_tried_again_when_asked_to(
    out: Path, whole: Path, fake: Callable[[Simulate], None]
) -> None:
    def breaks(world: World, spec: EpisodeSpec) -> Episode:
        if spec.index in (1, 6):
            raise ValueError("a bad day")
        return pretend(world, spec)

    fake(breaks)
    generate(CONFIG, 10, out, workers=1)
    assert generate(CONFIG, 10, out, workers=1).made == 0
    fake(pretend)
    made: list[Made] = []
    again = generate(CONFIG, 10, out, 1, retry_quarantined=True, on_episode=made.append)
    assert [one.index for one in made] == [1, 6]
    assert (again.made, again.store.quarantined) == (2, 0)
    assert_same_tree(out, whole)


def test_going_on_with_other_versions_is_warned_of(
    ten: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        platform_check, "changed_versions", lambda facts: ["pybullet: 3.2.7, now 9.9.9"]
    )
    with pytest.warns(GraspFactoryWarning, match=r"other versions \(pybullet: 3\.2\.7, now 9"):
        generate(CONFIG, 12, ten, workers=1)
    generate(CONFIG, 12, ten, workers=1)  # nothing is made: nothing to warn of


class TestARecipeThatCannotBeBuilt:
    @pytest.fixture(autouse=True)
    def bad_luck(self, quick: None, fake: Callable[[Simulate], None]) -> None:
        def simulate(world: World, spec: EpisodeSpec) -> Episode:
            if spec.index == 2:
                raise RecipeError("duck.urdf cannot be loaded")
            return pretend(world, spec)

        fake(simulate)

    def test_is_counted_and_kept_with_its_reason_while_the_run_goes_on(self, out: Path) -> None:
        made: list[Made] = []
        summary = generate(CONFIG, 5, out, workers=1, on_episode=made.append)
        assert (summary.store.quarantined, summary.store.committed) == (1, 4)
        assert sum(summary.store.outcomes.values()) == 4
        assert (made[2].outcome, made[2].reason) == ("quarantined", "duck.urdf cannot be loaded")
        dataset = Dataset(out)
        assert dataset.column("error")[2] == "duck.urdf cannot be loaded"
        assert dataset.spec(2) == sample_spec(CONFIG, 2)

    def test_is_not_tried_again(self, out: Path) -> None:
        generate(CONFIG, 5, out, workers=1)
        assert generate(CONFIG, 5, out, workers=1).made == 0


def test_what_the_user_got_wrong_is_found_before_anything_is_written(out: Path) -> None:
    wrong: list[tuple[dict[str, Any], type[UsageError], str]] = [
        ({"n": 0}, ConfigError, "n: got 0, valid: an integer from 1 to"),
        ({"n": 2.5}, ConfigError, r"n: got 2\.5"),
        ({"workers": 0}, ConfigError, "workers: got 0, valid: an integer from 1 to"),
        ({"robot": "kuka"}, UnknownNameError, "unknown robot 'kuka'; did you mean 'kuka_iiwa'"),
        ({"policies": {"topdown": 1}}, UnknownNameError, "unknown policy 'topdown'; did you mean"),
        ({"object_sets": {"blob": 1}}, UnknownNameError, "unknown object set 'blob'; did you mean"),
    ]
    for change, kind, text in wrong:
        run = {"n": change.pop("n", 3), "workers": change.pop("workers", 1)}
        config = small_config(**change)
        with pytest.raises(kind, match=text):
            generate(config, out=out, **run)
        assert list(out.parent.iterdir()) == []


def test_a_path_that_is_something_else_is_refused_and_kept(out: Path) -> None:
    out.write_text("mine")
    with pytest.raises(StoreMismatchError, match="is a file"):
        generate(CONFIG, 3, out, workers=1)
    assert out.read_text() == "mine"
    assert list(out.parent.iterdir()) == [out]


def test_a_store_of_another_config_is_refused_and_kept(ten: Path) -> None:
    before = tree(ten)
    with pytest.raises(StoreMismatchError, match="it has seed: 0, and this run has 1"):
        generate(dataclasses.replace(CONFIG, seed=1), 19, ten, workers=1)
    assert tree(ten) == before


def test_a_store_that_another_run_writes_is_refused(out: Path) -> None:
    with StoreLock(out), pytest.raises(StoreBusyError, match="is being written by"):
        generate(CONFIG, 3, out, workers=1)
    assert not out.exists()


def test_a_diary_that_cannot_be_written_is_found_before_the_first_episode(out: Path) -> None:
    out.with_name("ds.zarr.runs.jsonl").mkdir()
    made: list[Made] = []
    with pytest.raises(UsageError, match=r"ds\.zarr\.runs\.jsonl is in the way"):
        generate(CONFIG, 3, out, workers=1, on_episode=made.append)
    assert made == []
    assert [path.name for path in out.parent.iterdir()] == ["ds.zarr.runs.jsonl"]


def test_a_run_that_was_refused_leaves_no_diary(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise StoreError("the disk is full")

    monkeypatch.setattr(factory, "prepare_store", full)
    with pytest.raises(StoreError, match="the disk is full"):
        generate(CONFIG, 3, out, workers=1)
    assert list(out.parent.iterdir()) == []


def test_a_store_is_gone_on_with_by_its_own_config_however_that_was_built(out: Path) -> None:
    built = dataclasses.replace(CONFIG, policies={"uniform": 1}, seed=np.int64(3))  # type: ignore[arg-type]
    generate(built, np.int64(2), out, workers=1)  # type: ignore[arg-type]
    summary = generate(Dataset(out).config, 3, out, workers=1)
    assert summary.store.committed == 3
    read = FactoryConfig.from_plain(json.loads(json.dumps(built.to_plain())))
    assert generate(read, 3, out, workers=1).made == 0


def test_the_diary_beside_the_store_has_a_line_per_run(out: Path) -> None:
    def stop(made: Made) -> None:
        if made.index == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(CONFIG, 6, out, workers=1, on_episode=stop)
    generate(CONFIG, 6, out, workers=1)
    text = out.with_name("ds.zarr.runs.jsonl").read_text()
    first, second = (json.loads(line) for line in text.splitlines())
    assert (first["ended"], first["asked"], first["made"]) == ("KeyboardInterrupt", 6, 5)
    assert (second["ended"], second["asked"], second["made"]) == ("done", 6, 2)
    assert {"started", "finished", "host", "command", "workers", "versions"} <= set(second)


class TestARunThatFillsSegments:
    @pytest.fixture(autouse=True)
    def small_segments(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", 1)

    @staticmethod
    def packed(out: Path) -> list[str]:
        return [segment.file.name for segment in segments(place_of(out))]

    def test_packs_them_as_it_goes_with_the_same_bytes_however_it_came_to_its_end(
        self, out: Path
    ) -> None:
        def stop_at_seven(made: Made) -> None:
            if made.index == 7:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            generate(CONFIG, 10, out, workers=1, on_episode=stop_at_seven)
        assert self.packed(out) == ["0-0.npz"]
        for n in (10, 14):
            summary = generate(CONFIG, n, out, workers=1)
        assert self.packed(out) == ["0-0.npz", "1-1.npz", "2-2.npz"]
        assert summary.store == summarise(Dataset(out))
        assert summary.store.bytes == sum(len(data) for data in tree(out).values())
        whole = out.with_name("whole.zarr")
        generate(CONFIG, 14, whole, workers=1)
        assert_same_tree(out, whole)


def test_blocks_cover_every_episode_once_and_end_with_the_store() -> None:
    covered = [i for block in range(3) for i in block_range(block, 4, 10)]
    assert covered == list(range(10))


def test_an_empty_store_has_no_rates(out: Path) -> None:
    def stop(_plan: RunPlan) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(CONFIG, 3, out, workers=1, on_start=stop)
    summary = summarise(Dataset(out))
    assert (summary.committed, summary.missing) == (0, 3)
    assert summary.success_rate is None
    assert summary.bytes_per_episode is None


def test_a_summary_counts_what_the_store_holds(whole: Path) -> None:
    dataset = Dataset(whole)
    summary = summarise(dataset)
    episodes = list(dataset)
    assert summary.successes == sum(e.success for e in episodes)
    assert summary.success_rate == pytest.approx(summary.successes / 10)
    for name, tally in summary.policies.items():
        mine = [e for e in episodes if e.spec.policy == name]
        assert (tally.episodes, tally.successes) == (len(mine), sum(e.success for e in mine))
    for word, count in summary.outcomes.items():
        assert count == sum(e.outcome.name.lower() == word for e in episodes)
    assert sum(t.episodes for t in summary.splits.values()) == 10
    assert sum(t.episodes for t in summary.object_sets.values()) == 10
    assert summary.bytes == sum(len(data) for data in tree(whole).values())


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of real episodes that this process has made."""
    path = tmp_path_factory.mktemp("real") / "ds.zarr"
    assert generate(TINY, 5, path, workers=1).store.committed == 5
    return path


@pytest.mark.usefixtures("real_physics")
class TestRealEpisodes:
    @pytest.mark.parametrize("workers", [2, *soak_only(3)])
    def test_are_the_same_bytes_for_one_two_and_three_workers(
        self, real: Path, out: Path, workers: int
    ) -> None:
        assert generate(TINY, 5, out, workers=workers).store.committed == 5
        assert_same_tree(real, out)

    def test_replay_to_the_same_bytes(self, real: Path) -> None:
        for index in (2, 0):
            result = replay.replay(real, index)
            assert result.same, result.difference
            assert result.changed == ()


class TestAReplay:
    @pytest.fixture
    def store(self, ten: Path) -> Path:
        return ten

    def replay_with(
        self, monkeypatch: pytest.MonkeyPatch, store: Path, change: Callable[[Episode], Episode]
    ) -> replay.Replay:
        monkeypatch.setattr(replay, "run_episode", lambda w, spec: change(pretend(w, spec)))
        return replay.replay(store, 1)

    def test_of_the_same_bytes_is_the_same(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        result = self.replay_with(monkeypatch, store, lambda episode: episode)
        assert result.same
        assert (result.difference, result.changed) == ("", ())
        assert result.recorded == result.replayed

    def test_names_the_first_array_that_differs_and_how_far(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def change(episode: Episode) -> Episode:
            widths = episode.streams["gripper_width"].copy()
            widths[0] = np.nan_to_num(widths[0]) + 0.5
            return dataclasses.replace(
                episode, streams=dict(episode.streams) | {"gripper_width": widths}
            )

        result = self.replay_with(monkeypatch, store, change)
        assert not result.same
        assert result.difference.startswith("streams/gripper_width: 1 of ")

    def test_sees_a_zero_that_changed_its_sign(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def change(episode: Episode) -> Episode:
            values = np.negative(episode.streams["reward"])
            return dataclasses.replace(episode, streams=dict(episode.streams) | {"reward": values})

        result = self.replay_with(monkeypatch, store, change)
        assert result.difference.startswith("streams/reward: ")

    def test_says_which_versions_changed(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        root = zarr.open_group(store, mode="r+")
        versions = dict(root.attrs["versions"]) | {"pybullet": "3.2.6"}  # type: ignore[arg-type]
        root.attrs["versions"] = versions
        result = self.replay_with(monkeypatch, store, lambda episode: episode)
        assert result.same
        assert len(result.changed) == 1
        assert result.changed[0].startswith("pybullet: 3.2.6, now ")

    def test_of_damaged_data_is_an_error_and_not_a_difference(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        array = zarr.open_array(store, path="episodes/lift_height", mode="r+")
        array[1] = 99.0
        with pytest.raises(StoreError, match="episode 1 does not match its checksum"):
            self.replay_with(monkeypatch, store, lambda episode: episode)

    def test_of_a_quarantined_recipe_expects_the_same_reason(
        self, out: Path, monkeypatch: pytest.MonkeyPatch, fake: Callable[[Simulate], None]
    ) -> None:
        def fail(world: World, spec: EpisodeSpec) -> Episode:
            raise RecipeError("too heavy")

        fake(fail)
        generate(CONFIG, 2, out, workers=1)
        monkeypatch.setattr(replay, "run_episode", fail)
        assert replay.replay(out, 1).same
        result = self.replay_with(monkeypatch, out, lambda episode: episode)
        assert not result.same
        assert result.recorded == "too heavy"

    def test_of_an_episode_that_is_not_there_names_what_is(self, store: Path) -> None:
        for index in (-1, 10):
            with pytest.raises(UsageError, match=f"episode {index}: .* has episodes 0 to 9"):
                replay.replay(store, index)

    def test_of_an_episode_that_is_not_made_says_what_to_do(self, out: Path) -> None:
        def stop(_plan: RunPlan) -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            generate(CONFIG, 3, out, workers=1, on_start=stop)
        with pytest.raises(UsageError, match="not made yet: run its generate command again"):
            replay.replay(out, 1)
