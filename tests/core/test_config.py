"""Config, records and requests: what goes in comes out, and what is wrong is said exactly."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from support.fake_episodes import make_spec, small_config

from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.config.motion import MotionConfig
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.config.yaml_loader import parse_yaml, read_yaml
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.errors import ConfigError
from grasp_factory.factory.run_request import MAX_EPISODES, MAX_WORKERS, Request, resolve_request

EVERYTHING_ELSE = {
    "seed": 2**63 - 1,
    "robot": "panda",
    "policies": {"uniform": 0.5},
    "object_sets": {"classic": 2.0},
    "object_splits": ["train", "test"],
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


def test_the_order_of_splits_says_nothing() -> None:
    a, b = (FactoryConfig(object_splits=splits) for splits in (("test", "val"), ("val", "test")))
    assert a == b
    assert a.sha256() == b.sha256() != FactoryConfig().sha256()


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
    ({"object_splits": "test"}, "object_splits: expected a list, got 'test'"),
    ({"object_splits": []}, "object_splits: got [], valid: some of train, val, test, each once"),
    ({"object_splits": ["tset"]}, "object_splits: got ['tset'], valid: some of train, val, test"),
    ({"object_splits": ["val", "val"]}, "object_splits: got ['val', 'val'], valid: some of"),
    ({"cameras": {"a b": {"eye": [1, 0, 1], "target": [0, 0, 0]}}}, "cameras: got 'a b', valid:"),
    ({"cameras": {"c" * 65: {"eye": [1, 0, 1], "target": [0, 0, 0]}}}, "cameras: got 'ccc"),
    ({"cameras": {"ü" * 33: {"eye": [1, 0, 1], "target": [0, 0, 0]}}}, "cameras: got 'üüü"),
    ({"object_folders": {"a/../b": "0" * 64}}, "object_folders: got 'a/../b', valid: names of"),
    ({"object_folders": {"x" * 65: "0" * 64}}, "object_folders: got 'xxx"),
    (
        {"policies": {"x" * 65: 1.0}, "policy_parameters": {"x" * 65: {"model": "0" * 64}}},
        "models: got 'xxx",
    ),
    ({"cameras": {"c": {"eye": [1, 0, 1]}}}, "missing key 'cameras.c.target'"),
    ({"cameras": {"c": {"eye": [0, 0, 1], "target": [0, 0, 0]}}}, "cameras.c.up: got"),
    ({"motion": {"grip_force": float("nan")}}, "motion.grip_force: expected a finite number"),
    ({"motion": {"hold_s": 99}}, "motion.hold_s: got 99.0, valid: 0.1 to 3.0 s"),
    ({"record_hz": 50}, "record_hz: got 50, valid: a divisor of physics.free_hz (240)"),
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
        (b"a: 0x" + b"f" * 300, "an integer of 1200 bits, valid: up to 1024"),
        (b"a: 0x" + b"f" * 50_000, "an integer of more than 1032 characters"),
        (b"a: 1" + b":1" * 450_000, "an integer of more than 1032 characters"),
        (b"a: [" + b"1," * 30_000 + b"}", "more than 20000 values"),
        ("seed: 3 # é".encode() * 100_000, "is no config: it has more than 1000000 bytes"),
    ],
    ids=[
        *("absent", "no YAML", "a list", "no text", "code", "a large number", "a huge number"),
        *("a huge number in base 60", "many values", "large"),
    ],
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


def test_a_file_without_an_end_is_no_config() -> None:
    with pytest.raises(ConfigError, match="/dev/zero is no config: it has more than 1000000 bytes"):
        read_yaml(Path("/dev/zero"))


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


def test_an_assignment_may_be_the_first_to_name_a_policys_settings() -> None:
    config = resolve_request({}, {}, ["policy_parameters.uniform.aim_noise=0.01"]).config
    assert config.policy_parameters == {"uniform": {"aim_noise": 0.01}}
    file = {"policy_parameters": {"uniform": {"aim_noise": 0.02}}}
    config = resolve_request(file, {}, ["policy_parameters.top_down.opening_margin=0.01"]).config
    assert config.policy_parameters["uniform"] == {"aim_noise": 0.02}
    assert config.policy_parameters["top_down"] == {"opening_margin": 0.01}


def test_settings_that_hold_only_together_are_checked_together() -> None:
    config = resolve_request(
        {"record_hz": 100}, {}, ["physics.free_hz=200", "physics.contact_hz=1000"]
    )
    assert config.config.record_hz == 100


def test_a_request_survives_its_own_yaml() -> None:
    request = resolve_request({}, {"n": 7, "out": "some where.zarr"}, ["motion.grip_force=30"])
    assert resolve_request(yaml.safe_load(request.to_yaml()), {}) == request


def test_a_preset_of_the_physics_changes_what_it_names_and_no_more() -> None:
    request = resolve_request({}, {"physics": PHYSICS_PRESETS["fast"]})
    usual = FactoryConfig().physics
    fast = {"contact_hz": 240, "contact_iterations": 50, "motor_iterations": 1}
    assert request.config.physics == dataclasses.replace(usual, **fast)


REQUESTS = [
    ({"n": 0}, [], f"n: got 0, valid: an integer from 1 to {MAX_EPISODES}"),
    ({"n": True}, [], "n: got True, valid: an integer"),
    ({"n": 2.0}, [], "n: got 2.0, valid: an integer"),
    ({"n": MAX_EPISODES + 1}, [], f"n: got {MAX_EPISODES + 1}, valid"),
    ({"workers": 0}, [], f"workers: got 0, valid: an integer from 1 to {MAX_WORKERS}"),
    ({"out": ""}, [], "out: got '', valid: a path"),
    ({"out": 3}, [], "out: got 3, valid: a path"),
    (
        {"workres": 3},
        [],
        "unknown key 'workres'; did you mean 'workers'? (valid: n, workers, executor, out",
    ),
    ({"physics": 3}, [], "physics: expected a mapping of keys, got 3"),
    ({}, ["seed"], "--set 'seed': expected KEY=VALUE"),
    ({}, [".seed=1"], "--set '.seed=1': expected KEY=VALUE"),
    ({}, ["seed=["], "--set 'seed=[': '[' is not valid YAML: line 1: "),
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


HOSTILE = [
    "2001-99-99",
    "!!int foo",
    "!!int ''",
    "!!float foo",
    "!!bool foo",
    "!!timestamp foo",
    "!!binary x",
    "!!python/name:os.getcwd",
    "9" * 5000,
    "[" * 5000,
    "[" * 60 + "]" * 60,
    "&a [*a]",
    "{a: 1, a: 2}",
    "'\0'",
    r'"\ud800"',
    "\0",
]


@pytest.mark.slow
@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: text[:20])
def test_whatever_stands_where_yaml_should_is_an_error_of_one_short_line(
    tmp_path: Path, text: str
) -> None:
    file = tmp_path / "c.yaml"
    file.write_text(f"seed: {text}\n")
    reads: list[Callable[[], Any]] = [
        lambda: FactoryConfig.from_plain(read_yaml(file)),
        lambda: resolve_request({}, {}, [f"seed={text}"]),
    ]
    for read in reads:
        with pytest.raises(ConfigError) as caught:
            read()
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 600


def test_an_anchor_bomb_is_refused_at_once() -> None:
    rows = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    with pytest.raises(ConfigError, match="more than 20000 values, counting what its aliases"):
        parse_yaml("\n".join(rows), "this")


def test_depth_counts_through_aliases() -> None:
    rows = ["a0: &a0 [1]"]
    rows += [f"a{i}: &a{i} {'[' * 30}*a{i - 1}{']' * 30}" for i in range(1, 4)]
    with pytest.raises(ConfigError, match="nested more than 40 levels deep"):
        parse_yaml("\n".join(rows), "this")


def test_merge_keys_and_aliases_of_common_size_are_read() -> None:
    text = "a: &a {x: 1, y: 2}\nb:\n  <<: *a\n  y: 3\nc: *a\n"
    assert parse_yaml(text, "this") == {
        "a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": {"x": 1, "y": 2}
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "number"), [("1e-3", 1e-3), ("2E4", 2e4), (".5e1", 5.0), ("-1.e+2", -100.0)]
)
def test_numbers_with_an_exponent_are_numbers(text: str, number: float) -> None:
    assert parse_yaml(text, "this") == number
    assert isinstance(parse_yaml(text, "this"), float)
    assert parse_yaml(f"'{text}'", "this") == text


def test_a_key_that_is_there_twice_is_named_with_its_line() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_yaml("seed: 1\nn: 2\nseed: 3\n", "this")
    assert str(caught.value) == (
        "this is not valid YAML: line 3: key 'seed' is there twice; keep one of them"
    )


HUGE = "x" * 600_000


@pytest.mark.parametrize(
    "data",
    [
        {"seed": HUGE},
        {HUGE: 1},
        {"policies": {HUGE: "x"}},
        {"policies": [HUGE] * 100},
        {"seed": 10**5000},
        {"motion": {"grip_force": 10**400}},
        {"motion": {"grip_force": -(10**5000)}},
        {"resolution": [10**5000, 480]},
        {"cameras": {HUGE: {}}},
        {"policies": {HUGE: 0}},
        [[HUGE] * 100] * 100,
    ],
    ids=range(11),
)
def test_an_error_stays_short_whatever_the_value(data: Any) -> None:
    with pytest.raises(ConfigError) as caught:
        FactoryConfig.from_plain(data)
    assert len(str(caught.value)) < 1500


def test_an_assignment_changes_one_of_two_settings_that_share_an_alias() -> None:
    file = parse_yaml("cameras: {a: &c {eye: [1, 0, 1], target: [0, 0, 0]}, b: *c}", "this")
    config = resolve_request(file, {}, ["cameras.a.fov_y_deg=33"]).config
    assert (config.cameras["a"].fov_y_deg, config.cameras["b"].fov_y_deg) == (33.0, 45.0)
    assert "fov_y_deg" not in file["cameras"]["a"]


def test_a_resolution_may_be_written_as_on_the_command_line() -> None:
    assert resolve_request({"resolution": "64x48"}, {}).config.resolution == (64, 48)
    with pytest.raises(ConfigError, match="'64 by 48': expected WIDTHxHEIGHT"):
        resolve_request({"resolution": "64 by 48"}, {})


EQUAL: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({"policies": {"uniform": 1}}, {"policies": {"uniform": 1.0}}),
    ({"resolution": [64, 48]}, {"resolution": (64, 48)}),
    ({"seed": np.int64(3)}, {"seed": 3}),
    ({"object_sets": {"blobs": np.float32(0.5)}}, {"object_sets": {"blobs": 0.5}}),
    ({"motion": MotionConfig(grip_force=30)}, {"motion": MotionConfig(grip_force=30.0)}),
    ({"motion": {"grip_force": 30}}, {"motion": MotionConfig(grip_force=30.0)}),
    (
        {"policy_parameters": {"uniform": {"x": 1, "y": (2.0, np.int8(3))}}},
        {"policy_parameters": {"uniform": {"x": 1.0, "y": [2, 3]}}},
    ),
]


@pytest.mark.parametrize(("a", "b"), EQUAL, ids=range(len(EQUAL)))
def test_equal_configs_have_one_hash_however_they_were_built(
    a: dict[str, Any], b: dict[str, Any]
) -> None:
    one, other = FactoryConfig(**a), FactoryConfig(**b)
    assert one == other
    assert one.sha256() == other.sha256()
    assert FactoryConfig.from_plain(json.loads(json.dumps(one.to_plain()))) == other
    assert one.sha256() == FactoryConfig.from_plain(one.to_plain()).sha256()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"seed": 1.5}, "seed: expected an integer, got 1.5"),
        ({"seed": True}, "seed: expected an integer, got True"),
        ({"seed": np.True_}, "seed: expected an integer, got "),
        ({"seed": "3"}, "seed: expected an integer, got '3'"),
        ({"policies": {"a": math.inf}}, "policies.a: expected a finite number, got inf"),
        ({"policies": {"a": 1e308, "b": 1e308}}, "policies: got {'a': 1e+308, 'b': 1e+308}, valid: "
                                                 "weights whose sum is a finite number"),
        ({"resolution": 640}, "resolution: expected a list, got 640"),
        ({"motion": 3}, "motion: expected a mapping of keys, got 3"),
        ({"record_hz": None}, "record_hz: expected an integer, got None"),
    ],
    ids=str,
)  # fmt: skip
def test_a_config_built_in_python_is_checked_like_one_from_a_file(
    change: dict[str, Any], text: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        FactoryConfig(**change)
    assert str(caught.value).startswith(text)


def test_parameters_within_themselves_are_refused() -> None:
    loop: dict[str, Any] = {}
    loop["uniform"] = loop
    with pytest.raises(ConfigError, match="nested too deeply"):
        FactoryConfig(policy_parameters=loop)


def test_a_config_does_not_follow_what_it_was_built_from() -> None:
    weights = {"uniform": 1.0}
    config = FactoryConfig(policies=weights)
    weights["uniform"] = 2.0
    assert config.policies == {"uniform": 1.0}


def test_a_request_takes_numpys_integers() -> None:
    request = Request(config=FactoryConfig(), n=np.int64(2), workers=np.int8(1))  # type: ignore[arg-type]
    assert (type(request.n), type(request.workers)) == (int, int)


def test_the_default_request_is_valid() -> None:
    assert resolve_request({}, {}) == Request(config=FactoryConfig())


def test_a_label_says_in_words_what_it_asks_for_and_no_more() -> None:
    assert list(LabelConfig(min_shake=0.0).conditions()) == ["min_lift"]
    strict = LabelConfig(min_grip_force=2.5, max_slip_distance=0.0, max_slip_angle=0.1)
    assert strict.conditions() == {
        "min_lift": (
            "at the end of the hold the target's centre of mass is at least 0.1 m above its rest"
        ),
        "min_shake": "the target stays in the hand through a shake of 1 g",
        "min_grip_force": "neither pad presses with less than 2.5 N during the hold",
        "max_slip_distance": "the target's centre of mass moves at most 0 m in the hand",
        "max_slip_angle": "the target turns at most 0.1 rad in the hand",
    }
