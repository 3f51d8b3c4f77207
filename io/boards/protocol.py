r"""The protocols of the boards: messages from a stream of bytes, parts of which may be damaged.

Frames (version 1), little-endian, COBS-encoded, a zero byte before and after each, so that a damaged frame does not
damage the next one:

    version u8 = 1, kind u8, board u8, boot u16,                    head of all kinds
    seq u16, device_us u32, n u8, n codes u16,                      kind 1, a row
    device_us u32, rate_hz u16, channels u8, firmware ASCII,        kind 2, a hello, once a second
    seq u16, device_us u32, sensor u8, rate_unit f32, force_unit f32, 3 rates i16, 3 forces i16,
                                                                    kind 3, a sample of an inertial sensor
    crc u16                                                         CRC-16, x^16 + x^12 + x^5 + 1, from 0xFFFF

A sample holds the integers of the sensor's registers and what one digit of them stands for, in rad/s and m/s^2, so that
it is complete by itself: no other message has to arrive for it to be read. It is the mean of the time since the sample
before, and device_us is the end of that time; device_us of a row is the middle of its readings. Each sensor has a
counter seq of its own. Boards without inertial sensors send no frames of kind 3; a host that does not know a kind
counts its frames as garbage and reads the others.

Lines, for a lab's own sketch, hold rows alone: `board,seq,device_us,adc0,adc1,...\n`, optionally with `*` and the same
CRC of all before it in four hex digits. From the first line with a checksum on, every line needs one.
"""

import re
import struct
from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import dataclass

from cobs import cobs

from ...models.values.link import Hello, LinkCounts
from ...models.values.units import LARGEST

VERSION = 1
ROW = 1
HELLO = 2
SAMPLE = 3
_HEAD = struct.Struct("<BBBH")
_ROW = struct.Struct("<HIB")
_HELLO = struct.Struct("<IHB")
_SAMPLE = struct.Struct("<HIBff3h3h")
_CRC = struct.Struct("<H")
LONGEST_FRAME = _HEAD.size + _ROW.size + 2 * 255 + _CRC.size + 3
"""Bytes of a frame between two delimiters: a row of 255 channels, and one byte that COBS adds to each 254."""
LONGEST_TEXT = 4096
"""Bytes of a line: more than 255 channels of 24 bits need."""
LARGEST_CODE = (1 << 24) - 1
"""Of a line; frames carry 16 bits."""
LARGEST_RATE_UNIT, LARGEST_FORCE_UNIT = (LARGEST[unit] / (1 << 15) for unit in ("rad_per_s", "m_per_s2"))
"""What one digit of a sample may stand for at most: any digits are in the range of a file then."""
LINE = re.compile(rb"(\d{1,3}),(\d{1,5}),(\d{1,10})((?:,\d{1,8})+)(?:\*([0-9A-Fa-f]{4}))?")


@dataclass(frozen=True, slots=True)
class Row:
    """The readings of one board at one time, as the board sends them."""

    board_id: int
    boot: int
    seq: int
    device_us: int
    codes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample of one inertial sensor of a board, as the board sends it."""

    board_id: int
    boot: int
    sensor: int
    """Number of the sensor on its board."""
    seq: int
    """Counts the samples of this sensor."""
    device_us: int
    rate_unit_rad_per_s: float
    """Rate that one digit stands for."""
    force_unit_m_per_s2: float
    """Specific force that one digit stands for."""
    rate: tuple[int, int, int]
    """Angular rate about the sensor's axes, in digits."""
    force: tuple[int, int, int]
    """Specific force along the sensor's axes, in digits."""


Message = Row | Hello | Sample


class DamagedError(ValueError):
    """Bytes that are not a message; `bad_crc` is true if only the checksum is wrong."""

    def __init__(self, bad_crc: bool) -> None:
        super().__init__("bad CRC" if bad_crc else "garbage")
        self.bad_crc = bad_crc


def frame(message: Message) -> bytes:
    """Return a message as a frame, delimiters before and after."""
    match message:
        case Row():
            kind = ROW
            body = _ROW.pack(message.seq, message.device_us, len(message.codes))
            body += struct.pack(f"<{len(message.codes)}H", *message.codes)
        case Hello():
            kind = HELLO
            body = _HELLO.pack(message.device_us, message.rate_hz, message.channels) + message.firmware.encode("ascii")
        case Sample():
            kind = SAMPLE
            units = (message.rate_unit_rad_per_s, message.force_unit_m_per_s2)
            body = _SAMPLE.pack(message.seq, message.device_us, message.sensor, *units, *message.rate, *message.force)
    payload = _HEAD.pack(VERSION, kind, message.board_id, message.boot) + body
    return b"\0%b\0" % cobs.encode(payload + _CRC.pack(crc_hqx(payload, 0xFFFF)))


def line(row: Row) -> bytes:
    """Return a row as a line with checksum."""
    text = ",".join(map(str, (row.board_id, row.seq, row.device_us, *row.codes))).encode()
    return text + b"*%04X\n" % crc_hqx(text, 0xFFFF)


def parse_frame(encoded: bytes) -> Message:
    """Return the message of the bytes between two delimiters.

    Raises:
        DamagedError: when they are none.
    """
    try:
        checked = cobs.decode(encoded)
    except cobs.DecodeError as error:
        raise DamagedError(bad_crc=False) from error
    payload = checked[: -_CRC.size]
    body = checked[_HEAD.size : -_CRC.size]
    if len(checked) < _HEAD.size + _CRC.size or checked[0] != VERSION:
        raise DamagedError(bad_crc=False)
    if crc_hqx(payload, 0xFFFF) != _CRC.unpack(checked[-_CRC.size :])[0]:
        raise DamagedError(bad_crc=True)
    _, kind, board_id, boot = _HEAD.unpack_from(payload)
    message = _parse_body(kind, board_id, boot, body)
    if message is None:
        raise DamagedError(bad_crc=False)
    return message


def _parse_body(kind: int, board_id: int, boot: int, body: bytes) -> Message | None:
    """Return the message of what stands between head and checksum; None if it does not have the form of its kind."""
    if kind == ROW and len(body) >= _ROW.size and len(body) == _ROW.size + 2 * body[_ROW.size - 1]:
        seq, device_us, n = _ROW.unpack_from(body)
        return Row(board_id, boot, seq, device_us, struct.unpack_from(f"<{n}H", body, _ROW.size))
    if kind == HELLO and len(body) >= _HELLO.size and body[_HELLO.size :].isascii():
        device_us, rate_hz, channels = _HELLO.unpack_from(body)
        return Hello(
            board_id=board_id,
            boot=boot,
            device_us=device_us,
            rate_hz=rate_hz,
            channels=channels,
            firmware=body[_HELLO.size :].decode("ascii"),
        )
    if kind == SAMPLE and len(body) == _SAMPLE.size:
        seq, device_us, sensor, rate_unit, force_unit, *digits = _SAMPLE.unpack(body)
        if 0 < rate_unit <= LARGEST_RATE_UNIT and 0 < force_unit <= LARGEST_FORCE_UNIT:
            rate, force = (digits[0], digits[1], digits[2]), (digits[3], digits[4], digits[5])
            return Sample(board_id, boot, sensor, seq, device_us, rate_unit, force_unit, rate, force)
    return None


def parse_line(text: bytes, needs_checksum: bool) -> Row:
    """Return the row of a line without its end.

    Raises:
        DamagedError: when it is none.
    """
    match = LINE.fullmatch(text.rstrip(b"\r"))
    if match is None or (needs_checksum and match[5] is None):
        raise DamagedError(bad_crc=False)
    if match[5] is not None and crc_hqx(text[: match.start(5) - 1], 0xFFFF) != int(match[5], 16):
        raise DamagedError(bad_crc=True)
    board_id, seq, device_us = (int(match[k]) for k in (1, 2, 3))
    codes = tuple(int(code) for code in match[4][1:].split(b","))
    if board_id > 0xFF or seq > 0xFFFF or device_us > 0xFFFFFFFF or max(codes) > LARGEST_CODE:
        raise DamagedError(bad_crc=False)
    return Row(board_id, 0, seq, device_us, codes)


class _Pieces:
    """Decodes messages separated by delimiters; bytes before the first delimiter may be part of a message.

    What is longer than any message is garbage up to the next delimiter.
    """

    def __init__(self, delimiter: bytes, longest: int, parse: Callable[[bytes], Message | None]) -> None:
        self._delimiter = delimiter
        self._longest = longest
        self._parse = parse
        self._is_too_long = False
        self._rest = b""
        self._begun = False
        self.counts = LinkCounts()

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that the next bytes complete."""
        *pieces, self._rest = (self._rest + data).split(self._delimiter)
        messages = []
        for piece in pieces:
            try:
                if self._is_too_long:
                    self._is_too_long = False
                    raise DamagedError(bad_crc=False)
                message = self._parse(piece) if piece else None
            except DamagedError as error:
                if self._begun:
                    self.counts += LinkCounts(bad_crc=int(error.bad_crc), garbage=int(not error.bad_crc))
            else:
                if message is not None:
                    messages.append(message)
            self._begun = True
        if len(self._rest) > self._longest:
            self._rest, self._is_too_long = b"", True
        self.counts += LinkCounts(messages=len(messages))
        return messages


class FrameDecoder(_Pieces):
    """Decodes frames; after damaged bytes it continues at the next delimiter."""

    def __init__(self) -> None:
        super().__init__(b"\0", LONGEST_FRAME, parse_frame)


class LineDecoder(_Pieces):
    """Decodes lines; a line that begins with `#` is a comment."""

    def __init__(self) -> None:
        super().__init__(b"\n", LONGEST_TEXT, self._line)
        self._checked = False

    def _line(self, text: bytes) -> Row | None:
        if not text.strip() or text.startswith(b"#"):
            return None
        row = parse_line(text, self._checked)
        self._checked |= b"*" in text
        return row


class Decoder:
    """Decodes frames or lines, whichever is received first."""

    def __init__(self) -> None:
        self._candidates: list[FrameDecoder | LineDecoder] = [FrameDecoder(), LineDecoder()]

    @property
    def counts(self) -> LinkCounts:
        """How many messages were intact or damaged so far.

        Before the first intact one, it is not known which kind they are: the counts are those of the kind as which
        most bytes are damaged.
        """
        return max((decoder.counts for decoder in self._candidates), key=lambda counts: counts.garbage)

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that the next bytes complete; no bytes cause an error."""
        for decoder in self._candidates:
            if messages := decoder.feed(data):
                self._candidates = [decoder]
                return messages
        return []
