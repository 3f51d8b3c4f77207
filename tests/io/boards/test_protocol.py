"""Bytes into messages: by hand, any message there and back, and every way in which a line damages bytes."""

import re
import struct
from binascii import crc_hqx
from pathlib import Path

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from tensegraph.io.boards.protocol import VERSION, Decoder, FrameDecoder, LineDecoder, Row, Sample, frame, line
from tensegraph.models.values.link import Hello, LinkCounts

U8, U16, U32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))


CODES = st.lists(U16, min_size=1, max_size=16).map(tuple)


ROWS = st.builds(Row, U8, U16, U16, U32, CODES)


HELLOS = st.builds(
    Hello, U8, U16, U32, U16, U8, st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=20)
)


F32 = st.floats(min_value=2.0**-40, max_value=3.0, width=32)
I16 = st.integers(-(2**15), 2**15 - 1)
SAMPLES = st.builds(Sample, U8, U16, U8, U16, U32, F32, F32, st.tuples(I16, I16, I16), st.tuples(I16, I16, I16))


def row(k: int, board_id: int = 0) -> Row:
    codes = tuple((37 * k + 101 * c) % 1024 for c in range(12))
    return Row(board_id, 1, k % 2**16, 20_000 * k % 2**32, codes)


def test_a_frame_by_hand() -> None:
    """Version 1, kind 1, board 2, boot 3, seq 4, 5 us, one code of 6: COBS replaces the zeros by distances."""
    encoded = frame(Row(2, 3, 4, 5, (6,)))
    payload = bytes([1, 1, 2, 3, 0, 4, 0, 5, 0, 0, 0, 1, 6, 0])
    crc = 0xFFFF
    for byte in payload:  # bit by bit, as the CRC is defined
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    low, high = crc & 0xFF, crc >> 8
    assert encoded == bytes([0, 5, 1, 1, 2, 3, 2, 4, 2, 5, 1, 1, 3, 1, 6, 3, low, high, 0])


def framed(payload: bytes) -> bytes:
    """Return a payload as a frame with the right checksum, whatever it says."""
    return b"\0" + cobs.encode(payload + struct.pack("<H", crc_hqx(payload, 0xFFFF))) + b"\0"


SAMPLE = Sample(
    board_id=2,
    boot=3,
    sensor=1,
    seq=4,
    device_us=5,
    rate_unit_rad_per_s=0.5,
    force_unit_m_per_s2=2.0,
    rate=(1, -2, 3),
    force=(-32768, 0, 32767),
)
PAYLOAD = bytes.fromhex("01 03 02 0300 0400 05000000 01 0000003f 00000040 0100 feff 0300 0080 0000 ff7f")
"""The same by hand: integers little-endian, in two's complement; 0.5 and 2 as IEEE 754 writes them."""


def test_a_sample_of_an_inertial_sensor_by_hand() -> None:
    assert frame(SAMPLE) == framed(PAYLOAD)
    assert FrameDecoder().feed(framed(PAYLOAD)) == [SAMPLE]


@pytest.mark.parametrize(
    "payload",
    [
        PAYLOAD[:-1],
        PAYLOAD + b"\0",
        PAYLOAD.replace(bytes.fromhex("0000003f"), bytes.fromhex("0000c07f")),
        PAYLOAD.replace(bytes.fromhex("00000040"), bytes.fromhex("00000000")),
        PAYLOAD.replace(bytes.fromhex("00000040"), bytes.fromhex("00000042")),
        PAYLOAD[:1] + b"\x04" + PAYLOAD[2:],
    ],
    ids=[
        "short",
        "long",
        "unit nan",
        "unit 0",
        "unit of 32 m/s^2",
        "a kind of a later firmware",
    ],
)
def test_what_is_no_sample_is_garbage_and_the_next_frame_is_read(payload) -> None:
    decoder = FrameDecoder()
    assert decoder.feed(b"\0" + framed(payload) + frame(row(1))) == [row(1)]
    assert decoder.counts == LinkCounts(messages=1, garbage=1)


def test_the_checksum_is_the_well_known_one() -> None:
    """CRC-16 with this polynomial from 0xFFFF gives 0x29B1 for the digits 1 to 9."""
    assert crc_hqx(b"123456789", 0xFFFF) == 0x29B1


@given(st.lists(ROWS | HELLOS | SAMPLES, max_size=8), st.integers(1, 7))
def test_any_messages_there_and_back(messages, chunk: int) -> None:
    """In pieces of any length."""
    data, decoder, found = b"".join(map(frame, messages)), FrameDecoder(), []
    for start in range(0, len(data), chunk):
        found += decoder.feed(data[start : start + chunk])
    assert found == messages
    assert decoder.counts == LinkCounts(messages=len(messages))


@given(st.lists(ROWS, min_size=1, max_size=8))
def test_lines_there_and_back(rows) -> None:
    decoder = LineDecoder()
    decoder.feed(b"\n")
    assert [(r.board_id, r.seq, r.device_us, r.codes) for r in decoder.feed(b"".join(map(line, rows)))] == [
        (r.board_id, r.seq, r.device_us, r.codes) for r in rows
    ]


@given(st.binary(max_size=600))
def test_no_bytes_raise_and_none_make_a_row_of_noise(data: bytes) -> None:
    """A frame has a checksum over twelve codes: 600 arbitrary bytes make none."""
    assert Decoder().feed(data) == []


def test_a_half_frame_at_the_start_is_no_error() -> None:
    decoder = FrameDecoder()
    assert decoder.feed(frame(row(0))[9:] + frame(row(1))) == [row(1)]
    assert decoder.counts == LinkCounts(messages=1)


@pytest.mark.parametrize("encode", [frame, line])
def test_a_decoder_finds_out_which_protocol_it_is(encode) -> None:
    decoder = Decoder()
    found = decoder.feed(encode(row(0))[5:] + b"".join(encode(row(k)) for k in range(1, 50)))
    assert [r.seq for r in found] == list(range(1, 50))
    assert decoder.counts == LinkCounts(messages=49)


def test_lines_of_a_simple_sketch() -> None:
    """No checksum, Windows line ends, a comment; a damaged line is counted."""
    decoder = LineDecoder()
    found = decoder.feed(b"17,1\r\n# my sketch\r\n0,0,100,5,6\r\n0,1,x,5,6\r\n0,2,300,5,6\r\n")
    assert found == [Row(0, 0, 0, 100, (5, 6)), Row(0, 0, 2, 300, (5, 6))]
    assert decoder.counts == LinkCounts(messages=2, garbage=1)


@pytest.mark.parametrize("size", [1, 16, 5000])
def test_long_lines_of_many_channels_and_24_bits(size: int) -> None:
    """Of 60 channels: 491 pieces of garbage were told, or rows of other boards, where 254 bytes were kept."""
    codes = tuple(8_388_608 + k for k in range(60))
    text = b"".join(b"0,%d,%d,%s\n" % (k, 20_000 * k, ",".join(map(str, codes)).encode()) for k in range(30))
    decoder = Decoder()
    found = [row for k in range(0, len(text), size) for row in decoder.feed(text[k : k + size])]
    assert found == [Row(0, 0, k, 20_000 * k, codes) for k in range(30)]
    assert decoder.counts == LinkCounts(messages=30)


@pytest.mark.parametrize("size", [1, 64, 300, 20_000])
def test_long_frames_of_many_channels(size: int) -> None:
    """Of 255 channels: all were lost in pieces of 64 bytes, where 254 bytes were kept."""
    rows = [Row(0, 0, k, 20_000 * k, tuple(range(257 + k, 512 + k))) for k in range(20)]
    data, decoder = b"".join(map(frame, rows)), FrameDecoder()
    assert [row for k in range(0, len(data), size) for row in decoder.feed(data[k : k + size])] == rows
    assert decoder.counts == LinkCounts(messages=20)


def test_a_line_without_end_is_garbage_to_its_end() -> None:
    """Its last bytes look like a row."""
    decoder = LineDecoder()
    assert not decoder.feed(b"\n" + 5000 * b"7")
    assert [row.seq for row in decoder.feed(b",1,100,5,6\n0,2,300,5,6\n")] == [2]
    assert decoder.counts == LinkCounts(messages=1, garbage=1)


def test_from_the_first_checksum_on_lines_need_one() -> None:
    decoder = LineDecoder()
    cut = line(row(1)).partition(b"*")[0] + b"\n"
    wrong = line(row(2)).replace(b",", b",1", 1)
    assert [r.seq for r in decoder.feed(b"\n" + line(row(0)) + cut + wrong + line(row(3)))] == [0, 3]
    assert decoder.counts == LinkCounts(messages=2, bad_crc=1, garbage=1)


def message(k: int) -> Row | Sample:
    """Return a row or, in turn, a sample."""
    if k % 2 == 0:
        return row(k)
    return Sample(0, 1, 0, k % 2**16, 10_000 * k % 2**32, 0.5, 0.25, (k % 300, -k % 77, 0), (0, 5, -(k % 9)))


def fuzzed(frames: int, seed: int):
    """Damage a stream of frames; return it in pieces, one for each frame, with whether that piece is whole.

    A piece is a frame, possibly with flipped bits, cut short, sent twice, or with garbage before it.
    """
    rng = np.random.default_rng(seed)
    for k in range(frames):
        good = frame(message(k))
        data, whole, fate = bytearray(good), True, rng.random()
        if fate < 0.03:
            for bit in rng.integers(0, 8 * len(data), rng.integers(1, 5)):
                data[bit // 8] ^= 1 << bit % 8
            whole = bytes(data) == good
        elif fate < 0.05:
            a, b = sorted(rng.integers(0, len(data), 2))
            del data[a : b + 1]
            whole = False
        elif fate < 0.06:
            data = bytearray(rng.bytes(rng.integers(1, 60))) + data
        elif fate < 0.07:
            data = data * 2
        elif fate < 0.08:
            at = int(rng.integers(1, len(data)))
            data[at:at] = rng.bytes(rng.integers(1, 8))
            whole = False
        yield bytes(data), whole


def check_fuzzed(frames: int, seed: int) -> LinkCounts:
    """No wrong message, no exception, and after damage the second whole frame at the latest is taken."""
    decoder, missed_in_a_row, rng = Decoder(), 0, np.random.default_rng(seed + 1)
    for k, (data, whole) in enumerate(fuzzed(frames, seed)):
        cut = int(rng.integers(0, len(data) + 1))
        found = decoder.feed(data[:cut]) + decoder.feed(data[cut:])
        assert all(one == message(k) for one in found), (k, found)
        missed_in_a_row = 0 if found else missed_in_a_row + whole
        assert missed_in_a_row < 2, k
    return decoder.counts


def test_fuzzed_frames() -> None:
    counts = check_fuzzed(4000, seed=1)
    assert counts.messages > 3700
    assert counts.bad_crc > 20
    assert counts.garbage > 20


@pytest.mark.long
def test_100_000_fuzzed_frames() -> None:
    print(check_fuzzed(100_000, seed=2))


def test_the_firmware_speaks_this_version() -> None:
    sketch = (Path(__file__).parents[3] / "examples/firmware/tensegraph_mega/tensegraph_mega.ino").read_text()
    assert re.search(r"PROTOCOL_VERSION = (\d+);", sketch)[1] == str(VERSION)
