"""The known limits of a dataset, as far as they follow from its config."""

from __future__ import annotations

from collections.abc import Iterator

from grasp_factory.apps.card.markdown import word
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.config.randomization import RandomizeConfig
from grasp_factory.core.renderer import Renderer
from grasp_factory.core.splits import SPLITS

_STRAIGHT_DOWN = {"uniform", "top_down"}
"""Policies whose grasps all approach straight down."""
_BOX_INERTIA = {"blobs", "classic"}
"""Object sets whose inertia is that of the bounding box."""

_LABEL_OF_REAL = (
    "The label of a real episode is the operator's word, else what the gripper's width and the"
    " force at the wrist say: the columns label_operator, label_gripper and label_force."
)
_SAMPLE = (
    "How often each class occurs follows from what was recorded, not from how hard grasping is."
)


def known_limits(config: FactoryConfig, *, real: int = 0, episodes: int = 1) -> tuple[str, ...]:
    """Return the known limits of a config's dataset, one or two sentences each.

    Args:
        config: of the store.
        real: how many of its episodes are real.
        episodes: how many it has.
    """
    if real == episodes:
        return (_not_measured("The episodes"), _LABEL_OF_REAL, _SAMPLE)
    return (
        _not_measured(f"{real} of {episodes} episodes") + " The other limits are those of the"
        " simulated ones."
        if real
        else "All of it is simulated. How well what is learned from it does on a real robot was not"
        " measured.",
        *([_LABEL_OF_REAL] if real else ()),
        *_of_contacts(config),
        *_of_sensors(config),
        *_of_scenes(config),
        "The label is one definition of success, by one gripper with one force and one shake. How"
        " often each class occurs follows from the policies and objects that were drawn, not from"
        " how hard grasping is.",
        "Bytes can be made again on the platform named here, and on any other whose fingerprint is"
        " the same; elsewhere last bits differ, and with them now and then an outcome.",
    )


def _not_measured(which: str) -> str:
    return (
        f"{which} were recorded with real sensors: what was not measured, such as poses of objects"
        " and contacts, is NaN, 255 or empty."
    )


def _of_contacts(config: FactoryConfig) -> Iterator[str]:
    yield (
        "Bodies are rigid, and a pad's touch is a handful of contact points: there is no soft skin,"
        " no deformation, no texture. Single points of a patch are not unique; their sum, centre of"
        " pressure and moment are."
    )
    yield (
        "Friction is Coulomb's, with one coefficient for a pair of bodies and no torsional friction"
        " at the pads, so that an object that is pinched at two points may swing."
    )
    if boxed := sorted(_BOX_INERTIA & set(config.object_sets)):
        yield f"The inertia of objects of {' and '.join(boxed)} is that of their bounding box."
    if config.physics.contact_hz < PhysicsConfig().contact_hz:
        yield (
            f"Contacts were stepped at {config.physics.contact_hz} Hz, which is coarser than the"
            f" default of {PhysicsConfig().contact_hz} Hz: contact forces are less"
            " accurate, and a few more grasps are labelled as successes."
        )


def _of_sensors(config: FactoryConfig) -> Iterator[str]:
    yield (
        "Depth, colours, forces, joints and IMU are stored clean, without noise, blur, holes or"
        " delay. `Dataset.open(path, noise=...)` adds sensors' noise as it reads."
    )
    if config.renderer is Renderer.TINY:
        yield "Images come from a rasteriser without shadows or reflections."
    else:
        yield "Images come from OpenGL without reflections; another driver draws other pixels."
    if len(config.cameras) == 1:
        camera = word(next(iter(config.cameras)))
        yield f"There is one camera, {camera}: the other sides are not seen."


def _of_scenes(config: FactoryConfig) -> Iterator[str]:
    yield f"There is one robot with one parallel gripper, {word(config.robot)}, on one flat table."
    if config.clutter.count == 1:
        yield "Each object lies alone: there is no clutter, and nothing hides it."
    if config.randomize == RandomizeConfig():
        yield "Light, table, floor, camera poses and the grip are the same in every episode."
    if config.object_splits != SPLITS:
        yield f"Only objects of {' and '.join(config.object_splits)} are in it."
    if set(config.policies) <= _STRAIGHT_DOWN:
        yield "All grasps come straight down."
    for policy in map(word, config.models):
        yield f"The grasps of {policy} were chosen by a trained model, with that model's habits."
    if config.quality.min_score > 1:
        yield (
            f"Episodes with a quality score below {config.quality.min_score} are not in it, so that"
            " it is no fair sample of what the simulator makes."
        )
