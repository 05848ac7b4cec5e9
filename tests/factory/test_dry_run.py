"""The forecast: of this very run, from its own code, and without a trace."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
import socket
from pathlib import Path

import pytest
from support.fake_episodes import make_episode, small_config
from support.helpers import tree

from grasp_factory.cli import run_progress
from grasp_factory.cli.main import cli
from grasp_factory.cli.run_report import forecast_text
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.executors import JOBS_PER_PROCESS, InlineExecutor
from grasp_factory.core.text_format import duration_text
from grasp_factory.errors import RecipeError, StoreMismatchError
from grasp_factory.factory import block_maker, dry_run, dry_run_pilots, generate
from grasp_factory.factory.block_job import Made
from grasp_factory.factory.dry_run import forecast, makespan, wilson
from grasp_factory.factory.dry_run_pilots import FEWEST, Pilot, is_enough, relative_error
from grasp_factory.factory.run_request import Request
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow

CONFIG = small_config()  # blocks of 4


def pretend(world: World, spec: EpisodeSpec) -> Episode:
    """Return an episode that follows from its recipe, without physics."""
    return dataclasses.replace(make_episode(CONFIG, spec.index), spec=spec)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the simulation; only for runs in this process."""
    monkeypatch.setattr(block_maker, "run_episode", pretend)


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a store of 6 rows, the second block cut short."""
    folder = tmp_path_factory.mktemp("six")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(block_maker, "run_episode", pretend)
        generate.generate(CONFIG, 6, folder / "ds.zarr", workers=1)
    return folder


@pytest.fixture
def out(six: Path, tmp_path: Path) -> Path:
    """Return a copy of that store, with the diary beside it."""
    shutil.copytree(six, tmp_path, dirs_exist_ok=True)
    return tmp_path / "ds.zarr"


@pytest.fixture
def alike(fake: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the simulation by one whose episodes all have the same size."""
    one = make_episode(CONFIG, 0)
    monkeypatch.setattr(
        block_maker, "run_episode", lambda world, spec: dataclasses.replace(one, spec=spec)
    )


def request(out: Path, n: int, config: FactoryConfig = CONFIG) -> Request:
    return Request(config=config, n=n, workers=1, out=out)


def pilot(*episodes: float) -> Pilot:
    return Pilot(block=0, worker=1, started=0.0, ended=1.0, episodes=episodes, peak_bytes=1)


class TestMakespan:
    def test_of_one_worker_is_the_sum(self) -> None:
        assert makespan([1.0, 2.0, 3.0], workers=1, start_up=0.0) == 6.0

    def test_a_last_round_that_is_not_full_takes_as_long_as_a_full_one(self) -> None:
        assert makespan([1.0] * 4, workers=2, start_up=0.0) == 2.0
        assert makespan([1.0] * 5, workers=2, start_up=0.0) == 3.0

    def test_the_next_block_goes_to_the_worker_that_is_free_first(self) -> None:
        assert makespan([3.0, 1.0, 1.0, 1.0], workers=2, start_up=0.0) == 3.0

    def test_a_worker_that_is_replaced_starts_up_again(self) -> None:
        assert makespan([1.0] * JOBS_PER_PROCESS, 1, 0.5) == JOBS_PER_PROCESS + 0.5
        assert makespan([1.0] * (JOBS_PER_PROCESS + 1), 1, 0.5) == JOBS_PER_PROCESS + 2.0

    def test_a_worker_without_a_block_does_not_count(self) -> None:
        assert makespan([1.0], workers=3, start_up=0.5) == 1.5


class TestWilson:
    @pytest.mark.parametrize(
        ("successes", "n", "low", "high"), [(5, 10, 0.2366, 0.7634), (0, 10, 0.0, 0.2775)]
    )
    def test_gives_the_textbooks_values(
        self, successes: int, n: int, low: float, high: float
    ) -> None:
        assert wilson(successes, n) == pytest.approx((low, high), abs=1e-4)

    def test_stays_within_what_a_rate_can_be(self) -> None:
        assert wilson(3, 3)[1] == 1.0
        assert wilson(0, 1)[0] == 0.0


class TestEnough:
    def test_nothing_is_uncertain_when_the_pilots_are_all(self) -> None:
        assert relative_error([pilot(1.0, 3.0)], to_make=2) == 0.0
        assert relative_error([pilot(1.0)], to_make=1) == 0.0

    def test_the_error_is_that_of_a_mean_of_a_part(self) -> None:
        found = relative_error([pilot(1.0, 3.0), pilot(1.0, 3.0)], to_make=8)
        assert found == pytest.approx(math.sqrt(4 / 3) / 2 * math.sqrt(1 / 4 - 1 / 8))

    def test_one_of_many_says_nothing(self) -> None:
        assert relative_error([pilot(1.0)], to_make=2) == math.inf

    def test_the_more_they_differ_the_more_it_takes(self) -> None:
        even, uneven = [pilot(*[1.0, 1.1] * FEWEST)], [pilot(*[1.0, 5.0] * FEWEST)]
        assert is_enough(even, to_make=1000)
        assert not is_enough(uneven, to_make=1000)

    def test_a_few_that_are_equal_by_chance_are_not_enough(self) -> None:
        assert not is_enough([pilot(*[1.0] * (FEWEST - 1))], to_make=1000)


@pytest.mark.usefixtures("fake")
class TestForecast:
    def test_leaves_no_trace(self, tmp_path: Path) -> None:
        found = forecast(request(tmp_path / "ds.zarr", 8))
        assert found.expected is not None
        assert list(tmp_path.iterdir()) == []

    def test_leaves_no_trace_when_it_is_stopped(self, tmp_path: Path) -> None:
        def stop(made: Made) -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            forecast(request(tmp_path / "ds.zarr", 8), stop)
        assert list(tmp_path.iterdir()) == []

    def test_removes_what_a_killed_one_has_left(self, tmp_path: Path, fake: None) -> None:
        head = f".out.pilots-{socket.gethostname()}"
        dead, alive = (tmp_path / f"{head}-{pid}-x" for pid in (2**22 + 1, 1))
        for left in (dead, alive):
            (left / "pilots.zarr").mkdir(parents=True)
        forecast(request(tmp_path / "out", 4))
        assert list(tmp_path.iterdir()) == [alive]

    def test_of_a_run_that_is_all_pilots_the_disk_is_right_to_the_byte(
        self, tmp_path: Path
    ) -> None:
        found = forecast(request(tmp_path / "ds.zarr", 10)).expected
        made = generate.generate(CONFIG, 10, tmp_path / "ds.zarr", workers=1)
        assert found is not None
        assert found.pilots == 10
        assert found.bytes == made.store.bytes
        assert found.success_rate == made.store.success_rate

    @pytest.mark.usefixtures("alike")
    def test_from_some_pilots_the_disk_of_all_is_foretold(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(dry_run_pilots, "ENOUGH", math.inf)
        found = forecast(request(tmp_path / "ds.zarr", 24)).expected
        made = generate.generate(CONFIG, 24, tmp_path / "ds.zarr", workers=1)
        assert found is not None
        assert found.pilots == FEWEST
        assert found.bytes == pytest.approx(made.store.bytes, rel=0.01)
        assert found.seconds_error > 0.0

    @pytest.mark.usefixtures("alike")
    def test_what_is_there_takes_no_disk_again(self, tmp_path: Path) -> None:
        before = generate.generate(CONFIG, 4, tmp_path / "ds.zarr", workers=1).store.bytes
        found = forecast(request(tmp_path / "ds.zarr", 8)).expected
        after = generate.generate(CONFIG, 8, tmp_path / "ds.zarr", workers=1).store.bytes
        assert found is not None
        assert found.bytes == pytest.approx(after - before, rel=0.01)

    def test_makes_no_more_than_the_most(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(dry_run_pilots, "ENOUGH", 0.0)
        monkeypatch.setattr(dry_run_pilots, "MOST", 12)
        found = forecast(request(tmp_path / "ds.zarr", 20)).expected
        assert found is not None
        assert found.pilots == 12

    def test_counts_what_is_there_as_the_run_does(self, out: Path, tmp_path: Path) -> None:
        files = tree(tmp_path)
        found = forecast(request(out, 10))
        assert tree(tmp_path) == files
        made = generate.generate(CONFIG, 10, out, workers=1)
        assert (found.to_make, found.already_there) == (made.made, made.already_there) == (4, 6)

    def test_of_a_store_that_is_complete_makes_no_pilot(self, out: Path) -> None:
        found = forecast(request(out, 6))
        assert (found.expected, found.to_make, found.already_there) == (None, 0, 6)
        assert forecast_text(found).endswith("is complete.")

    def test_calls_back_for_each_pilot(self, tmp_path: Path) -> None:
        made: list[int] = []
        forecast(request(tmp_path / "ds.zarr", 8), lambda one: made.append(one.index))
        assert sorted(made) == list(range(8))

    def test_quarantined_pilots_count_but_not_for_the_success(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(world: World, spec: EpisodeSpec) -> Episode:
            raise RecipeError("no luck")

        monkeypatch.setattr(block_maker, "run_episode", refuse)
        found = forecast(request(tmp_path / "ds.zarr", 8))
        assert found.expected is not None
        assert (found.expected.pilots, found.expected.quarantined) == (8, 8)
        assert found.expected.success_interval is None
        assert "quarantined  8" in forecast_text(found)

    def test_refuses_what_the_run_would_refuse(self, out: Path, tmp_path: Path) -> None:
        with pytest.raises(StoreMismatchError, match="another config"):
            forecast(request(out, 8, small_config(seed=5)))
        with pytest.raises(StoreMismatchError, match=r"there is no directory .*nowhere"):
            forecast(request(tmp_path / "nowhere" / "ds.zarr", 8))

    def test_warns_of_a_disk_that_is_too_small(self, tmp_path: Path) -> None:
        found = forecast(request(tmp_path / "ds.zarr", 4))
        assert "warning" not in forecast_text(found)
        full = dataclasses.replace(found, free_bytes=1)
        assert not full.fits
        assert f"warning: the disk of {tmp_path / 'ds.zarr'} has too little space" in forecast_text(
            full
        )

    def test_the_command_prints_a_table_or_json(
        self,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setattr(run_progress, "ProcessExecutor", lambda workers: InlineExecutor())
        out = str(tmp_path / "ds.zarr")
        args = ["generate", "--dry-run", "--n", "4", "--workers", "1", "--out", out]
        args += ["--resolution", "32x24", "--record-hz", "10", "--set", "block_size=4"]
        args += ["--set", "physics.free_hz=240", "--set", "physics.contact_hz=960"]
        cli.main(args, "grasp-factory", standalone_mode=False)
        text = capsys.readouterr().out
        assert text.startswith("4 episodes to make, 0 already there; estimated from 4 pilot")
        for word in ("time", "disk", "memory", "success"):
            assert f"\n{word} " in text
        cli.main([*args, "--json"], "grasp-factory", standalone_mode=False)
        record = json.loads(capsys.readouterr().out)
        fields = {f.name for f in dataclasses.fields(dry_run.Expected)}
        assert set(record["expected"]) == fields
        assert record["fits"] is True
        assert list(tmp_path.iterdir()) == []


@pytest.mark.soak
def test_processes_are_started_for_the_pilots_as_for_the_run(tmp_path: Path) -> None:
    config = FactoryConfig(resolution=(32, 24), block_size=2)
    found = forecast(Request(config=config, n=6, workers=2, out=tmp_path / "ds.zarr")).expected
    made = generate.generate(config, 6, tmp_path / "ds.zarr", workers=1)
    assert found is not None
    assert found.pilots == 6
    assert found.bytes == made.store.bytes
    assert found.success_rate == made.store.success_rate


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(9.6, "10 s"), (150, "2 min"), (10_000, "2.8 h"), (400_000, "4.6 days")],
)
def test_a_time_is_told_in_a_readable_unit(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
