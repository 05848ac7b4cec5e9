"""Sets of samples while they arrive: ROS's ApproximateTime policy with bounded queues."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from grasp_factory.errors import UsageError, lookup


class LiveSets:
    """Forms the sets of ``signals.approximate_time`` from samples that arrive one by one.

    It waits for the sample of each stream that could still change a set, as a ROS node does. A full
    queue loses its oldest sample, which is counted: then sets may be missing or wide.
    """

    def __init__(self, lengths: Mapping[str, int], slop_ns: float = float("inf")) -> None:
        """Wait for samples.

        Args:
            lengths: how many samples are kept of each stream, by name; see ``queue_lengths``.
            slop_ns: Longest span of a set, ns, inclusive.

        Raises:
            UsageError: for no streams, or a length below 1.
        """
        if not lengths or min(lengths.values()) < 1:
            raise UsageError(f"LiveSets: lengths {dict(lengths)}, valid: 1 or more for each stream")
        self._names = list(lengths)
        self._lengths = list(lengths.values())
        self._slop = slop_ns
        self._queues: list[list[int]] = [[] for _ in lengths]
        self._head = [0] * len(lengths)
        self._best = [0] * len(lengths)
        self._pivot = -1
        self._span = (0, 0)
        self.dropped: dict[str, int] = dict.fromkeys(lengths, 0)
        """Samples that a full queue lost, by stream."""

    def add(self, name: str, time_ns: int) -> list[dict[str, int]]:
        """Take a sample, and return the sets that are now complete: a time (ns) for each stream.

        Raises:
            UsageError: for an unknown stream, or a time that does not ascend.
        """
        lookup(dict.fromkeys(self._names), "stream", name)
        k = self._names.index(name)
        queue = self._queues[k]
        if queue and time_ns <= queue[-1]:
            raise UsageError(f"{name}: {time_ns} ns follows {queue[-1]} ns; valid: ascending times")
        queue.append(time_ns)
        found = self._formed()
        if len(queue) > self._lengths[k]:
            self._drop_oldest(k)
            found += self._formed()
        return found

    def _formed(self) -> list[dict[str, int]]:
        found = []
        while all(h < len(q) for h, q in zip(self._head, self._queues, strict=True)):
            times = self._step()
            if times:
                found.append(dict(zip(self._names, times, strict=True)))
        return found

    def _step(self) -> Sequence[int]:
        """Move the search on by one sample, and return a set if one is complete."""
        now = [q[h] for h, q in zip(self._head, self._queues, strict=True)]
        start, end = min(now), max(now)
        first = now.index(start)
        if self._pivot < 0:
            if end - start > self._slop:
                self._forget([int(k == first) for k in range(len(now))])
                return ()
            self._pivot = len(now) - 1 - now[::-1].index(end)
            is_better = True
        else:
            is_better = end - self._span[1] < start - self._span[0]
        if is_better:
            self._best, self._span = self._head.copy(), (start, end)
        self._head[first] += 1
        if first != self._pivot:
            return ()
        times = [q[b] for b, q in zip(self._best, self._queues, strict=True)]
        self._forget([b + 1 for b in self._best])
        return times

    def _forget(self, counts: Sequence[int]) -> None:
        """Remove the oldest samples of each queue, and search again from the next ones."""
        for queue, n in zip(self._queues, counts, strict=True):
            del queue[:n]
        self._head = [0] * len(self._queues)
        self._pivot = -1

    def _drop_oldest(self, k: int) -> None:
        self.dropped[self._names[k]] += 1
        self._forget([int(i == k) for i in range(len(self._queues))])
