"""Faults in the rooms ``core`` and ``robots``: frames, pixels, records, joints."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "quaternion-scalar-first",
        "core/geometry.py",
        "x, y, z, w = (quat / norm(quat)[..., None]).T",
        "w, x, y, z = (quat / norm(quat)[..., None]).T",
        ("core/test_geometry.py",),
    ),
    Fault(
        "principal-point-half-a-pixel-off",
        "core/camera.py",
        "width / 2.0 - dx, height / 2.0 - dy",
        "(width - 1) / 2.0, (height - 1) / 2.0",
        ("core/test_camera.py", "simulation/test_images.py"),
    ),
    Fault(
        "depth-along-the-ray",
        "core/camera.py",
        "    return np.stack([x, y, depth], axis=-1)",
        "    rays = np.stack([x, y, depth], axis=-1)\n"
        "    return rays * (depth / np.linalg.norm(rays, axis=-1))[..., None]",
        ("core/test_camera.py", "signals/test_point_cloud.py"),
    ),
    Fault(
        "infinity-passes-for-a-gap",
        "core/finite_check.py",
        "if path not in with_gaps or np.isinf(values).any():",
        "if path not in with_gaps:",
        ("simulation/test_rollout.py", "curation/test_verify.py"),
    ),
    Fault(
        "split-by-python-hash",
        "core/splits.py",
        "int.from_bytes(hashlib.sha256(key.encode()).digest()[:8]) / 2**64",
        "hash(key) % 2**64 / 2**64",
        ("objects/test_objects.py", "sampling/test_sampling.py"),
    ),
    Fault(
        "yaml-aliases-count-once",
        "core/config/yaml_loader.py",
        "1 + sum(values for values, _ in inner), levels",
        "1 + len(inner), levels",
        ("core/test_config.py", "cli/test_bad_input.py"),
    ),
    Fault(
        "products-by-blas",
        "core/linear.py",
        "np.asarray((A[..., :, :, None] * B[..., None, :, :]).sum(axis=-2))",
        "np.asarray(A @ B)",
        ("core/test_linear.py", "simulation/test_other_libm.py", "simulation/test_same_bytes.py"),
    ),
    Fault(
        "ik-ignores-joint-limits",
        "robots/least_squares.py",
        "q = np.clip(q + damped_step(chain, q, J, error, squares), chain.lower, chain.upper)",
        "q = q + damped_step(chain, q, J, error, squares)",
        ("robots/test_ik.py",),
    ),
    Fault(
        "path-may-change-its-branch",
        "robots/ik.py",
        "~found.converged | (steps > max_joint_step)",
        "~found.converged",
        ("robots/test_ik.py", "robots/test_trajectory.py"),
    ),
    Fault(
        "joint-axis-not-undone",
        "robots/kinematics.py",
        "T = inverse(T_joint_axis)",
        "T = np.eye(4)",
        ("robots/test_kinematics.py",),
    ),
    Fault(
        "velocity-by-the-control-rate",
        "robots/trajectory.py",
        "30.0 * left * left / (steps / hz)",
        "30.0 * left * left / (steps / control_hz)",
        ("robots/test_trajectory.py",),
    ),
)
