"""Parsers of configs, meshes, robots' and objects' files, and of trained models."""

from __future__ import annotations

from collections.abc import Callable

from fuzz.target import Target
from support import nasty_meshes
from support.places import TINY
from support.tiny_archive import COLLISION, archive, manifest
from support.tiny_models import tiny_model

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.limits import parse as parse_limits
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError
from grasp_factory.objects.folder import Manifest
from grasp_factory.objects.folder_archive import unpack_folder
from grasp_factory.objects.importing.mesh_reader import read_mesh
from grasp_factory.objects.importing.settings import parse_settings
from grasp_factory.objects.importing.urdf import parse_urdf
from grasp_factory.policies.networks import load_model

CONFIG = b"""\
seed: 3
robot: panda
policies: {top_down: 0.5, antipodal: 0.5}
object_sets: {procedural: 1.0}
clutter: {count: 2}
resolution: [96, 72]
label: {min_lift: 0.08}
"""
SETTINGS = b"""\
defaults: {scale: 0.001, density: 700}
objects: {cup.obj: {mass: 0.2, friction: 0.5}}
"""
URDF = b"""\
<robot name="cup"><link name="base"><inertial><origin xyz="0 0 0.02" rpy="0 0 0"/>
<mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
<visual><geometry><mesh filename="cup.obj" scale="1 1 1"/></geometry><material name="red">
<color rgba="1 0 0 1"/></material></visual>
<collision><geometry><box size="0.05 0.05 0.08"/></geometry></collision></link>
<link name="lid"><collision><geometry><cylinder radius="0.02" length="0.01"/></geometry></collision>
</link><joint name="j" type="fixed"><parent link="base"/><child link="lid"/>
<origin xyz="0 0 0.05"/></joint></robot>
"""


def mesh(kind: str) -> Target:
    """Return a target that reads a mesh file."""

    def examples() -> list[bytes]:
        return [nasty_meshes.encode(kind, *shape) for shape in nasty_meshes.shapes().values()][:2]

    return Target(lambda data: read_mesh(kind, data), examples)


def text(parse: Callable[[str], object], *examples: bytes) -> Target:
    return Target(lambda data: parse(data.decode("utf-8", "replace")), lambda: list(examples))


def recipe(data: str) -> None:
    """Read a recipe, as from a row of a store."""
    try:
        EpisodeSpec.from_json(data)
    except (ValueError, RecursionError) as error:  # no JSON; who calls it says which row
        if isinstance(error, ConfigError):
            raise


TARGETS = {
    "config": text(lambda given: FactoryConfig.from_plain(parse_yaml(given, "config")), CONFIG),
    "spec": Target(
        lambda data: recipe(data.decode("utf-8", "replace")),
        lambda: [Dataset(TINY).spec(0).to_json().encode()],
        is_json=True,
    ),
    "limits": text(parse_limits, b"chunk=4GiB,log=1GiB"),
    "settings of a folder": Target(lambda data: parse_settings(data, "f"), lambda: [SETTINGS]),
    "URDF": Target(parse_urdf, lambda: [URDF]),
    "OBJ": mesh("obj"),
    "STL": mesh("stl"),
    "PLY": mesh("ply"),
    "archive of objects": Target(unpack_folder, lambda: [archive()]),
    "mesh of an archive": Target(lambda d: unpack_folder(archive(d)), lambda: [COLLISION]),
    "manifest of an archive": Target(
        lambda data: unpack_folder(archive(told=data)), lambda: [manifest()], is_json=True
    ),
    "manifest of objects": Target(Manifest.decoded, lambda: [manifest()], is_json=True),
    "model": Target(load_model, lambda: [tiny_model(1)]),
}
