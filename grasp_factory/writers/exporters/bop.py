"""BOP: 6D poses, visible masks, depth, camera and models of the benchmark's scenes.

A scene is an episode: ``{split}/{scene:06d}`` holds the images of all cameras, before and after the
attempt. Lengths are millimetres, and a model's origin is the centre of its bounding box:
``bop_datasets_format`` in https://github.com/thodan/bop_toolkit/tree/master/docs
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import CameraFrames, ObjectSpec
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.bop_scene import (
    DEPTH_SCALE,
    MM,
    Info,
    SceneModels,
    write_scene,
)
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.json_items import (
    item,
    joined_items,
    keep_items,
    member,
    write_items,
)
from grasp_factory.writers.exporters.mesh_files import diameter, ply_text
from grasp_factory.writers.exporters.object_models import (
    ModelKey,
    NumberedModel,
    keep_model_rows,
    key_of,
    new_models,
    number_models,
    write_model_rows,
)
from grasp_factory.writers.exporters.object_views import of_no_split, of_real_objects
from grasp_factory.writers.exporters.selection import Selection

VISIBLE_SHARE = 0.1
"""Smallest visible share of a test target: ``visib_gt_min`` of the BOP challenge."""
MODELS, INFO, TARGETS = "models", "models_info.json", "test_targets_bop19.json"


def excludes(episodes: Selection, settings: Any) -> dict[str, NDArray[np.bool_]]:
    """Exclude real episodes, and those of an unknown split."""
    return {**of_real_objects(episodes), **of_no_split(episodes, settings)}


def prepare(episodes: Selection, settings: Any) -> dict[ModelKey, NumberedModel]:
    """Return the numbers of all models."""
    return number_models(episodes)


def write_part(job: ExportJob, part: ExportPart) -> dict[str, Any] | None:
    """Write the scenes of some episodes and their new models.

    Returns:
        The content of ``camera.json``, from the first camera of the first episode.
    """
    (job.folder / MODELS).mkdir(exist_ok=True)
    camera: dict[str, Any] | None = None
    targets, infos = list[str](), list[str]()
    models: dict[int, tuple[ObjectSpec, str]] = {}
    for place, episode in part.episodes:
        camera = camera or camera_file(next(iter(episode.cameras.values())))
        meshes = {
            key_of(recipe): job.episodes.object_mesh(place, recipe)
            for recipe in episode.spec.objects
        }
        split = str(episode.columns["split"])
        scene = SceneModels(numbers=job.prepared, meshes=meshes)
        found = write_scene(job.folder / split / f"{place:06d}", episode, scene)
        if split == "test":
            targets += map(item, scene_targets(place, found))
        for number, recipe in new_models(job.prepared, place, episode):
            mesh, file = meshes[key_of(recipe)], f"{MODELS}/obj_{number:06d}.ply"
            (job.folder / file).write_text(ply_text(mesh, mesh.center), encoding="ascii")
            infos.append(member(str(number), model_info(mesh)))
            models[number] = (recipe, file)
    keep_items(job, part, TARGETS, targets)
    keep_items(job, part, INFO, infos)
    keep_model_rows(job, part, models)
    return camera


def camera_file(frames: CameraFrames) -> dict[str, Any]:
    """Return the content of ``camera.json``; each image's own is in ``scene_camera.json``."""
    height, width = frames.rgb.shape[1:3]
    K = frames.intrinsics
    return {
        "cx": float(K[0, 2]),
        "cy": float(K[1, 2]),
        "depth_scale": DEPTH_SCALE,
        "fx": float(K[0, 0]),
        "fy": float(K[1, 1]),
        "height": height,
        "width": width,
    }


def model_info(mesh: TriangleMesh) -> dict[str, float]:
    """Return a model's entry in ``models_info.json``, millimetres."""
    points = MM * (mesh.vertices - mesh.center)
    low = points.min(axis=0)
    size = points.max(axis=0) - low
    info = {"diameter": diameter(points)}
    info |= {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    return info | {f"size_{axis}": float(value) for axis, value in zip("xyz", size, strict=True)}


def scene_targets(
    scene: int, found: Mapping[int, Sequence[tuple[int, Info]]]
) -> Iterator[dict[str, int]]:
    """Yield the entries of a scene in ``test_targets_bop19.json``."""
    for image, objects in found.items():
        seen = Counter(n for n, info in objects if info["visib_fract"] >= VISIBLE_SHARE)
        for number, count in sorted(seen.items()):
            yield {"im_id": image, "inst_count": count, "obj_id": number, "scene_id": scene}


def finish(job: ExportJob, parts: Sequence[Any]) -> None:
    """Write the files that describe all scenes and models."""
    write_json(job.folder / "camera.json", parts[0])
    write_items(job.folder / MODELS / INFO, "{", joined_items(job, INFO), "}")
    write_items(job.folder / TARGETS, "[", joined_items(job, TARGETS), "]")
    write_model_rows(job)


BOP = Exporter(
    name="bop",
    description="BOP: 6D object poses with masks, depth, cameras and models, for pose estimation",
    contents=ExportContents(
        written=(
            "cameras/*/rgb",
            "cameras/*/depth",
            "cameras/*/segmentation",
            "cameras/*/intrinsics",
            "cameras/*/T_world_camera",
            "cameras/*/visibility",
        ),
        left_out={
            "streams/object_pose": "the format has no time series; the last record is the pose in"
            " the images after the attempt",
            "streams/*": "the format has no time series",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the format has no time series"),
            "videos/*": "its images are those before and after the attempt",
        },
        treatment={
            "depth": "16-bit PNG in units of 0.1 mm; 0 where the store has NaN or more than"
            " 6.5535 m",
            "poses": "before the attempt those at rest; after it the last record, up to one period"
            " of the streams before the image; if the robot did not move, both are the same",
            "an object without a finite pose": "it is not in the ground truth of that image",
            "masks": "only visible parts of objects have masks: mask_visib/, not mask/; robot,"
            " table and floor have none",
            "visib_fract, px_count_all": "as in BOP of the whole object, also outside the image:"
            " inside by the store's share of visible pixels, else by the model's silhouette",
            "px_count_valid": "visible pixels with depth",
            "boxes": "width and height are largest less smallest pixel, as in bop_toolkit; -1 if"
            " nothing is visible, bbox_obj also if the model reaches behind the camera",
            "models": "an object of another scale is another model; colours are the object's own,"
            " without textures and without what randomisation changed; no models_eval/",
            "split": "an episode is in the split of its target; other objects of the scene may be"
            " of another split",
            REAL_ROWS: "left out: real objects have no models and no poses",
            "no grasp, no video": "the same as for other episodes",
        },
    ),
    excludes=excludes,
    prepare=prepare,
    write_part=write_part,
    series=("streams/object_pose",),
    finish=finish,
)
