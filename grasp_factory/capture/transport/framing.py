"""Packets of one size in a stream of bytes, found again after faults.

A packet begins at a place where its header, its checksum and its plausibility fit. Where they do
not, one byte is skipped, never a whole packet: the next clean packet may begin at any byte.

After lost bytes, a checksum of one byte fits by chance at 1 of 256 wrong places, and the wrong
packet would cover the beginning of a clean one. So a packet is taken at once if a header follows
it, or if it has no rivals, places inside of it where another packet may begin. Else the bytes of
the rivals are waited for, and one that fits wins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketFormat:
    """What a packet looks like."""

    size: int
    """Bytes, with header and checksum."""
    header: bytes = b""
    """Its first bytes; empty for packets that only their plausible values tell."""
    has_checksum: Callable[[bytes], bool] = lambda packet: True
    """Returns whether the checksum of a packet is right."""
    is_plausible: Callable[[bytes], bool] = lambda packet: True
    """Returns whether a packet's values can be."""
    continues: Callable[[bytes, bytes], bool] = lambda before, packet: True
    """Returns whether a packet's values may follow those of the one before. It decides only
    between places that both may be right, and only for packets without a header."""


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet that was accepted."""

    data: bytes
    end: int
    """Number of bytes in the stream up to its last one."""


@dataclass(slots=True)
class Framer:
    """Finds the packets in a stream that arrives in pieces. It does no input or output."""

    format: PacketFormat
    accepted: int = 0
    bad_checksums: int = 0
    """Places with a header where the checksum did not fit, or where a rival was better."""
    implausible: int = 0
    """Places with a right checksum whose values cannot be."""
    skipped_bytes: int = 0
    """Bytes that belong to no accepted packet."""
    _buffer: bytearray = field(default_factory=bytearray)
    _start: int = 0
    """Number of bytes in the stream before the buffer."""
    _previous: bytes | None = None
    """The last accepted packet."""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that are complete now that these bytes have arrived."""
        self._buffer += data
        return list(self._packets(is_end=False))

    def finish(self) -> list[Packet]:
        """Return the packets that waited for bytes which will not come; the rest is skipped."""
        found = list(self._packets(is_end=True))
        self._skip(len(self._buffer))
        return found

    def _packets(self, *, is_end: bool) -> Iterator[Packet]:
        size = self.format.size
        while True:
            self._skip(self._next_header())
            if len(self._buffer) < size:
                return
            if not self._is_accepted_or_counted():
                self._skip(1)
                continue
            decision = self._is_chosen(is_end=is_end)
            if decision is None:
                return
            if decision:
                yield self._take()
            else:
                self.bad_checksums += 1
                self._skip(1)

    def _is_accepted_or_counted(self) -> bool:
        """Return whether the first packet of the buffer fits; if not, count why."""
        packet = bytes(self._buffer[: self.format.size])
        if not self.format.has_checksum(packet):
            self.bad_checksums += 1
        elif not self.format.is_plausible(packet):
            self.implausible += 1
        else:
            return True
        return False

    def _is_chosen(self, *, is_end: bool) -> bool | None:
        """Return whether the first packet, which fits, is taken; None if more bytes must tell."""
        is_followed, continues = self._is_followed(0), self._continues(0)
        if is_followed and continues:
            return True
        for place in self._rivals():
            is_better = self._fits(place)
            if is_better and not self.format.header:
                is_better = self._is_better(place, bool(is_followed), continues)
            if is_better:
                return False
            if is_better is None and not is_end:
                return None
        return True

    def _is_better(self, place: int, is_followed: bool, continues: bool) -> bool | None:
        """Return whether a rival without header wins over the first packet; both fit.

        A header is rare among values, so a rival that has one wins. Places that fit by their
        values alone are frequent: only one that continues the values before, or that is followed
        by another packet, wins over a first packet which does neither.
        """
        if not continues and self._continues(place):
            return True
        return False if is_followed else self._is_followed(place)

    def _continues(self, place: int) -> bool:
        """Return whether the packet at a place continues the values of the last accepted one."""
        packet = bytes(self._buffer[place : place + self.format.size])
        return self._previous is None or self.format.continues(self._previous, packet)

    def _rivals(self) -> list[int]:
        """Return the places inside of the first packet where another one may begin."""
        header, size = self.format.header, self.format.size
        if not header:
            return list(range(1, size))
        found = []
        place = self._buffer.find(header[:1], 1, size)
        while place >= 0:
            known = bytes(self._buffer[place : place + len(header)])
            if header.startswith(known):
                found.append(place)
            place = self._buffer.find(header[:1], place + 1, size)
        return found

    def _fits(self, place: int) -> bool | None:
        """Return whether a packet begins at a place of the buffer; None if it is not all there."""
        packet = bytes(self._buffer[place : place + self.format.size])
        header = self.format.header
        if not packet.startswith(header[: len(packet)]):
            return False
        if len(packet) < self.format.size:
            return None
        return self.format.has_checksum(packet) and self.format.is_plausible(packet)

    def _is_followed(self, place: int) -> bool | None:
        """Return whether another packet begins where the one at a place ends; None if unknown."""
        after = place + self.format.size
        header = self.format.header
        if not header:
            return self._fits(after)
        known = bytes(self._buffer[after : after + len(header)])
        if not header.startswith(known):
            return False
        return True if len(known) == len(header) else None

    def _next_header(self) -> int:
        """Return how many bytes before the next header, or what may become one, are no packet."""
        header = self.format.header
        if self._buffer.startswith(header):
            return 0
        place = self._buffer.find(header)
        if place >= 0:
            return place
        longest = min(len(header) - 1, len(self._buffer))
        kept = (n for n in range(longest, 0, -1) if self._buffer.endswith(header[:n]))
        return len(self._buffer) - next(kept, 0)

    def _take(self) -> Packet:
        size = self.format.size
        packet = Packet(bytes(self._buffer[:size]), self._start + size)
        self._forget(size)
        self._previous = packet.data
        self.accepted += 1
        return packet

    def _skip(self, count: int) -> None:
        if count:
            self.skipped_bytes += count
            self._forget(count)

    def _forget(self, count: int) -> None:
        del self._buffer[:count]
        self._start += count
