"""The graspable bodies that pybullet_data ships as single files.

The domino is a hard case: lying flat it is 6 mm thick, and the fingertips stay 5 mm above the
table. The mug has a solid collision shape; the procedural mugs are hollow.
"""

from __future__ import annotations

from grasp_factory.core.geometry import Vector3
from grasp_factory.objects.base import FiniteSet, ObjectModel, UrdfFile


def _model(
    name: str, file: UrdfFile | str, lower: Vector3, upper: Vector3, mass: float
) -> ObjectModel:
    return ObjectModel(
        object_id=f"classic/{name}",
        family=name,
        body=UrdfFile(path=file) if isinstance(file, str) else file,
        lower=lower,
        upper=upper,
        mass=mass,
        # Bullet's default, typical of a dry contact. The pads' own coefficient is 1, so this is
        # also the value of the pair.
        lateral_friction=0.5,
    )


# The bounding boxes are those of the files' collision shapes; those of duck and teddy come from
# duck_vhacd.obj and teddy2_VHACD_CHs.obj at the files' scale, to 0.1 mm. The masses are the files',
# with two exceptions. The brick's 0.1 kg would be denser than stone; here it is solid ABS, 1050
# kg/m3. The mug's 1 kg is three times a real mug's; it is also 10 % smaller to fit every gripper.
_MODELS = (
    _model("cube", "cube_small.urdf", (-0.025, -0.025, -0.025), (0.025, 0.025, 0.025), 0.1),
    _model("sphere", "sphere_small.urdf", (-0.03, -0.03, -0.03), (0.03, 0.03, 0.03), 0.1),
    _model("duck", "duck_vhacd.urdf", (-0.0484, 0.0047, -0.0273), (0.0344, 0.0821, 0.0308), 0.1),
    _model("teddy", "teddy_vhacd.urdf", (0.0298, 0.0195, 0.0009), (0.1059, 0.1127, 0.0637), 0.1),
    _model("block", "block.urdf", (-0.05, -0.009, -0.009), (0.05, 0.009, 0.009), 0.02),
    _model("jenga", "jenga/jenga.urdf", (-0.075, -0.025, -0.015), (0.075, 0.025, 0.015), 0.05),
    _model(
        "domino",
        "domino/domino.urdf",
        (-0.003175, -0.0127, -0.0254),
        (0.003175, 0.0127, 0.0254),
        0.025,
    ),
    _model(
        "mug",
        UrdfFile(path="objects/mug.urdf", scale=0.9),
        (-0.0369, -0.0369, 0.0),
        (0.0369, 0.07257, 0.09),
        0.3,
    ),
    _model("lego", "lego/lego.urdf", (-0.016, -0.016, -0.0115), (0.016, 0.016, 0.0115), 0.025),
)

CLASSIC = FiniteSet(
    name="classic",
    description="cube, sphere, duck, teddy, mug, blocks, domino and brick of pybullet_data",
    models={model.object_id: model for model in _MODELS},
)
