"""Intrinsics and hand-eye poses against the truth of rendered boards."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.board_images import BOARD, DISTORTION, SIZE, BoardRenderer, board_poses, random_pose
from support.board_images import K as TRUE_K

from grasp_factory.capture.calibration.board import BoardSettings, board_pose, find_board
from grasp_factory.capture.calibration.board_images import board_views
from grasp_factory.capture.calibration.hand_eye import HandEyeSetup, PosePair, calibrate_hand_eye
from grasp_factory.capture.calibration.hand_eye_file import read_hand_eye, write_hand_eye
from grasp_factory.capture.calibration.intrinsics import calibrate_camera
from grasp_factory.capture.calibration.pose_pairs import pairs_of_images, read_pairs
from grasp_factory.core.geometry import inverse, rotation_about, rotation_vector, transform
from grasp_factory.errors import CaptureError, ConfigError, LimitError, UsageError


@pytest.fixture(scope="module")
def rendered() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return poses of the board and images of them."""
    rng, renderer = np.random.default_rng(0), BoardRenderer.make()
    poses = board_poses(14, rng)
    return poses, [renderer.image(pose, rng) for pose in poses]


@pytest.fixture(scope="module")
def folder(rendered, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("images")
    for number, image in enumerate(rendered[1]):
        cv2.imwrite(str(out / f"{number:02d}.png"), image)
    return out


class TestIntrinsics:
    def test_they_are_those_of_the_camera_that_rendered(self, rendered) -> None:
        views = [find_board(image, str(k), BOARD) for k, image in enumerate(rendered[1])]
        fit = calibrate_camera(views, BOARD)
        assert np.abs(np.diag(fit.K)[:2] - np.diag(TRUE_K)[:2]).max() < 3.0
        assert np.abs(fit.K[:2, 2] - TRUE_K[:2, 2]).max() < 3.0
        assert fit.rms < 0.3
        assert fit.size == SIZE
        assert fit.kalibr("/a").intrinsics[0] == fit.K[0, 0]

    def test_a_board_has_its_pose(self, rendered) -> None:
        for truth, image in zip(*rendered, strict=True):
            found = board_pose(find_board(image, "", BOARD), BOARD, TRUE_K, DISTORTION)
            assert found is not None
            assert np.abs(found[:3, 3] - truth[:3, 3]).max() < 0.002

    def test_images_are_read_from_a_folder_and_counted(self, folder: Path) -> None:
        seen: list[None] = []
        views = board_views(folder, BOARD, most=5, on_image=lambda: seen.append(None))
        assert [view.name for view in views] == ["00.png", "03.png", "06.png", "10.png", "13.png"]
        assert len(seen) == 5

    def test_too_few_views_are_refused(self, rendered) -> None:
        views = [find_board(image, str(k), BOARD) for k, image in enumerate(rendered[1][:4])]
        views.append(find_board(np.zeros((480, 640), np.uint8), "black", BOARD))
        with pytest.raises(CaptureError, match="found in 4 of 5 images, valid: 5 or more"):
            calibrate_camera(views, BOARD)

    def test_views_of_one_tilt_are_refused(self, rendered) -> None:
        views = [find_board(rendered[1][0], str(k), BOARD) for k in range(6)]
        with pytest.raises(CaptureError, match="nearly the same tilt"):
            calibrate_camera(views, BOARD)

    def test_images_of_two_sizes_are_refused(self, rendered) -> None:
        views = [find_board(image, str(k), BOARD) for k, image in enumerate(rendered[1][:6])]
        views.append(find_board(rendered[1][7][:470], "cut", BOARD))
        with pytest.raises(CaptureError, match="several sizes"):
            calibrate_camera(views, BOARD)

    def test_a_file_that_is_no_image_is_one_line(self, tmp_path: Path) -> None:
        (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing")
        with pytest.raises(CaptureError, match=r"a\.png is no PNG, JPEG, BMP or TIFF image"):
            board_views(tmp_path, BOARD)

    def test_a_large_image_is_refused_before_it_is_decoded(self, tmp_path: Path) -> None:
        head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 12_000, 12_000)
        (tmp_path / "a.png").write_bytes(head)  # whose pixels are not even there
        words = r"a\.png: a number of pixels of 144,000,000, valid: up to 64,000,000; .* pixels=N"
        with pytest.raises(LimitError, match=words):
            board_views(tmp_path, BOARD)

    def test_a_folder_without_images_says_what_is_valid(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"got 0 images, valid: 1 to 2000 files \.png"):
            board_views(tmp_path, BOARD)

    @pytest.mark.parametrize(
        ("setting", "words"),
        [
            ({"columns": 2}, "columns: got 2, valid: 3 to 60"),
            ({"marker_m": 0.05}, "marker_m"),
            ({"dictionary": "3x3_50"}, "dictionary: got '3x3_50'"),
            ({"columns": 20, "rows": 20}, "a dictionary of 200 markers or more"),
        ],
    )
    def test_a_board_that_cannot_be_is_refused(self, setting, words: str) -> None:
        with pytest.raises(ConfigError, match=words):
            BoardSettings(**setting)


def pairs_of(
    setup: HandEyeSetup, X: np.ndarray, count: int, *, noise: float = 0.0, seed: int = 0
) -> list[PosePair]:
    """Return pairs for a camera at X, with noise in m, and as much in rad, on the board's pose."""
    rng = np.random.default_rng(seed)
    board = random_pose(rng, 1.0)  # in the base's frame, or in the gripper's
    pairs = []
    for _ in range(count):
        hand = random_pose(rng, 0.5)
        moved = hand if setup is HandEyeSetup.IN_HAND else inverse(hand)
        target = inverse(X) @ inverse(moved) @ board
        axis = rng.standard_normal(3)
        shake = rotation_about(axis / np.linalg.norm(axis), noise * rng.standard_normal())
        target = target @ transform(shake, noise * rng.standard_normal(3))
        pairs.append(PosePair(T_base_gripper=hand, T_camera_target=target))
    return pairs


class TestHandEye:
    X = random_pose(np.random.default_rng(5), 0.1)

    @pytest.mark.parametrize("setup", HandEyeSetup)
    def test_exact_pairs_give_the_exact_pose(self, setup: HandEyeSetup) -> None:
        for seed in range(5):
            fit = calibrate_hand_eye(pairs_of(setup, self.X, 8, seed=seed), setup)
            assert np.allclose(fit.transform, self.X, atol=1e-9)
            assert fit.position_rms < 1e-9
            assert fit.rotation_rms < 1e-7

    @pytest.mark.parametrize("setup", HandEyeSetup)
    def test_noise_is_averaged_and_reported(self, setup: HandEyeSetup) -> None:
        fit = calibrate_hand_eye(pairs_of(setup, self.X, 20, noise=0.002), setup)
        off = inverse(self.X) @ fit.transform
        assert np.linalg.norm(off[:3, 3]) < 0.003
        assert np.linalg.norm(rotation_vector(off[:3, :3])) < 0.003
        assert 0.001 < fit.position_rms < 0.01
        assert 0.001 < fit.rotation_rms < 0.01

    @pytest.mark.skipif(not hasattr(cv2, "calibrateHandEye"), reason="OpenCV 5 has none")
    def test_it_is_near_that_of_opencv(self) -> None:
        pairs = pairs_of(HandEyeSetup.IN_HAND, self.X, 20, noise=0.001)
        hands, targets = ([getattr(p, n) for p in pairs]
                          for n in ("T_base_gripper", "T_camera_target"))  # fmt: skip
        R, t = cv2.calibrateHandEye(
            [T[:3, :3] for T in hands], [T[:3, 3] for T in hands],
            [T[:3, :3] for T in targets], [T[:3, 3] for T in targets],
            method=cv2.CALIB_HAND_EYE_PARK,
        )  # fmt: skip
        found = calibrate_hand_eye(pairs, HandEyeSetup.IN_HAND).transform
        assert np.linalg.norm(rotation_vector(R.T @ found[:3, :3])) < 0.002
        assert np.linalg.norm(t.ravel() - found[:3, 3]) < 0.002

    def test_turns_about_one_axis_are_refused(self) -> None:
        pairs = []
        for angle in np.linspace(0.0, 1.5, 6):
            hand = transform(rotation_about((0.0, 0.0, 1.0), angle), (0.1 * angle, 0.0, 0.0))
            target = inverse(self.X) @ inverse(hand)
            pairs.append(PosePair(T_base_gripper=hand, T_camera_target=target))
        with pytest.raises(CaptureError, match="turns about one axis, or hardly"):
            calibrate_hand_eye(pairs, HandEyeSetup.IN_HAND)
        with pytest.raises(CaptureError, match="turns about one axis, or hardly"):
            calibrate_hand_eye(pairs[:1] * 5, HandEyeSetup.IN_HAND)

    def test_two_pairs_are_too_few(self) -> None:
        with pytest.raises(CaptureError, match="got 2 pairs, valid: 3 or more"):
            calibrate_hand_eye(pairs_of(HandEyeSetup.IN_HAND, self.X, 2), HandEyeSetup.IN_HAND)

    def test_images_and_poses_give_the_camera_too(self, rendered, folder, tmp_path) -> None:
        views = [find_board(image, str(k), BOARD) for k, image in enumerate(rendered[1])]
        camera = calibrate_camera(views, BOARD).kalibr()
        board = random_pose(np.random.default_rng(1), 0.5)
        hands = [board @ inverse(T) @ inverse(self.X) for T in rendered[0]]
        write_csv(tmp_path / "p.csv", {"gripper": hands})
        pairs = pairs_of_images(folder, tmp_path / "p.csv", camera, BOARD)
        fit = calibrate_hand_eye(pairs, HandEyeSetup.IN_HAND)
        assert np.linalg.norm(fit.transform[:3, 3] - self.X[:3, 3]) < 0.004
        write_csv(tmp_path / "few.csv", {"gripper": hands[:3]})
        with pytest.raises(CaptureError, match="got 3 poses for 14 images"):
            pairs_of_images(folder, tmp_path / "few.csv", camera, BOARD)


def write_csv(path: Path, poses: dict[str, list[np.ndarray]]) -> None:
    from scipy.spatial.transform import Rotation

    names = [f"{kind}_{part}" for kind in poses for part in ("x y z qx qy qz qw".split())]
    rows = [
        ",".join(
            repr(float(value))
            for T in row
            for value in (*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat())
        )
        for row in zip(*poses.values(), strict=True)
    ]
    path.write_text("\n".join([",".join(names), *rows]))


class TestPairFiles:
    PAIRS = pairs_of(HandEyeSetup.IN_HAND, TestHandEye.X, 5)

    def test_json_and_csv_hold_the_same_pairs(self, tmp_path: Path) -> None:
        data = [
            {"T_base_gripper": p.T_base_gripper.tolist(),
             "T_camera_target": p.T_camera_target.tolist()} for p in self.PAIRS
        ]  # fmt: skip
        (tmp_path / "p.json").write_text(json.dumps(data))
        write_csv(
            tmp_path / "p.csv",
            {
                "gripper": [p.T_base_gripper for p in self.PAIRS],
                "target": [p.T_camera_target for p in self.PAIRS],
            },
        )
        for a, b in zip(
            read_pairs(tmp_path / "p.json"), read_pairs(tmp_path / "p.csv"), strict=True
        ):
            assert np.allclose(a.T_base_gripper, b.T_base_gripper)
            assert np.allclose(a.T_camera_target, b.T_camera_target)

    def test_the_result_is_written_and_read(self, tmp_path: Path) -> None:
        fit = calibrate_hand_eye(self.PAIRS, HandEyeSetup.IN_HAND)
        write_hand_eye(tmp_path / "h.yaml", fit)
        found = read_hand_eye(tmp_path / "h.yaml")
        assert np.array_equal(np.array(found.transform), fit.transform)
        assert found.setup is HandEyeSetup.IN_HAND

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("{", "is no JSON"),
            ("{}", "valid: a list of 1 to 2000 pairs"),
            ("[1]", r"\[0\]: expected a mapping"),
            ('[{"T_base_gripper": [[1]], "T_camera_target": []}]', "expected 4 values"),
            ("[" * 100 + "]" * 100, "nested too deep"),
        ],
    )
    def test_a_wrong_json_file_is_one_line(self, text: str, words: str, tmp_path: Path) -> None:
        (tmp_path / "p.json").write_text(text)
        with pytest.raises(CaptureError, match=words) as found:
            read_pairs(tmp_path / "p.json")
        assert "\n" not in str(found.value)

    def test_a_matrix_that_is_no_pose_is_named(self, tmp_path: Path) -> None:
        pose = {"T_base_gripper": (2 * np.eye(4)).tolist(), "T_camera_target": np.eye(4).tolist()}
        (tmp_path / "p.json").write_text(json.dumps([pose]))
        with pytest.raises(CaptureError, match="pair 0 has a matrix that is no rotation"):
            read_pairs(tmp_path / "p.json")

    def test_another_file_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"valid: a \.json or a \.csv"):
            read_pairs(tmp_path / "p.txt")
