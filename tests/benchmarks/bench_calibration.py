"""Clocks, sets of samples and calibrations against the truth that was put in.

    PYTHONPATH=tests python -m benchmarks.bench_calibration [--hours H]

The tables of docs/guides/calibration.md and docs/guides/clocks.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator

import numpy as np
from support.board_images import BOARD, BoardRenderer, board_poses, random_pose
from support.board_images import K as TRUE_K
from support.clocks import batched, device_times
from support.inertial_records import GYRO_BIAS, MATRIX, positions_record, still_record
from support.loaded_poses import COM, MASS, loaded_poses
from support.loaded_poses import MATRIX as FT_MATRIX

from grasp_factory.capture.calibration.allan import allan_curve
from grasp_factory.capture.calibration.board import board_pose, find_board
from grasp_factory.capture.calibration.hand_eye import HandEyeSetup, PosePair, calibrate_hand_eye
from grasp_factory.capture.calibration.intrinsics import calibrate_camera
from grasp_factory.capture.calibration.load_identification import identify_load
from grasp_factory.capture.calibration.still_positions import still_positions
from grasp_factory.capture.clocks.clock_fit import fit_clock
from grasp_factory.capture.sync.live_sets import LiveSets
from grasp_factory.capture.sync.queue_sizes import StreamTiming, queue_lengths
from grasp_factory.core.geometry import inverse, rotation_vector
from grasp_factory.signals import BMI088
from grasp_factory.signals.imu_calibration import calibrate_by_gravity
from grasp_factory.signals.noise.imu import apply

Row = tuple[str, str, str]
MS = 1e6


def clocks() -> Iterator[Row]:
    """Yield the error of fits: 400 Hz for ten minutes in batches of 16 ms, drift of 50 ppm."""
    truth, host = batched(seconds=600.0, rate_hz=400.0, batch_s=0.016, seed=0)
    device = device_times(truth, drift_ppm=50.0)
    late = (host - truth) / MS
    yield "arrival itself", f"{late.std():.2f} ms", f"{np.ptp(late) / 2:.2f} ms"
    jumped = device.copy()
    jumped[len(jumped) // 3 :] += 3 * 10**9
    jumped[len(jumped) // 2 :] -= 10**8
    busy = np.maximum.accumulate(
        np.where((truth > 200e9) & (truth < 203e9), host + 8 * 10**7, host)
    )
    for name, times, arrived in (
        ("fit", device, host),
        ("fit, jumps of +3 s and -0.1 s", jumped, host),
        ("fit, counter of 24 bits in us, wraps", device // 1000 % 2**24 * 1000, host),
        ("fit, host busy for 3 s, 80 ms late", device, busy),
    ):
        fit = fit_clock(times, arrived)
        error = (fit.host_ns - truth) / MS
        pieces = f"{name}, {len(fit.pieces)} pieces"
        error = error - np.median(error)
        yield pieces, f"{error.std():.3f} ms", f"{np.abs(error).max():.3f} ms"


def sets() -> Iterator[Row]:
    """Yield the sets of images that are 120 ms late with samples of an IMU at 400 Hz."""
    timings = {
        "camera": StreamTiming(rate_hz=30.0, latency_s=0.12),
        "imu": StreamTiming(rate_hz=400.0, latency_s=0.002),
    }
    samples = sorted(
        (int(time + timing.latency_s * 1e9), name, int(time))
        for name, timing in timings.items()
        for time in np.arange(0.0, 60.0, 1.0 / timing.rate_hz) * 1e9 + 1234567
    )
    for lengths in (queue_lengths(timings), {"camera": 30, "imu": 30}):
        live = LiveSets(lengths, 1e8)
        spans = [abs(s["camera"] - s["imu"]) / MS for _, n, t in samples for s in live.add(n, t)]
        name = f"queues of {lengths['camera']} and {lengths['imu']}: {len(spans)} of 1800 images"
        most = f"{max(spans):.2f} ms" if spans else "-"
        yield name, f"{np.median(spans):.2f} ms" if spans else "-", most


def inertial(hours: float) -> Iterator[Row]:
    """Yield noise figures, bias and axes."""
    count = int(hours * 3600 * 200)
    still = np.zeros((count, 3))
    read = apply(BMI088, still, still, 200.0, seed=3)
    for name, values, triad in (
        ("accelerometer", read.specific_force, BMI088.accelerometer),
        ("gyroscope", read.angular_velocity, BMI088.gyroscope),
    ):
        _, figures = allan_curve(values, 200.0)
        density = ", ".join(f"{axis.density:.3g}" for axis in figures)
        walk = ", ".join(f"{axis.random_walk:.2g}" for axis in figures)
        truth = ", ".join(f"{value:.3g}" for value in triad.noise_density)
        yield f"{name}: noise density, {hours:g} h", truth, density
        yield f"{name}: random walk, {hours:g} h", f"{triad.bias_walk:.2g}", walk
    _, values, _ = still_record(seconds=60.0, rate_hz=200.0)
    error = np.abs(values[:, 3:].mean(axis=0) - GYRO_BIAS).max()
    yield "gyroscope: static bias of 60 s", "0.01, -0.02, 0.005 rad/s", f"within {error:.1e} rad/s"
    _, values, _ = positions_record(count=16, rate_hz=200.0, aligned=False)
    fit = calibrate_by_gravity(still_positions(values[:, :3], 200.0))
    error = np.abs(np.array(fit.model.matrix) - MATRIX).max()
    yield "accelerometer: scale and axes, 16 positions", "2 %, 0.7 degrees", f"within {error:.1e}"


def wrench() -> Iterator[Row]:
    """Yield matrix and tool of a force-torque sensor: 60 poses, noise of 0.05 units."""
    found = identify_load(loaded_poses(60, noise=0.05))
    error = np.abs(found.matrix - FT_MATRIX).max() / np.abs(FT_MATRIX).max()
    yield "6 x 6 matrix, of its largest entry", "-", f"within {100 * error:.2g} %"
    yield "tool mass", f"{MASS} kg", f"{found.tool_mass:.4f} kg"
    off = np.linalg.norm(found.tool_com - COM) * 1e3
    yield "tool centre of mass", "3, -4, 61 mm", f"within {off:.2f} mm"


def cameras() -> Iterator[Row]:
    """Yield intrinsics and hand-eye poses of rendered boards."""
    rng, renderer = np.random.default_rng(0), BoardRenderer.make()
    poses = board_poses(20, rng)
    views = [find_board(renderer.image(pose, rng), "", BOARD) for pose in poses]
    fit = calibrate_camera(views, BOARD)
    for name, at in (("fx", (0, 0)), ("fy", (1, 1)), ("cx", (0, 2)), ("cy", (1, 2))):
        yield f"{name}, 20 images", f"{TRUE_K[at]:g} px", f"{fit.K[at]:.2f} px"
    yield "reprojection error", "-", f"{fit.rms:.3f} px"
    for setup in HandEyeSetup:
        X, board = random_pose(rng, 0.1), random_pose(rng, 0.5)
        pairs = []
        for view, pose in zip(views, poses, strict=True):
            moved = board @ inverse(pose) @ inverse(X)
            hand = moved if setup is HandEyeSetup.IN_HAND else inverse(moved)
            seen = board_pose(view, BOARD, fit.K, fit.distortion)
            if seen is not None:
                pairs.append(PosePair(T_base_gripper=hand, T_camera_target=seen))
        off = inverse(X) @ calibrate_hand_eye(pairs, setup).transform
        turn = np.degrees(np.linalg.norm(rotation_vector(off[:3, :3])))
        error = f"{np.linalg.norm(off[:3, 3]) * 1e3:.2f} mm, {turn:.3f} degrees off"
        yield f"hand-eye, {setup.name.lower()}, {len(pairs)} images", "-", error


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=3.0)
    hours = parser.parse_args().hours
    parts: list[tuple[str, tuple[str, str, str], Callable[[], Iterator[Row]]]] = [
        ("Clocks", ("times", "standard deviation", "largest error"), clocks),
        ("Sets", ("queues", "median spread", "largest spread"), sets),
        ("Inertial sensor", ("value", "truth", "found"), lambda: inertial(hours)),
        ("Force-torque sensor", ("value", "truth", "found"), wrench),
        ("Cameras", ("value", "truth", "found"), cameras),
    ]
    for title, head, rows in parts:
        print(f"\n{title}\n\n| {' | '.join(head)} |\n|---|---|---|")
        for row in rows():
            print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
