"""The time of a recording as a topic, for nodes with ``use_sim_time``: ``/clock``.

https://design.ros2.org/articles/clock_and_time.html
"""

from __future__ import annotations

from collections.abc import Iterator

from grasp_factory.errors import CaptureError
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types
from grasp_factory.writers.exporters.rosbag.topics import Topic

CLOCK = Topic(name="/clock", kind="rosgraph_msgs/msg/Clock")
PERIOD_NS = 10_000_000
"""Between two times, on the recording's own clock."""


class ClockTicks:
    """The times that are sent: that of the first message, and then every ``PERIOD_NS``."""

    def __init__(self, *, skips_pauses: bool) -> None:
        """Begin before the first message.

        Args:
            skips_pauses: whether only the last of several times between two messages is sent. A
                recording that is played without waiting may have a pause of years.
        """
        self._skips_pauses = skips_pauses
        self._next: int | None = None

    def until(self, stamp_ns: int) -> Iterator[int]:
        """Yield the times up to that of a message, ns."""
        if self._next is None:
            self._next = stamp_ns
        if self._skips_pauses:
            self._next += max(0, stamp_ns - self._next) // PERIOD_NS * PERIOD_NS
        while self._next <= stamp_ns:
            yield self._next
            self._next += PERIOD_NS


def clock_message(stamp_ns: int) -> bytes:
    """Return a message with a time, CDR.

    Raises:
        CaptureError: for a time that the type has no room for, after 2038.
    """
    types = ros2_types()
    second, nanosecond = divmod(stamp_ns, 10**9)
    if not 0 <= second < 2**31:
        raise CaptureError(f"a message at {second} s: valid for {CLOCK.name}: 0 to {2**31 - 1} s")
    time = types.types["builtin_interfaces/msg/Time"](sec=second, nanosec=nanosecond)
    message = types.types[CLOCK.kind](clock=time)
    return bytes(types.serialize_cdr(message, CLOCK.kind, little_endian=True))
