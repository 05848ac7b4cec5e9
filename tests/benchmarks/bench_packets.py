"""How many packets of a faulty serial line are kept, and how many wrong ones are accepted.

    PYTHONPATH=tests python -m benchmarks.bench_packets [--seconds S] [--packets N]

Two parts. First, N packets go through the framer alone, for rare events: those of ``bmi088``, whose
checksum has one byte, without and with its plausibility check, and the frames of ``article_ft``,
which have neither header nor checksum. Then the driver ``bmi088`` reads a pseudo-terminal, at which
packets arrive at 400 Hz and 1 kHz for S seconds. Of a share of packets, a third lose one to four
bytes, a third have a wrong checksum, and in the place of a third random bytes come.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from support.packet_faults import (
    ARTICLE_FT,
    BMI088_CHECKED,
    BMI088_PLAIN,
    CHECKED,
    FaultFigures,
    compared,
    framed,
    imu_packets,
    spoilt,
    thirds,
    wrench_frames,
)

from grasp_factory.capture.devices.bmi088 import Bmi088, Bmi088Settings
from grasp_factory.capture.simulators.bmi088 import packet
from grasp_factory.capture.simulators.faults import Spoiler
from grasp_factory.capture.simulators.serial_line import PtyLine
from grasp_factory.capture.transport.framing import PacketFormat
from grasp_factory.core.text_format import table

SHARES = (0.0, 0.01, 0.05, 0.2)
CHUNK = 20_000
"""Packets that are made at once."""
FORMATS: dict[str, tuple[PacketFormat, Callable[[int, int], list[bytes]]]] = {
    "bmi088": (BMI088_PLAIN, imu_packets),
    "bmi088, plausible": (BMI088_CHECKED, imu_packets),
    "article_ft": (ARTICLE_FT, wrench_frames),
}
HEAD = ("packets", "faults", "clean", "kept", "false accepts", "processor time")


def alone(name: str, share: float, count: int) -> tuple[FaultFigures, float]:
    """Return figures of the framer alone, and processor time for each packet, s."""
    format, make = FORMATS[name]
    total, taken = FaultFigures(clean=0, kept=0, false_accepts=0), 0.0
    for seed in range(max(1, count // CHUNK)):
        packets = make(CHUNK, seed)
        started = time.process_time()
        total += framed(packets, format, thirds(share, seed))[0]
        taken += time.process_time() - started
    return total, taken / (CHUNK * max(1, count // CHUNK))


def on_a_line(rate_hz: float, share: float, seconds: float) -> tuple[FaultFigures, float]:
    """Return figures of the driver on a pseudo-terminal, and its share of a core with the sender's.

    The sender waits for the time of each packet, in this thread; the driver has a thread.
    """
    from support.devices import DeviceRun

    packets = imu_packets(int(rate_hz * seconds), seed=int(rate_hz))
    faults = thirds(share, seed=7)
    _, clean = spoilt(packets, faults)
    line, spoiler = PtyLine(), Spoiler(faults)
    line.plug()
    settings = {name: getattr(CHECKED, name) for name in CHECKED.__dataclass_fields__}
    driver = Bmi088(Bmi088Settings(**{**settings, "port": str(line.path), "is_paced": False}))
    driver.open()
    run = DeviceRun(driver, simulated=None)  # type: ignore[arg-type]
    run.start()
    begin, used = time.monotonic(), time.process_time()
    for place, data in enumerate(packets):
        time.sleep(max(0.0, begin + place / rate_hz - time.monotonic()))
        line.write(spoiler.spoilt(data).data, lambda: False)
    time.sleep(0.5)
    used = time.process_time() - used
    run.stop()
    driver.close()
    line.close()
    return compared(clean, [packet(sample.payload) for sample in run.samples]), used / seconds


def row(name: str, share: float, found: FaultFigures, cost: str) -> tuple[object, ...]:
    return name, f"{share:.0%}", found.clean, found.kept, found.false_accepts, cost


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--packets", type=int, default=400_000)
    options = parser.parse_args()
    rows: list[tuple[object, ...]] = [HEAD]
    for name in FORMATS:
        for share in SHARES:
            found, seconds = alone(name, share, options.packets)
            rows.append(row(name, share, found, f"{seconds * 1e6:.0f} us each"))
            print(rows[-1], flush=True)
    for rate_hz in (400.0, 1000.0):
        for share in SHARES:
            found, busy = on_a_line(rate_hz, share, options.seconds)
            rows.append(row(f"line, {rate_hz:.0f} Hz", share, found, f"{busy:.0%} of a core"))
            print(rows[-1], flush=True)
    print(table(rows, right=range(2, 6)))


if __name__ == "__main__":
    main()
