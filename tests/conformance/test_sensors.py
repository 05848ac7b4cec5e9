"""What every sensor of the table must do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from pkgutil import iter_modules, resolve_name
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.scenes import SMALL, cube_spec, tick

from grasp_factory.core import schema
from grasp_factory.core.episode import Episode
from grasp_factory.core.sensors import SENSORS, SensorModel, series_groups
from grasp_factory.simulation import sensors as folder
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.scene import Scene, build_scene
from grasp_factory.simulation.sensors import Sensor, make_sensor, make_sensors
from grasp_factory.simulation.world import World

ROBOT, CUBE = 2, 3
"""Bodies, in the order in which the scene is built: floor, table, robot, object."""
SPEC = cube_spec(video_hz=10, resolution=(64, 48))
SIZES = {**schema.sizes(SMALL, joints=7), "W": 64, "H": 48}
GROUPS = {group.name: group for group in series_groups() if not group.is_real}

Arrays = Mapping[str, NDArray[Any]]


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World() as world:
        yield world


@pytest.fixture(scope="module")
def episodes() -> tuple[Episode, Episode]:
    """Two runs of one recipe, each in its own world."""
    with World() as first, World() as second:
        return run_episode(first, SPEC), run_episode(second, SPEC)


def a_scene(world: World) -> Scene:
    scene = build_scene(world, SPEC)
    scene.robot.listen(True)
    return scene


def fields_of(model: SensorModel) -> dict[str, schema.Field]:
    """Return a sensor's fields by their name within the group, one for each camera."""
    return {
        field.path.format(camera=camera).removeprefix(f"{model.group.name}/"): field
        for field in model.fields
        for camera in SPEC.cameras
    }


def recorded(episode: Episode, model: SensorModel) -> dict[str, NDArray[Any]]:
    return {name: episode.series[model.group.name][name] for name in fields_of(model)}


@pytest.mark.parametrize("model", SENSORS.values(), ids=SENSORS)
class TestSensor:
    def test_its_class_is_a_sensor(self, model: SensorModel) -> None:
        assert issubclass(resolve_name(model.implementation), Sensor)

    def test_its_fields_are_in_its_group_and_in_the_schema(self, model: SensorModel) -> None:
        assert model.fields
        assert set(model.fields) <= set(schema.FIELDS)
        for field in model.fields:
            assert field.path.startswith(f"{model.group.name}/")
            is_series = field.dims[0] == model.group.dim
            assert field.length_column == (model.group.length_column if is_series else "")

    @pytest.mark.parametrize("samples", [0, 1, 7])
    def test_its_arrays_are_those_of_its_fields(
        self, world: World, model: SensorModel, samples: int
    ) -> None:
        scene = a_scene(world)
        sensor = make_sensor(model, scene)
        for k in range(1, samples + 1):
            world.step()
            sensor.sample(tick(scene, timestamp=k / model.group.rate(SPEC)))
        arrays, fields = sensor.arrays(), fields_of(model)
        assert set(arrays) == set(fields)
        for name, values in arrays.items():
            shape = schema.shape(fields[name], SIZES | {model.group.dim: samples})
            assert (values.shape, values.dtype.name) == (shape, fields[name].dtype), name

    def test_sampling_does_not_change_what_happens_next(
        self, world: World, model: SensorModel
    ) -> None:
        def fall(*, with_sensor: bool) -> object:
            scene = a_scene(world)
            sensor = make_sensor(model, scene)
            for _ in range(60):
                world.step()
                if with_sensor:
                    sensor.sample(tick(scene))
            return world.joint_states(ROBOT, [0, 1]), world.com_frame(CUBE)

        assert fall(with_sensor=True) == fall(with_sensor=False)

    def test_two_runs_record_the_same_bytes(
        self, episodes: tuple[Episode, Episode], model: SensorModel
    ) -> None:
        first, second = (recorded(episode, model) for episode in episodes)
        for name, values in first.items():
            assert values.tobytes() == second[name].tobytes(), name

    def test_its_series_are_as_long_as_its_clock_and_fit_into_the_store(
        self, episodes: tuple[Episode, Episode], model: SensorModel
    ) -> None:
        samples = len(episodes[0].series[model.group.name]["timestamp"])
        lengths = {
            len(recorded(episodes[0], model)[name])
            for name, field in fields_of(model).items()
            if field.length_column
        }
        assert lengths == {samples}
        assert samples <= model.group.rate(SPEC) * SMALL.longest_s

    def test_it_is_left_out_where_its_rate_is_zero(self, world: World, model: SensorModel) -> None:
        scene = build_scene(world, cube_spec(video_hz=0))
        assert (model.name in make_sensors(scene)) is bool(model.group.rate(scene.spec))


@pytest.mark.parametrize("name", GROUPS)
class TestGroup:
    def test_its_samples_are_evenly_spaced_at_its_rate_from_the_start_to_the_end(
        self, episodes: tuple[Episode, Episode], name: str
    ) -> None:
        rate, times = GROUPS[name].rate(SPEC), episodes[0].series[name]["timestamp"]
        assert times == pytest.approx(np.arange(1, len(times) + 1) / rate, abs=1e-9)
        end = episodes[0].streams["timestamp"][-1]
        assert abs(times[-1] - end) < max(1.0 / rate, 1.0 / SPEC.record_hz)

    def test_one_sensor_records_its_clock(self, name: str) -> None:
        paths = [field.path for model in SENSORS.values() for field in model.fields]
        assert paths.count(f"{name}/timestamp") == 1

    def test_its_capacity_holds_the_longest_attempt(self, name: str) -> None:
        group = GROUPS[name]
        assert group.longest(SMALL) >= int(SMALL.longest_s * group.rate(SMALL))


def test_groups_share_no_name_no_dimension_and_no_column() -> None:
    fixed = [*"JMAPHW", "episodes", "cameras"]
    words = [w for group in GROUPS.values() for w in (group.name, group.dim, group.count)]
    assert [word for word, times in Counter(words + fixed).items() if times > 1] == []


def test_no_array_belongs_to_two_sensors() -> None:
    paths = [field.path for model in SENSORS.values() for field in model.fields]
    assert len(set(paths)) == len(paths)


def test_sensors_record_all_series_but_the_reward() -> None:
    paths = {field.path for model in SENSORS.values() for field in model.fields}
    of_series = {row.path for row in schema.FIELDS if row.length_column and not row.is_real}
    assert of_series - paths == {"streams/reward"}


def test_every_file_of_the_folder_has_a_row() -> None:
    modules = {module.name for module in iter_modules([str(Path(folder.__file__).parent)])}
    named = {m.implementation.partition(":")[0].rpartition(".")[2] for m in SENSORS.values()}
    assert modules - named == {"base", "plugin"}
