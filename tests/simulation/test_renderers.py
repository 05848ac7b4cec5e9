"""The renderers against each other, and what each promises."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import small_config
from support.scenes import SMALL, cube_spec, take_images
from support.worlds import world_of

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.randomization import (
    BodyRange,
    ColorRange,
    LooksConfig,
    RandomizeConfig,
)
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraImage, EpisodeSpec
from grasp_factory.core.renderer import Renderer
from grasp_factory.curation.replay import replay
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import (
    ConfigError,
    GraspFactoryError,
    RecipeError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_request import resolve_request
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.robots import ROBOTS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.scene import build_scene, render_cameras, settle, take_shots
from grasp_factory.simulation.world import World
from grasp_factory.simulation.world.connection import check_renderer
from grasp_factory.writers.zarr.header import read_attributes
from grasp_factory.writers.zarr.store import check_place, prepare_store

pytestmark = pytest.mark.slow

EGL = {"renderer": "egl"}
CROWD = dataclasses.replace(
    SMALL,
    object_sets=dict.fromkeys(OBJECT_SETS, 1.0),
    cameras={name: camera.config for name, camera in CAMERAS.items()},
    clutter=ClutterConfig(count=4),
    randomize=RandomizeConfig(
        looks=LooksConfig(
            object_color=ColorRange(share=0.9),
            table_color=ColorRange(share=0.9),
            light_azimuth_deg=(-180.0, 180.0),
        ),
        objects=BodyRange(scale=(0.6, 1.2)),
    ),
)
"""Many things, in sizes and colours of their own; no textures, which OpenGL does not show."""


@pytest.fixture(scope="module")
def tiny() -> Iterator[World]:
    with World() as world:
        yield world


@pytest.fixture
def egl() -> Iterator[World]:
    with world_of(Renderer.EGL) as world:
        yield world


@pytest.fixture
def opengl() -> None:
    world_of(Renderer.EGL).close()


def crowd(index: int, robot: str = "kuka_iiwa") -> EpisodeSpec:
    return dataclasses.replace(sample_spec(CROWD, index), robot=robot)


def images_of(world: World, spec: EpisodeSpec) -> dict[str, CameraImage]:
    scene = build_scene(world, spec)
    settle(scene)
    return take_images(scene)


def are_equal(a: CameraImage, b: CameraImage) -> bool:
    return all(
        np.array_equal(getattr(a, kind), getattr(b, kind))
        for kind in ("rgb", "depth", "segmentation", "intrinsics", "T_world_camera")
    )


class TestConfig:
    def test_tiny_is_the_default_and_the_other_one_gives_another_hash(self) -> None:
        assert FactoryConfig().renderer is Renderer.TINY
        config = FactoryConfig.from_plain(EGL)
        assert config.renderer is Renderer.EGL
        assert FactoryConfig.from_plain(config.to_plain()) == config
        assert config.sha256() != FactoryConfig().sha256()

    @pytest.mark.parametrize(
        ("more", "text"),
        [
            ({"renderer": "cuda"}, "renderer: got 'cuda', valid: tiny, egl"),
            (
                EGL | {"resolution": [1025, 768]},
                "resolution: got [1025, 768], valid: up to 1024x768 with renderer egl",
            ),
            (
                EGL | {"randomize": {"looks": {"table_texture": 0.5}}},
                "randomize.looks.table_texture: got 0.5, valid: 0 with renderer egl",
            ),
        ],
        ids=["unknown", "too large", "textures"],
    )
    def test_what_a_renderer_cannot_do_is_refused(self, more: dict[str, object], text: str) -> None:
        with pytest.raises(ConfigError) as caught:
            FactoryConfig.from_plain(more)
        assert str(caught.value).startswith(text)

    def test_the_largest_image_of_each_is_valid(self) -> None:
        for renderer in Renderer:
            FactoryConfig(renderer=renderer, resolution=renderer.largest_image)

    def test_it_can_be_asked_for_like_any_setting(self) -> None:
        assert resolve_request(EGL, {}).config.renderer is Renderer.EGL
        assert resolve_request(EGL, {"renderer": "tiny"}).config.renderer is Renderer.TINY


class TestStores:
    @pytest.mark.parametrize("renderer", Renderer)
    def test_a_store_names_its_renderer_and_refuses_the_other(
        self, tmp_path: Path, renderer: Renderer
    ) -> None:
        path = tmp_path / "s.zarr"
        config = small_config(renderer=renderer.value)
        prepare_store(path, config, 7, 4, {})
        assert read_attributes(path)["renderer"] == renderer.value
        check_place(path, config)
        (other,) = set(Renderer) - {renderer}
        differs = f"renderer: '{renderer.value}', and this run has '{other.value}'"
        with pytest.raises(StoreMismatchError, match=differs):
            check_place(path, dataclasses.replace(config, renderer=other))

    @pytest.mark.soak
    def test_an_episode_is_stored_and_replayed_with_the_renderer_of_its_config(
        self, opengl: None, tmp_path: Path
    ) -> None:
        path = tmp_path / "s.zarr"
        config = FactoryConfig(resolution=(64, 48), renderer=Renderer.EGL)
        generate(config, 1, path, workers=1)
        K = Dataset(path)[0].cameras["front"].intrinsics
        assert (K[0, 2], K[1, 2]) == (31.5, 23.5)
        assert replay(path, 0).same


class TestAgreement:
    @pytest.mark.parametrize("robot", ROBOTS)
    def test_both_show_the_same_things_in_the_same_places(
        self, tiny: World, egl: World, robot: str
    ) -> None:
        for index in range(6):
            spec = crowd(index, robot)
            ours = images_of(tiny, spec)
            for name, theirs in images_of(egl, spec).items():
                for label in np.unique(ours[name].segmentation):
                    a, b = (image.segmentation == label for image in (ours[name], theirs))
                    # They sample half a pixel apart: outlines may differ, and nothing else.
                    assert (a ^ b).sum() <= 0.6 * outline(a) + 6, (index, name, label)

    def test_both_say_how_much_of_each_object_is_seen(self, tiny: World, egl: World) -> None:
        for index in range(4):
            shares = []
            for world in (tiny, egl):
                scene = build_scene(world, crowd(index))
                settle(scene)
                shots = take_shots(scene)
                shares.append(np.array([shots[name].visibility for name in CAMERAS]))
            assert np.abs(shares[0] - shares[1]).max() < 0.1
        assert (shares[0] < 0.9).any()

    def test_a_thing_has_its_own_color_and_size_beside_others_from_the_same_file(
        self, egl: World
    ) -> None:
        cube = cube_spec().objects[0]
        places = [(0.45, -0.1), (0.45, 0.1), (0.6, 0.0)]
        scales, colors = (0.6, 1.2, 0.9), np.eye(3)
        cubes = tuple(
            dataclasses.replace(
                cube,
                scale=scale,
                color=tuple(color),
                drop_pose=dataclasses.replace(cube.drop_pose, position=(x, y, 0.025 * scale)),
            )
            for (x, y), scale, color in zip(places, scales, colors.tolist(), strict=True)
        )
        overhead = {"overhead": CAMERAS["overhead"].config}
        spec = cube_spec(objects=cubes, cameras=overhead, resolution=(480, 360))
        image = images_of(egl, spec)["overhead"]
        sizes = []
        for i in range(3):
            pixels = image.segmentation == Label.TARGET + i
            sizes.append(np.sqrt(pixels.sum()))
            assert image.rgb[pixels].mean(axis=0).argmax() == i
        assert np.array(sizes) / sizes[0] == pytest.approx([1.0, 2.0, 1.5], rel=0.1)


def outline(mask: np.ndarray) -> int:
    """Return how many pairs of neighbours a mask tells apart."""
    return int((mask[1:] ^ mask[:-1]).sum() + (mask[:, 1:] ^ mask[:, :-1]).sum())


class TestOpenGL:
    @pytest.mark.soak
    def test_images_do_not_hang_on_what_was_drawn_before(self, opengl: None) -> None:
        with World(Renderer.EGL) as world:
            late = {index: images_of(world, crowd(index)) for index in (0, 2, 1, 0, 2)}
        for index in (1, 2, 0):
            with World(Renderer.EGL) as fresh:
                alone = images_of(fresh, crowd(index))
            assert all(are_equal(late[index][name], image) for name, image in alone.items())

    def test_a_second_world_is_refused_while_one_is_open(self, egl: World) -> None:
        # Both would draw what the second one holds.
        with pytest.raises(GraspFactoryError, match="close the first one before"):
            World(Renderer.EGL)

    @pytest.mark.parametrize("robot", ROBOTS)
    def test_hiding_and_showing_leaves_no_trace(self, egl: World, robot: str) -> None:
        scene = build_scene(egl, crowd(2, robot))
        before = render_cameras(scene)
        bodies = (scene.robot.body, *scene.objects)
        for body, looks in {body: egl.hide(body) for body in bodies}.items():
            egl.show(body, looks)
        for name, (_, after) in render_cameras(scene).items():
            for kind in ("rgb", "zbuffer", "mask"):
                assert np.array_equal(getattr(before[name][1], kind), getattr(after, kind))

    def test_a_texture_is_refused_rather_than_left_out(self, egl: World) -> None:
        target = dataclasses.replace(cube_spec().objects[0], texture="wood/1")
        with pytest.raises(RecipeError, match="texture 'wood/1': renderer egl has none"):
            build_scene(egl, cube_spec(objects=(target,)))

    def test_nothing_is_printed(self, opengl: None, capfd: pytest.CaptureFixture[str]) -> None:
        with World(Renderer.EGL) as world:
            images_of(world, cube_spec())
        assert capfd.readouterr() == ("", "")


class TestWithoutOpenGL:
    @pytest.fixture(autouse=True)
    def no_device(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        monkeypatch.setenv("EGL_VISIBLE_DEVICES", "99")  # of none, or of a few
        check_renderer.cache_clear()
        yield
        check_renderer.cache_clear()

    def test_it_is_said_in_one_line_with_what_to_do(self) -> None:
        with pytest.raises(UsageError) as caught:
            World(Renderer.EGL)
        text = str(caught.value)
        assert text.startswith("renderer: got 'egl', but OpenGL cannot be loaded here (")
        assert text.endswith("or take --renderer tiny")
        assert "\n" not in text

    def test_tiny_does_not_mind(self) -> None:
        World(Renderer.TINY).close()

    def test_generate_ends_before_anything_is_written(self, tmp_path: Path) -> None:
        command = [sys.executable, "-m", "grasp_factory", "generate", "--renderer", "egl"]
        done = subprocess.run(
            [*command, "--n", "1", "--out", str(tmp_path / "s.zarr")],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.startswith("Error: renderer: got 'egl', but OpenGL")
        assert done.stderr.count("\n") == 1
        assert list(tmp_path.iterdir()) == []
