"""Config, records and requests: what goes in comes out, and what is wrong is said exactly."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from fake_episodes import make_spec, small_config

from grasp_factory.config import FactoryConfig, first_difference, read_yaml
from grasp_factory.episode import EpisodeSpec
from grasp_factory.errors import ConfigError
from grasp_factory.request import MAX_EPISODES, MAX_WORKERS, Request, resolve_request

EVERYTHING_ELSE = {
    "seed": 2**63 - 1,
    "robot": "panda",
    "policies": {"uniform": 0.5},
    "object_sets": {"classic": 2.0},
    "cameras": {"wrist": {"eye": [1.0, 0.5, 0.5], "target": [0.0, 0.0, 0.0], "fov_y_deg": 60.0}},
    "resolution": [16, 4096],
    "record_hz": 60,
    "block_size": 3,
    "physics": {"free_hz": 120},
    "motion": {"grip_force": 35.5},
}


@pytest.mark.parametrize("data", [{}, EVERYTHING_ELSE], ids=["default", "everything else"])
def test_a_config_survives_plain_data_json_and_yaml(data: dict[str, Any]) -> None:
    config = FactoryConfig.from_plain(data)
    plain = config.to_plain()
    for copy in (plain, json.loads(json.dumps(plain)), yaml.safe_load(yaml.safe_dump(plain))):
        assert FactoryConfig.from_plain(copy) == config
        assert FactoryConfig.from_plain(copy).sha256() == config.sha256()


def test_keys_that_are_not_given_take_their_defaults() -> None:
    config = FactoryConfig.from_plain(EVERYTHING_ELSE)
    assert config.workspace == FactoryConfig().workspace
    assert config.physics.contact_hz == FactoryConfig().physics.contact_hz
    assert config.cameras["wrist"].near == 0.1


def test_the_hash_follows_the_content_and_not_the_order_of_keys() -> None:
    a = FactoryConfig.from_plain({"seed": 3, "policies": {"uniform": 1, "top_down": 2}})
    b = FactoryConfig.from_plain({"policies": {"top_down": 2.0, "uniform": 1.0}, "seed": 3})
    assert a.sha256() == b.sha256() != FactoryConfig(seed=3).sha256()


def test_a_spec_survives_json() -> None:
    spec = make_spec(small_config(), 5)
    assert EpisodeSpec.from_json(spec.to_json()) == spec


def test_a_config_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        FactoryConfig().seed = 1  # type: ignore[misc]


WRONG: list[tuple[Any, str]] = [
    (3, "config: expected a mapping of keys, got 3"),
    ({"sede": 1}, "unknown key 'sede'; did you mean 'seed'? (valid: seed, robot,"),
    ({"zzz": 1}, "unknown key 'zzz' (valid: seed,"),
    ({"physics": {"fre_hz": 1}}, "unknown key 'physics.fre_hz'; did you mean 'free_hz'?"),
    ({"seed": True}, "seed: expected an integer, got True"),
    ({"seed": 1.0}, "seed: expected an integer, got 1.0"),
    ({"seed": None}, "seed: expected an integer, got None"),
    ({"seed": -1}, "seed: got -1, valid: 0 to 9223372036854775807"),
    ({"seed": 2**63}, "seed: got 9223372036854775808, valid: 0 to"),
    ({"robot": 7}, "robot: expected a string, got 7"),
    ({"resolution": [640]}, "resolution: expected 2 values, got 1 in [640]"),
    ({"resolution": "640x480"}, "resolution: expected a list, got '640x480'"),
    ({"resolution": [15, 480]}, "resolution: got [15, 480], valid: 16 to 4096 pixels a side"),
    ({"policies": {}}, "policies: got {}, valid: names with weights >= 0, at least one above 0"),
    ({"policies": {"uniform": 0}}, "policies: got {'uniform': 0.0}, valid: names with weights"),
    ({"policies": {"uniform": "2"}}, "policies.uniform: expected a number, got '2'"),
    ({"policies": ["uniform"]}, "policies: expected a mapping, got ['uniform']"),
    ({"cameras": {"a b": {"eye": [1, 0, 1], "target": [0, 0, 0]}}}, "cameras: got 'a b', valid:"),
    ({"cameras": {"c": {"eye": [1, 0, 1]}}}, "missing key 'cameras.c.target'"),
    ({"cameras": {"c": {"eye": [0, 0, 1], "target": [0, 0, 0]}}}, "cameras.c.up: got"),
    ({"motion": {"grip_force": float("nan")}}, "motion.grip_force: expected a finite number"),
    ({"motion": {"hold_s": 99}}, "motion.hold_s: got 99.0, valid: 0.1 to 3.0 s"),
    ({"record_hz": 7}, "record_hz: got 7, valid: a divisor of physics.free_hz (240)"),
    ({"label": {"min_lift": 0.3}}, "label.min_lift: got 0.3, valid: less than motion.lift_height"),
]


@pytest.mark.parametrize(("data", "text"), WRONG, ids=[text[:40] for _, text in WRONG])
def test_what_is_wrong_in_a_config_is_said_exactly(data: Any, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        FactoryConfig.from_plain(data)
    assert str(caught.value).startswith(text)
    assert "\n" not in str(caught.value)


def test_a_yaml_file_is_read_as_a_mapping(tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_text("seed: 3\nphysics: {free_hz: 480}\n")
    assert read_yaml(file) == {"seed": 3, "physics": {"free_hz": 480}}
    file.write_text("# nothing yet\n")
    assert read_yaml(file) == {}


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "cannot be read: "),
        (b"a: [", "is not valid YAML: "),
        (b"- 1", "expected a mapping of keys, got [1]"),
        (b"a: \xff", "cannot be read: "),
        (b"a: !!python/object/apply:os.getcwd []", "is not valid YAML: "),
    ],
    ids=["absent", "no YAML", "a list", "no text", "code"],
)
def test_a_file_that_is_no_config_is_named(
    tmp_path: Path, content: bytes | None, text: str
) -> None:
    file = tmp_path / "c.yaml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"c\.yaml") as caught:
        read_yaml(file)
    assert text in str(caught.value)


def test_the_first_difference_is_named_with_both_values() -> None:
    a, b = FactoryConfig().to_plain(), FactoryConfig(seed=4).to_plain()
    assert first_difference(a, b) == "seed: 0 against 4"
    assert first_difference(a, a) is None
    assert first_difference({"x": {"y": 1}}, {"x": {}}) == "x.y: 1 against 'absent'"


def test_flags_win_over_the_file_and_assignments_over_flags() -> None:
    file = {"seed": 1, "n": 10, "workers": 3, "robot": "panda"}
    request = resolve_request(file, {"seed": 2, "n": 20}, ["seed=3"])
    assert (request.config.seed, request.n, request.workers) == (3, 20, 3)
    assert request.config.robot == "panda"


def test_a_section_is_merged_and_a_table_of_names_is_replaced() -> None:
    file = {"physics": {"free_hz": 480}, "policies": {"top_down": 1.0}}
    config = resolve_request(file, {}, ["physics.contact_hz=480"]).config
    assert (config.physics.free_hz, config.physics.contact_hz) == (480, 480)
    assert config.policies == {"top_down": 1.0}


def test_an_assignment_reaches_into_a_default_camera() -> None:
    config = resolve_request({}, {}, ["cameras.front.eye=[1.5, 0.1, 0.7]"]).config
    assert config.cameras["front"].eye == (1.5, 0.1, 0.7)
    assert config.cameras["front"].target == FactoryConfig().cameras["front"].target


def test_settings_that_hold_only_together_are_checked_together() -> None:
    config = resolve_request(
        {"record_hz": 100}, {}, ["physics.free_hz=200", "physics.contact_hz=1000"]
    )
    assert config.config.record_hz == 100


def test_a_request_survives_its_own_yaml() -> None:
    request = resolve_request({}, {"n": 7, "out": "some where.zarr"}, ["motion.grip_force=30"])
    assert resolve_request(yaml.safe_load(request.to_yaml()), {}) == request


REQUESTS = [
    ({"n": 0}, [], f"n: got 0, valid: an integer from 1 to {MAX_EPISODES}"),
    ({"n": True}, [], "n: got True, valid: an integer"),
    ({"n": 2.0}, [], "n: got 2.0, valid: an integer"),
    ({"n": MAX_EPISODES + 1}, [], f"n: got {MAX_EPISODES + 1}, valid"),
    ({"workers": 0}, [], f"workers: got 0, valid: an integer from 1 to {MAX_WORKERS}"),
    ({"out": ""}, [], "out: got '', valid: a path"),
    ({"out": 3}, [], "out: got 3, valid: a path"),
    ({"workres": 3}, [], "unknown key 'workres'; did you mean 'workers'? (valid: n, workers, out"),
    ({"physics": 3}, [], "physics: expected a mapping of keys, got 3"),
    ({}, ["seed"], "--set 'seed': expected KEY=VALUE"),
    ({}, [".seed=1"], "--set '.seed=1': expected KEY=VALUE"),
    ({}, ["seed=["], "--set 'seed=[': '[' is not a YAML value"),
    ({}, ["seed.x=1"], "--set 'seed.x=1': seed has no keys"),
    ({}, ["cameras.top.eye=1"], "--set 'cameras.top.eye=1': cameras.top has no keys"),
    ({}, ["sed=1"], "unknown key 'sed'; did you mean 'seed'?"),
    ({}, ["motion.gripforce=1"], "unknown key 'motion.gripforce'; did you mean 'grip_force'?"),
]


@pytest.mark.parametrize(("file", "assignments", "text"), REQUESTS, ids=[r[2] for r in REQUESTS])
def test_what_is_wrong_in_a_request_is_said_exactly(
    file: dict[str, Any], assignments: list[str], text: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        resolve_request(file, {}, assignments)
    assert str(caught.value).startswith(text)


def test_the_default_request_is_valid() -> None:
    assert resolve_request({}, {}) == Request(config=FactoryConfig())
