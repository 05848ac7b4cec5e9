"""The live view's core: what it remembers of a run, and that each alarm rings when it should."""

from __future__ import annotations

import itertools
import json
import random
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_episodes import make_episode, make_rows, small_config
from support.helpers import assert_same_tree
from support.live_run import ALONE, SMALL, running

from grasp_factory.apps.live import watch
from grasp_factory.apps.live.alarms import (
    ALARM_CHECKS,
    FEWEST_QUARANTINED,
    NOT_TRIED,
    RESERVE,
    STALL_S,
    START_S,
    findings,
)
from grasp_factory.apps.live.drift import EVERY, FALSE_ALARMS, LAST, SuccessDrift, two_sided
from grasp_factory.apps.live.facts import BlockFacts, Brightness, Disk, EpisodeFacts
from grasp_factory.apps.live.state import LATEST, RECENT, Asked, LiveState
from grasp_factory.apps.live.view import LiveView
from grasp_factory.apps.live.watch import RunWatch
from grasp_factory.apps.live.windows import MOST_WINDOWS, TICK_S, EpisodeRate, Windows
from grasp_factory.cli.run_progress import live_view
from grasp_factory.core.alarm_book import AGAIN_S, Alarm, AlarmBook, Finding
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.place import place_of
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset import index as index_package
from grasp_factory.dataset.block_version import block_version
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.factory import block_maker
from grasp_factory.factory.block_job import Made, summary_of
from grasp_factory.factory.generate import generate
from grasp_factory.simulation.world import World
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytestmark = pytest.mark.slow

GOOD = {
    "sharpness": 0.9,
    "exposure": 0.55,
    "clipped": 0.0,
    "target_visibility": 1.0,
    "target_pixels": 900.0,
    "depth_holes": 0.0,
    "stream_gap": 1.0,
    "max_penetration": 0.0,
    "table_penetration": 0.0,
    "force_residual": float("nan"),
}
LENGTHS = {"n_steps": 400, "n_imu": 800}
WORDS = st.sampled_from([*names(Outcome), "quarantined"])


def made(index: int, outcome: str = "success") -> Made:
    return Made(index=index, policy="top_down", outcome=outcome)


def fact(row: int, outcome: str = "success", **more: Any) -> EpisodeFacts:
    return EpisodeFacts(row=row, outcome=outcome, **{"lengths": LENGTHS, "measured": GOOD} | more)


def steady(
    n: int, *, to_make: int = 10_000, each: float = 1.0, outcome: str = "success"
) -> LiveState:
    """Return the state of a healthy run after ``n`` episodes, one every ``each`` seconds."""
    state = LiveState(Asked(to_make=to_make, workers=2, block_size=4))
    go_on(state, n, each=each, outcome=outcome)
    return state


def go_on(state: LiveState, n: int, *, each: float, outcome: str = "success", **more: Any) -> float:
    """Make more episodes; return when the last one was made."""
    at = state.latest_at or 0.0
    for index in range(state.made, state.made + n):
        at += each
        state.add(made(index, outcome), at)
        block = index // state.asked.block_size
        rows = [] if outcome == "quarantined" else [fact(index, outcome, **more)]
        state.commit(block, rows)
    return at


def kinds(state: LiveState, now: float | None = None) -> list[str]:
    return [found.kind for found in findings(state, state.latest_at if now is None else now)]


def the(kind: str, state: LiveState, now: float | None = None) -> Finding:
    (found,) = [f for f in findings(state, now or state.latest_at or 0.0) if f.kind == kind]
    return found


class TestTheState:
    @given(st.lists(WORDS, max_size=200))
    def test_counts_every_episode_once(self, outcomes: list[str]) -> None:
        state = LiveState(Asked(to_make=1000, block_size=4))
        for index, outcome in enumerate(outcomes):
            state.add(made(index, outcome), float(index))
        assert state.made == len(outcomes)
        assert state.outcomes == Counter(outcomes)
        assert state.left == 1000 - len(outcomes)
        assert sum(map(len, state.waiting.values())) == len(outcomes)
        attempts = [word for word in outcomes if word != "quarantined"]
        want = attempts.count("success") / len(attempts) if attempts else None
        assert state.success_rate == want

    def test_shows_the_newest_episodes_first_and_only_what_is_committed(self) -> None:
        state = LiveState(Asked(to_make=100, block_size=4))
        for index in range(8):
            state.add(made(index), float(index))
        assert not state.latest
        state.commit(1, [fact(i, object_id=f"o{i}", version="ab" * 8) for i in range(4, 8)])
        assert [entry["row"] for entry in state.latest] == [7, 6, 5, 4]
        assert state.latest[0]["object_id"] == "o7"
        assert state.latest[0]["version"] == "ab" * 8
        assert list(state.waiting) == [0]

    def test_remembers_few_however_many_there_are(self) -> None:
        state = steady(500)
        assert len(state.latest) == LATEST
        assert len(state.facts) == len(state.recent) == RECENT
        assert state.latest[0]["row"] == 499

    def test_knows_the_rates_and_the_time_left(self) -> None:
        state = steady(200, to_make=1000, each=0.5)
        assert state.rates(100.0) == {"minute": pytest.approx(2.0, rel=0.1), "run": 2.0}
        assert state.seconds_left(100.0) == pytest.approx(400.0, rel=0.1)
        assert state.seconds_left(10_000.0) is None


class TestWindows:
    @given(st.lists(WORDS, min_size=1, max_size=1000))
    @settings(max_examples=50)
    def test_hold_every_episode_and_stay_few(self, outcomes: list[str]) -> None:
        windows = Windows()
        for index, outcome in enumerate(outcomes):
            windows.add(outcome, index + 1.0)
        plain = windows.to_plain()
        assert {word: sum(counts) for word, counts in plain["outcomes"].items()} == Counter(
            outcomes
        )
        assert len(plain["made"]) <= MOST_WINDOWS
        assert plain["made"][-1] == len(outcomes)
        assert plain["seconds"][-1] == len(outcomes)
        assert {len(v) for k, v in plain.items() if isinstance(v, list)} == {len(plain["made"])}
        sizes = {b - a for a, b in itertools.pairwise([0, *plain["made"][:-1]])}
        assert sizes <= {plain["size"]}

    def test_say_the_success_among_attempts_alone(self) -> None:
        windows = Windows()
        windows.size = 4
        for outcome in ("success", "quarantined", "collision", "quarantined", "quarantined"):
            windows.add(outcome, 1.0)
        assert windows.to_plain()["success"] == [0.5, None]

    @given(
        st.lists(st.floats(0.0, 500.0), max_size=100).map(sorted),
        st.floats(0.0, 500.0),
        st.sampled_from([5.0, 20.0, 60.0]),
    )
    def test_of_the_clock_hold_what_came_in_whole_ticks(
        self, times: list[float], more: float, window: float
    ) -> None:
        pace = EpisodeRate()
        for at in times:
            pace.add(at)
        now = (times[-1] if times else 0.0) + more
        rates = pace.rates(window, now)
        ticks = int(now // TICK_S)
        first = ticks % round(window / TICK_S)
        want = sum(first <= at // TICK_S < ticks for at in times)
        assert sum(rates) * window == pytest.approx(want)
        assert len(rates) == ticks // round(window / TICK_S)


class TestTheTestForDrift:
    def test_is_exact(self) -> None:
        # Fisher's tea tasting: 3 of 4 right, P(X >= 3) = 17/70
        assert two_sided(3, 4, 1, 4) == pytest.approx(2 * 17 / 70)
        assert two_sided(50, 100, 500, 1000) == 1.0

    @given(st.integers(1, 60), st.integers(1, 60), st.data())
    def test_does_not_care_which_of_two_words_is_success(
        self, n: int, before: int, data: st.DataObject
    ) -> None:
        hits, hits_before = data.draw(st.integers(0, n)), data.draw(st.integers(0, before))
        chance = two_sided(hits, n, hits_before, before)
        assert 0.0 <= chance <= 1.0
        assert chance == pytest.approx(two_sided(n - hits, n, before - hits_before, before))

    @pytest.mark.parametrize("rate", [0.05, 0.5, 0.9])
    def test_cries_wolf_in_no_more_runs_than_it_says(self, rate: float) -> None:
        rng = random.Random(7)
        runs, false = 1500, 0
        for _ in range(runs):
            drift = SuccessDrift(500)
            for _ in range(500):
                drift.add(rng.random() < rate)
                if drift.shift:
                    false += 1
                    break
        # Binomial with the stated chance: so many more would be seen in one of 10,000 such tests.
        assert false <= FALSE_ALARMS * runs + 3.7 * (FALSE_ALARMS * runs) ** 0.5

    @pytest.mark.parametrize(("before", "after"), [(0.6, 0.2), (0.1, 0.5), (0.9, 0.5)])
    def test_finds_a_large_change_within_the_next_episodes(
        self, before: float, after: float
    ) -> None:
        rng = random.Random(8)
        runs, found = 50, 0
        for _ in range(runs):
            drift = SuccessDrift(8000)
            for _ in range(1000):
                drift.add(rng.random() < before)
            assert drift.shift is None
            for _ in range(LAST + EVERY):
                drift.add(rng.random() < after)
            found += drift.shift is not None
        assert found >= 0.9 * runs

    def test_ends_when_the_rate_is_back_and_not_by_growing_used_to_it(self) -> None:
        drift = SuccessDrift(10_000)
        for i in range(400):
            drift.add(i % 2 == 0)
        for _ in range(1000):
            drift.add(False)
        assert drift.shift is not None
        assert drift.shift.last == 0.0
        assert drift.shift.before == pytest.approx(0.5, abs=0.2)
        for i in range(2 * LAST):
            drift.add(i % 2 == 0)
        assert drift.shift is None


class TestAnAlarm:
    def test_is_silent_in_a_healthy_run(self) -> None:
        rng = random.Random(5)
        state = LiveState(Asked(to_make=3000, workers=2, block_size=4))
        at = 0.0
        for index in range(3000):
            at += rng.uniform(0.5, 1.5)
            outcome = "success" if rng.random() < 0.5 else rng.choice(names(Outcome)[1:])
            state.add(made(index, outcome), at)
            state.commit(index // 4, [fact(index, outcome)])
            if index % 50 == 0:
                state.disk = Disk(free=10**12, per_episode=1e6)
                assert findings(state, at + 1.0) == []

    @pytest.mark.parametrize("column", ["n_steps", "n_imu", "n_video"])
    def test_rings_for_an_empty_stream_until_it_is_long_ago(self, column: str) -> None:
        state = steady(20)
        go_on(state, 1, each=1.0, lengths={**LENGTHS, "n_video": 40, column: 0})
        found = the("stream", state)
        assert found.rows == (20,)
        assert f"no records in {column}: 1 of the latest 21 episodes" in found.text
        go_on(state, RECENT - 1, each=1.0)
        assert "stream" in kinds(state)
        go_on(state, 1, each=1.0)
        assert "stream" not in kinds(state)

    @pytest.mark.parametrize("outcome", sorted(NOT_TRIED))
    def test_takes_streams_of_an_attempt_that_never_began_for_empty(self, outcome: str) -> None:
        state = steady(5)
        go_on(state, 5, each=1.0, outcome=outcome, lengths={"n_steps": 0, "n_imu": 0})
        assert kinds(state) == []

    @pytest.mark.parametrize(
        ("measured", "word"),
        [
            ({"exposure": 0.0}, "black"),
            ({"exposure": 1.0}, "white"),
            ({"exposure": 0.2, "clipped": 0.97}, "black"),
        ],
    )
    def test_rings_for_a_blank_image(self, measured: dict[str, float], word: str) -> None:
        state = steady(20)
        go_on(state, 2, each=1.0, measured={**GOOD, **measured})
        found = the("image", state)
        assert found.rows == (20, 21)
        assert word in found.text

    def test_names_the_image_that_it_has_looked_at(self) -> None:
        state = steady(3)
        good, black = Brightness(mean=0.5, clipped=0.0), Brightness(mean=0.001, clipped=1.0)
        state.look(2, {"front before": good, "wrist after": black})
        found = the("image", state)
        assert (found.text, found.rows) == (
            "wrist after is black: 1 of the latest 3 episodes",
            (2,),
        )
        state.look(999, {"front before": black})
        assert the("image", state) == found

    def test_rings_when_most_episodes_miss_a_criterion_of_quality(self) -> None:
        state = steady(30)
        go_on(state, 20, each=1.0, measured={**GOOD, "stream_gap": 4.0})
        assert kinds(state) == []
        go_on(state, 10, each=1.0, measured={**GOOD, "stream_gap": 4.0})
        assert "poor streams: stream_gap 4, valid: at most 1.5" in the("quality", state).text
        go_on(state, RECENT // 2, each=1.0)
        assert kinds(state) == []

    def test_rings_when_much_is_quarantined(self) -> None:
        state = steady(100)
        go_on(state, FEWEST_QUARANTINED, each=1.0, outcome="quarantined")
        assert kinds(state) == []  # 5 of 50
        go_on(state, 1, each=1.0, outcome="quarantined")
        assert the("quarantine", state).text == "6 of the last 50 episodes are quarantined"
        go_on(state, RECENT, each=1.0)
        assert kinds(state) == []

    def test_rings_at_the_start_if_all_is_quarantined(self) -> None:
        assert kinds(steady(FEWEST_QUARANTINED - 1, outcome="quarantined")) == []
        assert kinds(steady(FEWEST_QUARANTINED, outcome="quarantined")) == ["quarantine"]

    def test_rings_when_the_rate_falls_to_less_than_half_and_ends_with_it(self) -> None:
        state = steady(600)
        now = go_on(state, 50, each=2.5)
        found = the("rate", state)
        assert "0.4 episodes per second, 1 is usual in this run" in found.text
        go_on(state, 130, each=1.0)
        assert "rate" not in kinds(state)
        assert now > 600.0

    def test_does_not_take_a_slow_start_or_the_end_of_the_work_for_a_fall(self) -> None:
        state = steady(10, each=20.0)
        assert "rate" not in kinds(state)
        go_on(state, 400, each=1.0)
        assert "rate" not in kinds(state)
        ending = steady(600, to_make=640)
        go_on(ending, 36, each=4.0)
        assert "rate" not in kinds(ending)

    def test_rings_when_success_drifts(self) -> None:
        state = steady(400)
        go_on(state, LAST, each=1.0, outcome="collision")
        assert the("drift", state).text.startswith("0% of the last 100 attempts succeeded, 100%")

    def test_rings_when_no_episode_comes_for_long(self) -> None:
        state = steady(100)
        assert kinds(state, 100.0 + STALL_S) == []
        found = the("stall", state, 101.0 + STALL_S)
        assert found.text == f"no episode has been made for {STALL_S + 1:.0f} s"
        state.add(made(100), 102.0 + STALL_S)
        assert "stall" not in kinds(state)

    def test_waits_longer_where_episodes_take_long_or_none_has_come_yet(self) -> None:
        slow = steady(10, each=30.0)
        assert "stall" not in kinds(slow, 300.0 + 1000.0)
        assert "stall" in kinds(slow, 300.0 + 1300.0)
        fresh = steady(0)
        assert kinds(fresh, START_S) == []
        assert kinds(fresh, START_S + 1.0) == ["stall"]

    def test_is_over_when_the_run_is(self) -> None:
        state = steady(100, to_make=100)
        assert kinds(state, 1e6) == []

    def test_rings_when_the_disk_will_not_do(self) -> None:
        state = steady(100, to_make=1100)
        state.disk = Disk(free=RESERVE + 5_000_000_000, per_episode=5e6)
        assert kinds(state) == []
        state.disk = replace(state.disk, per_episode=6e6)
        text = the("disk", state).text
        assert text == "5.2 GB are free, the 1,000 episodes to come take about 6.0 GB"
        state.disk = Disk(free=RESERVE - 1, per_episode=0.0)
        assert the("disk", state).text == "0.2 GB are free"


class TestTheBookOfAlarms:
    def test_keeps_when_each_began_and_ended(self) -> None:
        book = AlarmBook()
        (new,) = book.update([Finding(kind="rate", text="slow")], 10.0)
        assert (new.kind, new.since, new.until) == ("rate", 10.0, None)
        assert book.update([Finding(kind="rate", text="slower")], 20.0) == []
        assert book.lasting["rate"] == Alarm(kind="rate", since=10.0, text="slower")
        assert book.update([], 30.0) == []
        assert book.lasting == {}
        assert book.past == [Alarm(kind="rate", since=10.0, text="slower", until=30.0)]

    def test_tells_nobody_twice_within_ten_minutes(self) -> None:
        book, one = AlarmBook(), Finding(kind="rate", text="slow")
        assert len(book.update([one], 0.0)) == 1
        book.update([], 1.0)
        assert book.update([one], AGAIN_S - 1.0) == []
        book.update([], AGAIN_S - 0.5)
        assert len(book.update([one], AGAIN_S)) == 1

    @given(st.lists(st.sets(st.sampled_from(["a", "b", "c"])), max_size=60))
    def test_has_what_lasts_and_nothing_else(self, steps: list[set[str]]) -> None:
        book = AlarmBook()
        for now, step in enumerate(steps):
            book.update([Finding(kind=kind, text="") for kind in step], float(now))
            assert set(book.lasting) == step
            assert all(alarm.until is None for alarm in book.lasting.values())
            assert all(alarm.until is not None for alarm in book.past)

    def test_every_look_is_for_a_kind_of_its_own(self) -> None:
        assert len({look.__name__ for look in ALARM_CHECKS}) == len(ALARM_CHECKS) == 8


class TestFactsOfAStore:
    CONFIG = small_config(
        cameras={name: to_plain(CAMERAS[name].config) for name in ("front", "wrist")}
    )

    @pytest.fixture
    def rows(self, tmp_path: Path) -> list[Any]:
        path = tmp_path / "ds.zarr"
        prepare_store(path, self.CONFIG, 7, 10, {"name": "fake"})
        rows = make_rows(self.CONFIG, 1, 10, quarantined=(6,))
        ZarrWriter(path).write_block(1, rows)
        return rows

    def test_are_those_that_were_written(self, rows: list[Any], tmp_path: Path) -> None:
        reader = BlockFacts(tmp_path / "ds.zarr")
        told = [summary_of(row, 4 + k) for k, row in enumerate(rows)]
        assert reader.committed(told)
        facts = reader.read(told)
        assert [fact.row for fact in facts] == [4, 5, 7]
        for fact in facts:
            episode: Episode = rows[fact.row - 4]
            assert fact.version == block_version(place_of(tmp_path / "ds.zarr"), 1)
            assert fact.object_id == episode.spec.objects[0].object_id
            assert fact.outcome == episode.outcome.name.lower()
            assert fact.lengths["n_steps"] == len(episode.streams["timestamp"])
            assert repr(fact.measured["exposure"]) == repr(float(episode.columns["exposure"]))

    def test_wait_for_the_commit_of_what_was_told(self, rows: list[Any], tmp_path: Path) -> None:
        reader = BlockFacts(tmp_path / "ds.zarr")
        assert not reader.committed([made(0), made(1)])
        assert not reader.committed([made(6)])  # in quarantine still: it is being tried again
        assert reader.committed([made(6, "quarantined")])

    def test_see_every_image(self, rows: list[Any], tmp_path: Path) -> None:
        images = BlockFacts(tmp_path / "ds.zarr").images(5)
        assert set(images) == {"front before", "front after", "wrist before", "wrist after"}
        rgb = rows[1].cameras["wrist"].rgb[1]
        assert images["wrist after"].mean == pytest.approx(rgb.mean() / 255.0, abs=0.02)

    def test_measure_the_disk(self, rows: list[Any], tmp_path: Path) -> None:
        reader = BlockFacts(tmp_path / "ds.zarr")
        assert reader.disk(None).per_episode == 0.0
        found = reader.disk(1)
        assert found.free > 0
        store = tmp_path / "ds.zarr"
        size = sum(
            p.stat().st_size for p in store.rglob("*") if p.is_file() and p.suffix != ".json"
        )
        assert 0.3 * size < 4 * found.per_episode <= size


class TestARealRun:
    @pytest.mark.soak
    def test_is_told_while_it_runs_and_to_its_end(self, tmp_path: Path) -> None:
        out = tmp_path / "ds.zarr"
        with running(out, 12, [*SMALL, "--json"]) as run:
            states = [run.until(run.state)]
            run.until(lambda: states.append(run.state()) or states[-1]["latest"])
            for entry in states[-1]["latest"]:
                assert run.get(f"/thumb/0/{entry['row']}.jpg")[:3] == b"\xff\xd8\xff"
            assert b"grasp-factory" in run.get("/")
            run.until(lambda: states.append(run.state()) or states[-1]["phase"] != "running")
            assert run.wait() == 0
            assert json.loads(run.out)["made"] == 12
            assert "alarm" not in run.err
            with pytest.raises(OSError, match="refused"):
                run.get("/api/live")
        made = [state["made"] for state in states]
        assert made == sorted(made)
        last = states[-1]
        dataset = Dataset(out)
        assert (last["phase"], last["made"], last["to_make"]) == ("finished", 12, 12)
        assert last["waiting"] == 0
        assert sorted(entry["row"] for entry in last["latest"]) == list(range(12))
        for entry in last["latest"]:
            episode = dataset[entry["row"]]
            assert entry["outcome"] == episode.outcome.name.lower()
            assert entry["object_id"] == episode.spec.objects[0].object_id
            assert len(entry["version"]) == 16
        assert sum(last["outcomes"].values()) == 12
        assert last["disk"]["per_episode"] > 1000

    @pytest.mark.soak
    def test_makes_the_same_bytes_as_one_without_a_view(self, tmp_path: Path) -> None:
        watched, plain = tmp_path / "watched.zarr", tmp_path / "plain.zarr"
        with running(watched, 6) as run:
            run.until(run.state)
            run.until(lambda: run.state()["phase"] != "running")
            assert run.wait() == 0
        command = [sys.executable, "-m", "grasp_factory", "generate", "--n", "6", *SMALL, *ALONE]
        subprocess.run([*command, "--out", str(plain), "--quiet"], check=True)
        assert_same_tree(watched, plain)

    @pytest.mark.soak
    def test_rings_when_its_images_are_black(self, tmp_path: Path) -> None:
        light = [f"randomize.looks.{name}=[0,0]" for name in ("ambient", "diffuse", "specular")]
        dark = [part for one in light for part in ("--set", one)]
        with running(tmp_path / "ds.zarr", 4, [*SMALL, *ALONE, *dark]) as run:
            alarms = run.until(lambda: run.state()["alarms"])
            assert run.until(lambda: "alarm (image): front after is black" in run.err)
            run.until(lambda: run.state()["phase"] != "running")  # which the run waits for
            assert run.wait() == 0
        (alarm,) = [alarm for alarm in alarms if alarm["kind"] == "image"]
        assert alarm["until"] is None
        assert set(alarm["rows"]) <= set(range(4))

    @pytest.mark.soak
    def test_rings_once_when_all_is_quarantined(self, tmp_path: Path) -> None:
        strict = ["--set", "quality.min_sharpness=1", "--set", "quality.min_score=5"]
        options = [*SMALL, *ALONE, *strict, "--max-failures", "1"]
        with running(tmp_path / "ds.zarr", 2 * FEWEST_QUARANTINED, options) as run:
            run.until(lambda: run.state()["phase"] != "running")
            last = run.state()
            assert run.wait() == 0
            assert run.err.count("alarm (quarantine)") == 1
        assert [alarm["kind"] for alarm in last["alarms"]] == ["quarantine"]
        assert {entry["outcome"] for entry in last["latest"]} == {"quarantined"}
        assert all("sharpness" in entry["error"] for entry in last["latest"])

    @pytest.mark.soak
    def test_stops_by_ctrl_c_as_fast_as_ever_and_goes_on(self, tmp_path: Path) -> None:
        out = tmp_path / "ds.zarr"
        with running(out, 40) as run:
            run.until(lambda: run.state()["latest"])
            asked = time.monotonic()
            run.process.send_signal(signal.SIGINT)
            assert run.wait() == 130
            assert time.monotonic() - asked < 10.0
            last_line = run.err.splitlines()[-1]
            assert last_line.startswith("Stopped: ")
            assert last_line.endswith("run the same command again to continue.")
            assert "Traceback" not in run.err
        there = len(Dataset(out).committed)
        with running(out, there + 1) as run:
            assert run.wait() == 0
        assert len(Dataset(out).committed) > there


class TestTheOptions:
    def refused(self, *args: str) -> str:
        command = [sys.executable, "-m", "grasp_factory", "generate", *args]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.count("\n") == 1
        return done.stderr

    def test_refuse_a_port_without_a_view_and_a_view_of_nothing(self) -> None:
        assert "add --live" in self.refused("--live-port", "9000")
        assert "leave out --dry-run" in self.refused("--live", "--dry-run")
        assert "and --print-config" in self.refused("--live", "--print-config")

    def test_refuse_a_port_that_is_taken_before_anything_is_made(self, tmp_path: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = str(taken.getsockname()[1])
            out = tmp_path / "ds.zarr"
            said = self.refused("--live", "--live-port", port, "--out", str(out), "--n", "1")
        assert f"--live-port {port}: something else listens there" in said
        assert list(tmp_path.iterdir()) == []

    def test_say_what_is_missing_before_anything_is_made(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
        with pytest.raises(UsageError, match=r"flask.*pip install 'grasp-factory\[browse\]'"):
            live_view(None, quiet=False)

    def test_take_the_next_port_if_the_default_is_taken(self) -> None:
        told: list[str] = []
        with (
            LiveView(None, tell=told.append, announce=told.append) as one,
            LiveView(None, tell=told.append, announce=told.append) as other,
        ):
            ports = {view._socket.getsockname()[1] for view in (one, other) if view._socket}
        assert len(ports) == 2
        assert told == []


class TestAViewThatFails:
    """Whatever happens to it, the run goes on, and is told once."""

    @pytest.fixture
    def told(self) -> list[str]:
        return []

    def make(self, tmp_path: Path, told: list[str]) -> int:
        with LiveView(None, tell=told.append, announce=told.append) as view:
            summary = generate(
                small_config(), 6, tmp_path / "ds.zarr", workers=1,
                on_start=view.start, on_episode=view.episode, on_loss=view.loss,
            )  # fmt: skip
            view.loss("a worker was lost")
        return summary.made

    @pytest.fixture(autouse=True)
    def pretend(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def simulate(world: World, spec: EpisodeSpec) -> Episode:
            time.sleep(0.05)  # so that the watch looks meanwhile
            return replace(make_episode(small_config(), spec.index), spec=spec)

        monkeypatch.setattr(block_maker, "run_episode", simulate)
        monkeypatch.setattr(watch, "STEP_S", 0.05)

    def test_by_its_facts(
        self, tmp_path: Path, told: list[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fail(*_: object) -> None:
            raise ValueError("no facts\ntoday")

        monkeypatch.setattr(BlockFacts, "read", fail)
        assert self.make(tmp_path, told) == 6
        address, trouble = told
        assert address.startswith("Live view: http://127.0.0.1:")
        want = "the live view cannot follow all of the run (ValueError: no facts today)"
        assert trouble == f"{want}; the run goes on"

    def test_by_its_index(
        self, tmp_path: Path, told: list[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fail(*_: object) -> None:
            raise OSError("no room")

        monkeypatch.setattr(index_package, "fresh", fail)
        assert self.make(tmp_path, told) == 6
        assert "the live view cannot be served (OSError: no room); the run goes on" in told

    def test_by_its_start(
        self, tmp_path: Path, told: list[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fail(*_: object) -> None:
            raise RuntimeError("can't start new thread")

        monkeypatch.setattr(RunWatch, "begin", fail)
        assert self.make(tmp_path, told) == 6
        assert "cannot be started (RuntimeError: can't start new thread)" in told[0]

    def test_not_at_all(self, tmp_path: Path, told: list[str]) -> None:
        assert self.make(tmp_path, told) == 6
        assert [line for line in told if "alarm" not in line and "Live view" not in line] == []

    def test_or_is_not_needed(self, tmp_path: Path, told: list[str]) -> None:
        assert self.make(tmp_path, told) == 6
        told.clear()
        assert self.make(tmp_path, told) == 0
        assert told == []
