"""The checks of an object set, some of them on loaded bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.geometry import IDENTITY, Array
from grasp_factory.core.splits import split_of
from grasp_factory.errors import UnknownNameError
from grasp_factory.objects import (
    MAX_PARTS,
    Compound,
    FiniteSet,
    ObjectModel,
    ObjectSet,
    UrdfFile,
    visual_parts,
)
from grasp_factory.objects.base import PRIMITIVES
from grasp_factory.robots import ROBOTS
from grasp_factory.simulation.world import DATA, World

WALL = 0.05
"""Half the thickness of the walls that feel a shape, metres."""
OVERLAP = 0.005
"""Metres by which the walls reach into a declared box."""
HULL_MARGIN = 0.001
"""Metres that Bullet adds around the convex hull of a mesh."""
LIGHTEST, HEAVIEST = 15.0, 8000.0
"""Mass over the volume of the bounding box, kg/m3: a thin frame, steel."""
SMALLEST = 0.006
"""Smallest side of an object, metres."""


def some_models(objects: ObjectSet, count: int) -> list[ObjectModel]:
    """Return models from all over a finite set, or draws from one without end."""
    if isinstance(objects, FiniteSet):
        return list(objects.models.values())[:: max(1, objects.size // count)]
    rng = np.random.default_rng(0)
    return [objects.draw(rng) for _ in range(count)]


def is_not_empty(objects: ObjectSet) -> str:
    """Check that the set has a description and an object at least."""
    if not objects.description:
        return "it has no description"
    return "" if objects.size is None or objects.size > 0 else "it has no object"


def finds_by_id(objects: ObjectSet) -> str:
    """Check that an object is found by its id, which starts with the set's name."""
    for model in some_models(objects, 60):
        if not model.object_id.startswith(f"{objects.name}/"):
            return f"id {model.object_id!r}, valid: one that starts with {objects.name}/"
        if objects.model(model.object_id) != model:
            return f"model({model.object_id!r}) is another object than the one that was drawn"
    return ""


def draws_the_same(objects: ObjectSet) -> str:
    """Check that the same generator state draws the same object, and others draw others."""
    first, second, other = (np.random.default_rng(seed) for seed in (5, 5, 6))
    drawn = [objects.draw(first) for _ in range(20)]
    if [objects.draw(second) for _ in range(20)] != drawn:
        return "two draws from one generator state differ: draw from rng alone"
    is_varied = objects.size == 1 or [objects.draw(other) for _ in range(20)] != drawn
    return "" if is_varied else "another seed draws the same objects: draw from rng"


def refuses_other_ids(objects: ObjectSet) -> str:
    """Check that an id that the set lacks is an ``UnknownNameError``."""
    for object_id in ("", objects.name, f"{objects.name}/nothing", f"{objects.name}/box/-1"):
        try:
            objects.model(object_id)
        except UnknownNameError:
            continue
        return f"model({object_id!r}) returns an object, valid: an UnknownNameError"
    return ""


def names_its_families(objects: ObjectSet) -> str:
    """Check that families are those of the objects, sorted."""
    found = sorted({model.family for model in some_models(objects, 400)})
    ok = list(objects.families) == found
    return "" if ok else f"families are {list(objects.families)}, valid: {found}"


def has_its_files(objects: ObjectSet) -> str:
    """Check that every file of a shape exists."""
    for model in some_models(objects, 1000):
        if isinstance(model.body, UrdfFile):
            there = (DATA / model.body.path).is_file()
        else:
            shapes = {part.shape for part in (*model.body.parts, *visual_parts(model.body))}
            there = all(Path(shape).is_file() for shape in shapes - set(PRIMITIVES))
        if not there:
            return f"{model.object_id} has a file that does not exist"
    return ""


def has_few_parts(objects: ObjectSet) -> str:
    """Check that a compound has no more parts than the engine takes."""
    for model in some_models(objects, 60):
        if isinstance(model.body, Compound):
            for parts in (model.body.parts, visual_parts(model.body)):
                if not 1 <= len(parts) <= MAX_PARTS:
                    return f"{model.object_id} has {len(parts)} parts, valid: 1 to {MAX_PARTS}"
    return ""


def is_solid(objects: ObjectSet) -> str:
    """Check that a mass is that of something between foam and steel."""
    for model in some_models(objects, 1000):
        density = model.mass / float(np.ptp(model.corners(), axis=0).prod())
        if not LIGHTEST < density < HEAVIEST:
            valid = f"{LIGHTEST:g} to {HEAVIEST:g}"
            return f"{model.object_id} has {density:.0f} kg/m3 of its box, valid: {valid}"
    return ""


def weighs_what_it_says(objects: ObjectSet) -> str:
    """Check that the loaded mass is the declared one."""
    with World() as world:
        for model in some_models(objects, 25):
            mass = world.mass(load(world, model))
            if abs(mass - model.mass) > 1e-6 * model.mass:
                return f"{model.object_id} weighs {mass:g} kg, valid: {model.mass:g}, as declared"
    return ""


def fits_its_box(objects: ObjectSet) -> str:
    """Check that the bounding box contains the loaded shape and is tight."""
    with World() as world:
        for model in some_models(objects, 100):
            over = overhang(world, model)
            if over.max() >= _margin(model) + 1e-4:
                return f"{model.object_id} reaches {over.max():.4f} m beyond its box"
            if over.min() <= -5e-4:
                return f"the box of {model.object_id} is {-over.min():.4f} m too large"
    return ""


def fits_grippers(objects: ObjectSet) -> str:
    """Check that every object fits between the fingers of every robot of this package."""
    narrowest = min(robot.gripper.max_width for robot in ROBOTS.values())
    for model in some_models(objects, 1000):
        side = np.ptp(model.corners(), axis=0).min()
        if not SMALLEST < side < narrowest:
            valid = f"{SMALLEST:g} to {narrowest:g}"
            return f"the smallest side of {model.object_id} is {side:.4f} m, valid: {valid}"
    return ""


def has_friction(objects: ObjectSet) -> str:
    """Check that friction is that of a dry solid."""
    for model in some_models(objects, 60):
        if not 0.1 <= model.lateral_friction <= 1.0:
            return f"{model.object_id}: friction {model.lateral_friction}, valid: 0.1 to 1"
    return ""


def has_a_color(objects: ObjectSet) -> str:
    """Check that a colour is RGB, and there where the file has none."""
    for model in some_models(objects, 60):
        if (model.color is None) != isinstance(model.body, UrdfFile):
            return f"{model.object_id}: color {model.color}, valid: RGB, or None with a UrdfFile"
        if model.color is not None and not all(0.0 <= value <= 1.0 for value in model.color):
            return f"{model.object_id}: color {model.color}, valid: 0 to 1"
    return ""


def keeps_its_split(objects: ObjectSet) -> str:
    """Check that the split depends on the object alone."""
    for model in some_models(objects, 1000):
        if model.split != split_of(model.split_by or model.object_id):
            return f"{model.object_id} is in {model.split}, against the rule of splits"
    return ""


OBJECT_SET_CHECKS: Mapping[str, Callable[[ObjectSet], str]] = {
    "it has a description and an object": is_not_empty,
    "an object is found by its id, which starts with the set": finds_by_id,
    "the same generator state draws the same object": draws_the_same,
    "an id that the set lacks is refused": refuses_other_ids,
    "families are sorted and those of the objects": names_its_families,
    "every file exists": has_its_files,
    "a compound has no more parts than the engine takes": has_few_parts,
    "a mass is that of something between foam and steel": is_solid,
    "the loaded mass is the declared one": weighs_what_it_says,
    "the bounding box contains the shape and is tight": fits_its_box,
    "every object fits between the fingers": fits_grippers,
    "friction is that of a dry solid": has_friction,
    "a colour is there where the file has none": has_a_color,
    "the split depends on the object alone": keeps_its_split,
}
"""The checks by what they check. Each returns what is wrong; empty if nothing is."""


def load(world: World, model: ObjectModel) -> int:
    """Load an object into an empty world, as a scene does, and return the body."""
    world.reset(PhysicsConfig())
    if isinstance(model.body, UrdfFile):
        body = world.load_urdf(
            DATA / model.body.path, IDENTITY, fixed=False, scale=model.body.scale
        )
    else:
        body = world.add_compound(model.body, IDENTITY, mass=model.mass)
    world.change_dynamics(body, -1, mass=model.mass)
    return body


def overhang(world: World, model: ObjectModel) -> Array:
    """Return how far the loaded shape reaches beyond its declared box, (2, 3) metres.

    Walls that reach a little into the box feel how deep the shape is in them.
    """
    body = load(world, model)
    box = np.array([model.lower, model.upper])
    walls = {}
    for side, sign in enumerate((-1.0, 1.0)):
        for axis in range(3):
            position = box.mean(axis=0)
            position[axis] = box[side, axis] + sign * (WALL - OVERLAP)
            half_extents = [0.5, 0.5, 0.5]
            half_extents[axis] = WALL
            wall = world.add_box(half_extents, position.tolist(), (1.0, 1.0, 1.0, 1.0))
            walls[wall] = side, axis
    world.step()
    depth = np.full((2, 3), -np.inf)
    for row in world.contacts():
        if body in row[1:3]:
            where = walls[row[2] if row[1] == body else row[1]]
            depth[where] = max(depth[where], -row[8])
    return depth - OVERLAP


def _margin(model: ObjectModel) -> float:
    """Return by how much the loaded shape is larger than the declared one, metres."""
    shapes = {part.shape for part in model.body.parts} if isinstance(model.body, Compound) else {""}
    return 0.0 if shapes <= set(PRIMITIVES) else HULL_MARGIN
