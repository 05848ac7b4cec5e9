"""The three objects of the classic PyBullet scripts: cube, sphere and duck."""

from __future__ import annotations

from grasp_factory.objects.base import FiniteSet, ObjectModel, UrdfFile

# Sizes and masses (0.1 kg) are those of the URDF files in pybullet_data; the
# duck's box is that of duck_vhacd.obj at the URDF's scale. Friction 0.5 is Bullet's default and
# a middling dry contact: the pads' own coefficient is 1, so it is the pair's value.
_MODELS = (
    ObjectModel(
        object_id="classic/cube",
        family="cube",
        body=UrdfFile(path="cube_small.urdf"),
        lower=(-0.025, -0.025, -0.025),
        upper=(0.025, 0.025, 0.025),
        mass=0.1,
        lateral_friction=0.5,
    ),
    ObjectModel(
        object_id="classic/sphere",
        family="sphere",
        body=UrdfFile(path="sphere_small.urdf"),
        lower=(-0.03, -0.03, -0.03),
        upper=(0.03, 0.03, 0.03),
        mass=0.1,
        lateral_friction=0.5,
    ),
    ObjectModel(
        object_id="classic/duck",
        family="duck",
        body=UrdfFile(path="duck_vhacd.urdf"),
        lower=(-0.0484, 0.0047, -0.0273),
        upper=(0.0344, 0.0821, 0.0308),
        mass=0.1,
        lateral_friction=0.5,
    ),
)

CLASSIC = FiniteSet(
    name="classic",
    description="cube, sphere and duck of pybullet_data",
    models={model.object_id: model for model in _MODELS},
)
