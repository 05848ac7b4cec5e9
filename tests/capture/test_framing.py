"""The framer: no clean packet is lost, and nothing else is accepted."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.packet_faults import (
    ARTICLE_FT,
    BMI088_CHECKED,
    BMI088_PLAIN,
    framed,
    imu_packets,
    thirds,
    wrench_frames,
)
from support.scale import scaled

from grasp_factory.capture.devices.bmi088 import HEADER
from grasp_factory.capture.transport.checksums import CHECKSUMS, crc16_modbus
from grasp_factory.capture.transport.framing import Framer, PacketFormat

BODY = 6
CRC = CHECKSUMS["crc32"]
STRONG = PacketFormat(size=len(HEADER) + BODY + CRC.size, header=HEADER, has_checksum=CRC.fits)
"""Packets with a checksum that never fits by chance."""
BYTES = st.sampled_from([0x55, 0xAA, 0x00, 0x17])
"""Bytes that look like headers more often than not."""
BODIES = st.lists(BYTES, min_size=BODY, max_size=BODY).map(bytes)
RUBBISH = st.lists(BYTES, max_size=25).map(bytes)
PIECES = st.integers(1, 40)


def packet(body: bytes) -> bytes:
    return CRC.sealed(HEADER + body)


def fed(framer: Framer, stream: bytes, piece: int) -> Iterator[bytes]:
    for start in range(0, len(stream), piece):
        yield from (found.data for found in framer.feed(stream[start : start + piece]))
    yield from (found.data for found in framer.finish())


@given(st.lists(st.tuples(RUBBISH, BODIES), max_size=12), RUBBISH, PIECES)
def test_every_clean_packet_comes_and_nothing_else(
    parts: list[tuple[bytes, bytes]], tail: bytes, piece: int
) -> None:
    stream = b"".join(rubbish + packet(body) for rubbish, body in parts) + tail
    framer = Framer(STRONG)
    assert list(fed(framer, stream, piece)) == [packet(body) for _, body in parts]
    assert framer.skipped_bytes == sum(len(rubbish) for rubbish, _ in parts) + len(tail)
    assert framer.accepted == len(parts)


@given(st.lists(BODIES, min_size=1, max_size=8), st.data(), PIECES)
def test_a_lost_byte_costs_its_own_packet_alone(
    bodies: list[bytes], data: st.DataObject, piece: int
) -> None:
    packets = [packet(body) for body in bodies]
    hit = data.draw(st.integers(0, len(packets) - 1))
    gone = data.draw(st.integers(0, STRONG.size - 1))
    spoilt = packets[hit][:gone] + packets[hit][gone + 1 :]
    stream = b"".join([*packets[:hit], spoilt, *packets[hit + 1 :]])
    assert list(fed(Framer(STRONG), stream, piece)) == packets[:hit] + packets[hit + 1 :]


@given(st.lists(st.tuples(RUBBISH, BODIES), max_size=8), PIECES, PIECES)
def test_what_is_found_does_not_depend_on_the_pieces(
    parts: list[tuple[bytes, bytes]], one: int, other: int
) -> None:
    stream = b"".join(rubbish + packet(body) for rubbish, body in parts)
    weak = PacketFormat(size=9, header=HEADER, has_checksum=CHECKSUMS["sum8"].fits)
    first, second = Framer(weak), Framer(weak)
    assert list(fed(first, stream, one)) == list(fed(second, stream, other))
    assert first == second


@given(st.lists(BODIES, min_size=2, max_size=5))
def test_a_packet_says_where_it_ended_in_the_stream(bodies: list[bytes]) -> None:
    framer = Framer(STRONG)
    found = framer.feed(b"x" + b"".join(map(packet, bodies))) + framer.finish()
    assert [packet.end for packet in found] == [
        1 + STRONG.size * (k + 1) for k in range(len(bodies))
    ]


def test_a_packet_is_not_held_back_until_the_next_one_comes() -> None:
    framer = Framer(BMI088_PLAIN)
    for data in imu_packets(200, seed=3):
        if 0x55 not in data[1:]:
            assert [found.data for found in framer.feed(data)] == [data]


def lost_but_fitting() -> tuple[bytes, bytes, bytes]:
    """Return what is left of a packet that lost bytes, and two clean packets.

    With the first bytes of the clean one, the rest fits its checksum by chance.
    """
    follower, last = imu_packets(2, seed=8)
    for data in imu_packets(5000, seed=9):
        rest = data[:10] + data[12:]
        if BMI088_PLAIN.has_checksum(rest + follower[: 17 - len(rest)]):
            return rest, follower, last
    raise AssertionError("a checksum of one byte fits one time in 256")


@pytest.mark.parametrize("piece", [1, 5, 17, 100])
def test_a_wrong_packet_that_fits_by_chance_does_not_cost_the_clean_one_under_it(
    piece: int,
) -> None:
    rest, follower, last = lost_but_fitting()
    found = list(fed(Framer(BMI088_PLAIN), rest + follower + last, piece))
    assert found == [follower, last]


def test_bad_checksums_are_counted() -> None:
    good = imu_packets(3, seed=1)
    bad = good[1][:-1] + bytes([good[1][-1] ^ 1])
    framer = Framer(BMI088_PLAIN)
    assert len(list(fed(framer, good[0] + bad + good[2], 17))) == 2
    assert (framer.bad_checksums, framer.implausible, framer.skipped_bytes) == (1, 0, 17)


def test_implausible_packets_are_counted() -> None:
    hot = bytearray(imu_packets(1, seed=1)[0])
    hot[14:16] = (9000).to_bytes(2, "little")
    framer = Framer(BMI088_CHECKED)
    assert list(fed(framer, CHECKSUMS["sum8"].sealed(bytes(hot[:16]), 2), 17)) == []
    assert (framer.bad_checksums, framer.implausible, framer.skipped_bytes) == (0, 1, 17)


class TestFaults:
    """The bounds at 0, 1 and 5 %; ``benchmarks.bench_packets`` has the figures of long runs."""

    COUNT = scaled(6000, 60_000)

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.05])
    def test_all_clean_packets_are_kept_and_no_wrong_one_is_accepted(self, share: float) -> None:
        packets = imu_packets(self.COUNT, seed=5)
        figures, framer = framed(packets, BMI088_CHECKED, thirds(share, seed=5))
        assert figures.kept == figures.clean
        assert figures.false_accepts == 0
        assert (framer.skipped_bytes > 0) is (share > 0)

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.05])
    def test_a_checksum_of_one_byte_does_it_without_a_plausibility_check(
        self, share: float
    ) -> None:
        packets = imu_packets(6000, seed=5)
        figures, _ = framed(packets, BMI088_PLAIN, thirds(share, seed=5))
        assert (figures.kept, figures.false_accepts) == (figures.clean, 0)

    def test_at_20_percent_the_plausibility_check_refuses_what_the_checksum_lets_pass(
        self,
    ) -> None:
        packets = imu_packets(40_000, seed=6)
        plain, _ = framed(packets, BMI088_PLAIN, thirds(0.2, seed=6))
        checked, _ = framed(packets, BMI088_CHECKED, thirds(0.2, seed=6))
        assert 0 < plain.false_accepts < 60
        assert plain.clean - plain.kept < 60
        assert checked.false_accepts < plain.false_accepts
        assert checked.kept >= plain.kept

    def test_frames_without_header_are_found_again_by_their_values(self) -> None:
        frames = wrench_frames(6000, seed=7)
        faults = thirds(0.01, seed=7)
        figures, _ = framed(frames, ARTICLE_FT, faults)
        assert figures.clean - figures.kept <= 6
        assert figures.false_accepts <= 6

    def test_frames_without_header_and_without_faults_all_come(self) -> None:
        figures, framer = framed(wrench_frames(3000, seed=7), ARTICLE_FT, thirds(0.0, seed=7))
        assert (figures.kept, figures.false_accepts, framer.skipped_bytes) == (3000, 0, 0)


def test_the_crc_of_modbus_is_that_of_its_specification() -> None:
    assert crc16_modbus(b"123456789") == 0x4B37
    assert CHECKSUMS["crc16_modbus"].of(bytes([0x02, 0x07])) == bytes([0x41, 0x12])


@given(st.sampled_from(sorted(CHECKSUMS)), st.binary(min_size=2, max_size=30))
def test_a_sealed_body_fits_and_a_changed_one_does_not(name: str, body: bytes) -> None:
    checksum = CHECKSUMS[name]
    sealed = checksum.sealed(body)
    assert checksum.fits(sealed)
    if checksum.size:
        assert not checksum.fits(bytes([sealed[0] ^ 0x10]) + sealed[1:])
