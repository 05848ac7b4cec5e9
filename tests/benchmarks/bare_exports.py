"""Bare loops of exports: read the episodes and encode them by the format's library, no more."""

from __future__ import annotations

import csv
import io
import json
import tarfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import h5py
import numcodecs
import numpy as np
import zarr
from benchmarks.bare_grasps import LEVEL, cornell, gqcnn, jacquard, vgn
from benchmarks.bare_rosbag import rosbag1, rosbag2
from numpy.typing import NDArray

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import inverse, pose_matrices
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.mesh_files import (
    obj_file_text,
    ply_text,
    surface_points,
    xyz_text,
)
from grasp_factory.writers.exporters.steps import observations, steps_of
from grasp_factory.writers.exporters.ycb import POINTS


def article(dataset: Dataset, out: Path) -> None:
    """Write PNG and .npy files of one camera, and a label."""
    out.mkdir()
    for i, episode in enumerate(dataset):
        frames = next(iter(episode.cameras.values()))
        for k in range(2):
            cv2.imwrite(str(out / f"rgb_{k}_{i}.png"), frames.rgb[k][..., ::-1], LEVEL)
            np.save(out / f"depth_{k}_{i}.npy", frames.depth[k])
            np.save(out / f"seg_{k}_{i}.npy", frames.segmentation[k])
        np.save(out / f"label_{i}.npy", np.array(episode.success))


def sequences(dataset: Dataset, out: Path) -> None:
    """Write PNG files of all cameras, CSV files by the module csv, and the columns as JSON."""
    out.mkdir()
    for i, episode in enumerate(dataset):
        for name, frames in episode.cameras.items():
            images = [*frames.rgb, *episode.videos.get(f"{name}/rgb", ())]
            for k, image in enumerate(images):
                cv2.imwrite(str(out / f"{i}_{name}_{k}.png"), image[..., ::-1], LEVEL)
            for k in range(2):
                depth = (frames.depth[k] * 1000.0).astype(np.uint16)
                cv2.imwrite(str(out / f"{i}_{name}_{k}_depth.png"), depth, LEVEL)
                cv2.imwrite(str(out / f"{i}_{name}_{k}_seg.png"), frames.segmentation[k], LEVEL)
            groups = (episode.streams, {k: v for k, v in episode.imu.items() if k != "T_tcp_imu"})
            for which, group in enumerate(groups):
                if not len(group["timestamp"]):
                    continue
                tables = [v.reshape(len(v), -1) for v in group.values() if v.ndim < 4]
                with (out / f"{i}_{name}_{which}.csv").open("w", newline="") as file:
                    csv.writer(file).writerows(np.concatenate(tables, axis=1).tolist())
        (out / f"{i}.json").write_text(json.dumps({"recipe": episode.spec.to_json()}))


def webdataset(dataset: Dataset, out: Path) -> None:
    """Write tar files with PNG and .npy files."""
    out.mkdir()
    with tarfile.open(out / "all.tar", "w") as tar:
        for i, episode in enumerate(dataset):
            for path, values in episode.contents().items():
                if path.startswith("episodes/"):
                    continue
                if path.startswith("cameras/") and path.endswith(("/rgb", "/segmentation")):
                    files = [cv2.imencode(".png", image, LEVEL)[1].tobytes() for image in values]
                else:
                    data = io.BytesIO()
                    np.save(data, values)
                    files = [data.getvalue()]
                for k, content in enumerate(files):
                    member = tarfile.TarInfo(f"{i}.{path.replace('/', '_')}.{k}")
                    member.size = len(content)
                    tar.addfile(member, io.BytesIO(content))


def robomimic(dataset: Dataset, out: Path) -> None:
    """Write steps and the next ones by h5py, images with gzip, of episodes with frames."""
    out.mkdir()
    with h5py.File(out / "all.hdf5", "w") as file:
        for i, episode in enumerate(dataset):
            if len(episode.videos["timestamp"]):
                for name, values in observations(episode, steps_of(episode)).items():
                    is_image = values.dtype == np.uint8 and values.ndim == 4
                    how = {"chunks": (1, *values.shape[1:]), "compression": 1} if is_image else {}
                    file.create_dataset(f"{i}/{name}", data=values, **how)
                    after = np.concatenate([values[1:], values[-1:]])
                    file.create_dataset(f"{i}/next/{name}", data=after, **how)


def diffusion_policy(dataset: Dataset, out: Path) -> None:
    """Write steps by zarr, a chunk for each image; episodes without frames are left out."""
    root = zarr.create_group(out, zarr_format=2)
    codec = numcodecs.Blosc(cname="zstd", clevel=1, shuffle=numcodecs.Blosc.NOSHUFFLE)
    total, start = int(dataset.column("n_video").sum()), 0
    for episode in dataset:
        count = len(episode.videos["timestamp"])
        if count:
            for name, values in observations(episode, steps_of(episode)).items():
                is_image = values.dtype == np.uint8 and values.ndim == 4
                if name not in root:
                    root.create_array(
                        name,
                        shape=(total, *values.shape[1:]),
                        chunks=(1 if is_image else 1024, *values.shape[1:]),
                        dtype=values.dtype,
                        compressors=codec,
                    )
                root[name][start : start + count] = values
        start += count


def lerobot(dataset: Dataset, out: Path) -> None:
    """Write frames by OpenCV as videos, and all series with their statistics by pyarrow."""
    import pyarrow as pa
    from pyarrow import parquet

    out.mkdir()
    for i, episode in enumerate(dataset):
        if not len(episode.videos["timestamp"]):
            continue
        steps, moments = steps_of(episode), {}
        for name, frames in steps.images.items():
            height, width = frames.shape[1:3]
            code = cv2.VideoWriter.fourcc(*"mp4v")
            video = cv2.VideoWriter(str(out / f"{i}_{name}.mp4"), code, 10.0, (width, height))
            for frame in frames:
                video.write(frame[..., ::-1])
            video.release()
            moments[name] = statistics_of(frames[:, ::4, ::4].reshape(-1, 3) / 255.0)
        columns = {"state": steps.state, "action": steps.action, **episode.streams}
        moments |= {name: statistics_of(v) for name, v in columns.items() if v.dtype.kind == "f"}
        flat = {name: v.reshape(len(v), -1) for name, v in columns.items()}
        for name, values in flat.items():
            array = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
            parquet.write_table(pa.table({name: array}), out / f"{i}_{name}.parquet")
        (out / f"{i}.json").write_text(json.dumps(moments))


def statistics_of(values: NDArray[Any]) -> dict[str, Any]:
    """Return the statistics that a data set of LeRobot has of a feature; of images, of a sample."""
    return {name: getattr(values, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}


def tfrecord(dataset: Dataset, out: Path) -> None:
    """Write PNG of the frames, other images by zlib, and the bytes of all other arrays."""
    out.mkdir()
    for i, episode in enumerate(dataset):
        with (out / f"{i}.bin").open("wb") as file:
            for path, values in episode.contents().items():
                if path.startswith("videos/") and path.endswith("/rgb"):
                    for image in values:
                        file.write(cv2.imencode(".png", image[..., ::-1], LEVEL)[1])
                elif path.startswith("cameras/") and path.endswith(("rgb", "depth", "tion")):
                    file.write(zlib.compress(values.tobytes(), 1))
                else:
                    file.write(values.tobytes())


def coco(dataset: Dataset, out: Path) -> None:
    """Write PNG files, and masks, areas and boxes by pycocotools."""
    from pycocotools import mask as coco_mask

    out.mkdir()
    rows = []
    for i, episode in enumerate(dataset):
        for name, frames in episode.cameras.items():
            for k in range(2):
                cv2.imwrite(str(out / f"{i}_{name}_{k}.png"), frames.rgb[k][..., ::-1], LEVEL)
                for label in range(Label.ARM, Label.TARGET + len(episode.spec.objects)):
                    mask = np.asfortranarray(frames.segmentation[k] == label).astype(np.uint8)
                    found = coco_mask.encode(np.asfortranarray(mask))
                    row = {"id": len(rows), "image": f"{i}_{name}_{k}", "category": label}
                    row |= {"area": int(coco_mask.area(found))}
                    row |= {"bbox": coco_mask.toBbox(found).tolist()}
                    rows.append({**row, "segmentation": found["counts"].decode()})
    (out / "instances.json").write_text(json.dumps(rows))


def bop(dataset: Dataset, out: Path) -> None:
    """Write folders of scenes: PNG files, and cameras, poses and boxes as JSON; then the models."""
    numbers: dict[str, int] = {}
    for i, episode in enumerate(dataset):
        scene = out / str(episode.columns["split"]) / f"{i:06d}"
        for kind in ("rgb", "depth", "mask_visib"):
            (scene / kind).mkdir(parents=True)
        cameras, poses, infos = {}, {}, {}
        for name, frames in episode.cameras.items():
            for k in range(2):
                image = f"{name}_{k}"
                depth = (frames.depth[k] * 10_000.0).astype(np.uint16)
                rgb = frames.rgb[k][..., ::-1]
                cv2.imwrite(str(scene / "rgb" / f"{image}.png"), rgb, LEVEL)
                cv2.imwrite(str(scene / "depth" / f"{image}.png"), depth, LEVEL)
                infos[image] = []
                for m in range(len(episode.spec.objects)):
                    mask = np.uint8(255) * (frames.segmentation[k] == Label.TARGET + m)
                    cv2.imwrite(str(scene / "mask_visib" / f"{image}_{m}.png"), mask, LEVEL)
                    counts = {"px": cv2.countNonZero(mask), "box": cv2.boundingRect(mask)}
                    infos[image].append(counts)
                cameras[image] = {"cam_K": frames.intrinsics.ravel().tolist()}
                poses[image] = poses_in_camera(episode, frames, k)
        (scene / "scene_camera.json").write_text(json.dumps(cameras))
        (scene / "scene_gt.json").write_text(json.dumps(poses))
        (scene / "scene_gt_info.json").write_text(json.dumps(infos))
        (out / "models").mkdir(exist_ok=True)
        for number, mesh in new_meshes(dataset, episode, numbers):
            (out / "models" / f"{number}.ply").write_text(ply_text(mesh, mesh.center))


def ycb(dataset: Dataset, out: Path) -> None:
    """Write PNG files of colours, depth and labels, boxes, poses by SciPy, and the models."""
    from scipy.io import savemat

    numbers: dict[str, int] = {}
    for i, episode in enumerate(dataset):
        folder = out / "data" / f"{i:04d}"
        folder.mkdir(parents=True)
        for name, frames in episode.cameras.items():
            for k in range(2):
                stem, labels = folder / f"{name}_{k}", frames.segmentation[k]
                depth = (frames.depth[k] * 10_000.0).astype(np.uint16)
                cv2.imwrite(f"{stem}-color.png", frames.rgb[k][..., ::-1], LEVEL)
                cv2.imwrite(f"{stem}-depth.png", depth, LEVEL)
                cv2.imwrite(f"{stem}-label.png", labels, LEVEL)
                masks = [labels == Label.TARGET + m for m in range(len(episode.spec.objects))]
                boxes = [cv2.boundingRect(mask.astype(np.uint8)) for mask in masks]
                Path(f"{stem}-box.txt").write_text("".join(f"{box}\n" for box in boxes))
                poses = poses_in_camera(episode, frames, k)
                savemat(f"{stem}-meta.mat", {"K": frames.intrinsics, "poses": poses})
        for number, mesh in new_meshes(dataset, episode, numbers):
            model = out / "models" / str(number)
            model.mkdir(parents=True)
            (model / "textured.obj").write_text(obj_file_text(mesh))
            (model / "points.xyz").write_text(xyz_text(surface_points(mesh, POINTS)))


def poses_in_camera(episode: Episode, frames: CameraFrames, k: int) -> list[Any]:
    """Return each object's pose in the camera's frame before (0) or after (1), (4, 4) as lists."""
    last = episode.streams["object_pose"][-1:]
    world = last[0] if k and len(last) else episode.columns["object_rest_pose"]
    return (inverse(frames.T_world_camera[k]) @ pose_matrices(world)).tolist()


def new_meshes(
    dataset: Dataset, episode: Episode, numbers: dict[str, int]
) -> Iterator[tuple[int, TriangleMesh]]:
    """Yield number and mesh of the objects that no episode before had."""
    for recipe in episode.spec.objects:
        key = f"{recipe.object_id} {recipe.scale}"
        if key not in numbers:
            numbers[key] = len(numbers) + 1
            yield numbers[key], dataset.object_mesh(recipe)


BARE: Mapping[str, Callable[[Dataset, Path], None]] = {
    "article": article,
    "diffusion_policy": diffusion_policy,
    "robomimic": robomimic,
    "bop": bop,
    "coco": coco,
    "cornell": cornell,
    "gqcnn": gqcnn,
    "jacquard": jacquard,
    "lerobot": lerobot,
    "rosbag1": rosbag1,
    "rosbag2": rosbag2,
    "sequences": sequences,
    "tfrecord": tfrecord,
    "vgn": vgn,
    "webdataset": webdataset,
    "ycb": ycb,
}
"""By the name of the format."""
