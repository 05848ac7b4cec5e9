"""Reads scenes and models with bop_toolkit, and projects the models by their poses."""

import sys
from pathlib import Path

import numpy as np
from bop_toolkit_lib import inout, misc

root, arrays = Path(sys.argv[1]), {}
models = {
    int(path.stem.removeprefix("obj_")): inout.load_ply(path)
    for path in (root / "models").glob("*.ply")
}
infos = inout.load_json(root / "models/models_info.json", keys_to_int=True)
for number, model in models.items():
    for key in ("pts", "normals", "faces"):
        arrays[f"model/{number}/{key}"] = model[key]
    arrays[f"model/{number}/diameter"] = misc.calc_pts_diameter(model["pts"])
    arrays[f"model/{number}/info"] = infos[number]["diameter"]
for folder in sorted(root.glob("t*/*")) + sorted(root.glob("val/*")):
    scene = int(folder.name)
    cameras = inout.load_scene_camera(folder / "scene_camera.json")
    truth = inout.load_scene_gt(folder / "scene_gt.json")
    info = inout.load_json(folder / "scene_gt_info.json", keys_to_int=True)
    for image, camera in cameras.items():
        key = f"{scene}/{camera['camera']}/{camera['time']}"
        for name in ("cam_K", "cam_R_w2c", "cam_t_w2c"):
            arrays[f"{key}/{name}"] = camera[name]
        arrays[f"{key}/rgb"] = inout.load_im(folder / f"rgb/{image:06d}.png")
        depth = inout.load_depth(folder / f"depth/{image:06d}.png")
        arrays[f"{key}/depth"] = depth * camera["depth_scale"]
        for g, row in enumerate(truth[image]):
            mask = inout.load_im(folder / f"mask_visib/{image:06d}_{g:06d}.png") > 0
            R, t = row["cam_R_m2c"], row["cam_t_m2c"]
            pixels = misc.project_pts(models[row["obj_id"]]["pts"], camera["cam_K"], R, t)
            boxes = {"obj": pixels, "visib": np.argwhere(mask)[:, ::-1]}
            for name, points in boxes.items():
                found = misc.calc_2d_bbox(*points.T) if mask.any() else [-1] * 4
                arrays[f"{key}/{g}/box_{name}"] = np.array([found, info[image][g][f"bbox_{name}"]])
            arrays[f"{key}/{g}/mask"] = mask
            arrays[f"{key}/{g}/number"] = row["obj_id"]
            arrays[f"{key}/{g}/pixels"] = pixels
targets = inout.load_json(root / "test_targets_bop19.json")
arrays["targets"] = np.array([[row["scene_id"], row["im_id"], row["obj_id"]] for row in targets])
for scene, image, number in arrays["targets"].tolist():
    folder = root / f"test/{scene:06d}"
    truth = inout.load_scene_gt(folder / "scene_gt.json")[image]
    info = inout.load_json(folder / "scene_gt_info.json", keys_to_int=True)[image]
    assert number in inout.get_im_targets(truth, info, 0.1)
np.savez(sys.argv[2], **arrays)
