"""Faults in the rooms ``labels`` and ``signals``: what follows from recordings."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "one-pad-is-enough",
        "labels/rule.py",
        'streams["phase"], np.asarray(touching(streams).all(axis=1))',
        'streams["phase"], np.asarray(touching(streams).any(axis=1))',
        ("labels/test_rule.py",),
    ),
    Fault(
        "hold-judged-at-its-start",
        "labels/rule.py",
        "if len(held) and up[held[-1]]:",
        "if len(held) and up[held[0]]:",
        ("labels/test_rule.py",),
    ),
    Fault(
        "shake-judged-at-its-start",
        "labels/rule.py",
        "if not both[levels == level][-1]:",
        "if not both[levels == level][0]:",
        ("labels/test_rule.py",),
    ),
    Fault(
        "pads-swapped-in-moments",
        "labels/force_balance.py",
        "half = width.astype(np.float64)[:, None] / 2.0",
        "half = width.astype(np.float64)[:, None] / -2.0",
        ("labels", "apps/test_physics_check.py"),
    ),
    Fault(
        "last-criterion-of-a-group-decides",
        "labels/quality.py",
        "poor.get(criterion.group, np.False_) | missed",
        "missed",
        ("labels/test_quality.py",),
    ),
    Fault(
        "gap-at-the-end-forgotten",
        "labels/image_metrics.py",
        "np.diff(times, prepend=0.0, append=end).max()",
        "np.diff(times, prepend=0.0).max()",
        ("labels/test_quality.py",),
    ),
    Fault(
        "gravity-turned-the-wrong-way",
        "signals/wrench.py",
        '"...ji,...j->...i"',
        '"...ij,...j->...i"',
        ("signals/test_wrench.py",),
    ),
    Fault(
        "imu-noise-without-its-rate",
        "signals/noise/imu.py",
        "density * math.sqrt(rate_hz) * white",
        "density * white",
        ("signals/test_noise_imu.py",),
    ),
    Fault(
        "imu-noises-share-a-seed",
        "signals/noise/imu.py",
        "np.random.default_rng(child) for child in seeds.spawn(3)",
        "np.random.default_rng(child) for child in [seeds] * 3",
        ("signals/test_noise_imu.py",),
    ),
    Fault(
        "same-noise-in-every-episode",
        "signals/noise/episode.py",
        "key = (index, zlib.crc32(path.encode()))",
        "key = (zlib.crc32(path.encode()),)",
        ("signals/test_noise_episode.py",),
    ),
    Fault(
        "quantisation-counted-twice",
        "signals/noise/depth.py",
        "noise.sigma(z, theta) ** 2 - noise.count(z) ** 2 / 12.0",
        "noise.sigma(z, theta) ** 2",
        ("signals/test_noise_depth.py",),
    ),
    Fault(
        "crop-half-a-pixel-off",
        "signals/grasp_crop.py",
        "(0.5 - parts * (centre + 0.5))",
        "(0.5 - parts * centre)",
        ("signals/test_grasp_crop.py",),
    ),
)
