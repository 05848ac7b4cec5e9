"""Tilt errors of the orientation filters on a known motion with the noise of a BMI088.

    PYTHONPATH=tests python -m benchmarks.bench_orientation [--motions N]

The table of docs/reference/signals.md. Motions are sums of sines at 400 Hz for 20 s, like an arm
that carries an object. Each begins with 2 s at rest, whose bias is taken off.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from support.inertial_motion import inertial_motion, tilt_errors

from grasp_factory.signals import BMI088, apply_imu_noise
from grasp_factory.signals.imu_calibration import static_bias
from grasp_factory.signals.orientation import FILTERS, estimate

RATE, SECONDS, REST = 400.0, 20.0, 2.0
SPEEDS = {"calm": (0.4, 0.02), "usual": (0.6, 0.08), "strong": (1.2, 0.3)}
"""Amplitudes by name: angles in rad, positions in m."""
UP = np.array([0.0, 0.0, 9.80665])


def measure(name: str, motions: int) -> dict[str, tuple[float, float, float]]:
    """Return RMS and largest tilt error in degrees and microseconds a sample, by speed."""
    found = {}
    for speed, (turn, reach) in SPEEDS.items():
        errors, spent, count = [], 0.0, 0
        for seed in range(motions):
            motion = inertial_motion(
                seconds=SECONDS + REST, rate_hz=RATE, seed=seed, turn=turn, reach=reach, rest=REST
            )
            read = apply_imu_noise(
                BMI088, motion.specific_force, motion.angular_velocity, RATE, seed=seed
            )
            still = int(REST * RATE)
            # At rest the truth of both is known: its mean difference is the bias.
            force = read.specific_force - static_bias(read.specific_force[:still] - UP)
            rate = read.angular_velocity - static_bias(read.angular_velocity[:still])
            start = time.process_time()
            quats = estimate(name, force, rate, RATE)
            spent, count = spent + time.process_time() - start, count + len(quats)
            errors.append(tilt_errors(quats, motion.quat_xyzw)[still:])
        every = np.concatenate(errors)
        rms = float(np.sqrt((every**2).mean()))
        found[speed] = rms, float(every.max()), spent / count * 1e6
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--motions", type=int, default=5)
    motions = parser.parse_args().motions
    names = ", ".join(f"{turn} rad and {reach} m" for turn, reach in SPEEDS.values())
    print(f"amplitudes: {names}; {motions} motions of {SECONDS:g} s at {RATE:g} Hz\n")
    print("| filter | " + " | ".join(f"{s}: RMS (largest)" for s in SPEEDS) + " | us a sample |")
    print("|---" * (len(SPEEDS) + 2) + "|")
    for name in FILTERS:
        found = measure(name, motions)
        cells = [f"{rms:.2f}° ({most:.1f}°)" for rms, most, _ in found.values()]
        micro = np.mean([us for _, _, us in found.values()])
        print(f"| `{name}` | " + " | ".join(cells) + f" | {micro:.0f} |", flush=True)


if __name__ == "__main__":
    main()
