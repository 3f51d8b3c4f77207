"""Lengths of tendons from a bag of ROS 2: an MCAP file, or the directory that `ros2 bag record` writes."""

import re
import struct
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.values.errors import InputError, needs_extra

JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
SUFFIXES_OF_BAGS = (".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Return whether a path is that of a bag, by its name, or because it is a directory."""
    return path.suffix in SUFFIXES_OF_BAGS or path.is_dir()


class LengthsBag:
    """The messages of one topic as rows of lengths.

    Iterating gives t_s and the length of each tendon that has a sensor, nan if it is not told. t_s is the stamp of the
    message minus that of the first: the one in its header, or where the first message has none, the time of recording.

    Raises:
        InputError: for a bag that cannot be read, a topic that is not there, or a message that does not hold lengths of
            the tendons; the text names file, topic and message.
    """

    def __init__(self, path: Path, topic: str | None, tendons: Sequence[int]) -> None:
        """Choose the topic.

        Args:
            path: of the bag.
            topic: name; None for the only one that fits.
            tendons: numbers of the tendons that have a sensor, in order.
        """
        self.path = path
        self._tendons = tendons
        with self._opened() as reader:
            self.topic = self._choice(reader, topic)

    def place(self, index: int) -> str:
        """Return where a row is, the first of which has the index 0."""
        return f"{self.path}: {self.topic}: message {index + 1}"

    def message_count(self) -> int:
        """Return the number of messages."""
        with self._opened() as reader:
            return sum(int(connection.msgcount) for connection in _connections(reader, self.topic))

    def __iter__(self) -> Iterator[list[float]]:
        with self._opened() as reader:
            first_ns = 0
            has_header = True
            for index, (recorded_ns, message) in enumerate(self._messages(reader, self.topic)):
                with _as_its_type_says(self.place(index)):
                    told_ns = header_ns(message)
                    length_m = lengths_of(message, self._tendons, self.place(index))
                if index == 0:
                    has_header = told_ns != 0
                stamp_ns = told_ns if has_header else recorded_ns
                if stamp_ns == 0:
                    raise InputError(f"{self.place(index)}: header.stamp: expected a time, as in the first, got 0")
                first_ns = first_ns or stamp_ns
                yield [1e-9 * (stamp_ns - first_ns), *length_m]

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        with needs_extra(f"{self.path}: a bag", "ros2"):
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        if not self.path.exists():
            raise InputError(f"{self.path}: no such file")
        try:
            with warnings.catch_warnings(action="ignore"):  # of ruamel.yaml, at metadata that are then refused
                reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
                reader.open()
        except (TypeError, AttributeError, LookupError) as error:
            raise InputError(f"{self.path}: cannot be read as a bag: its metadata are not those of a bag") from error
        except Exception as error:  # what rosbags and its readers of YAML, SQLite and MCAP raise
            raise InputError(f"{self.path}: cannot be read as a bag: {_one_line(error)}") from error
        try:
            self._check_topics(reader.connections)
            yield reader
        finally:
            reader.close()

    def _check_topics(self, connections: Iterable[Any]) -> None:
        """Raise InputError for topics whose names or numbers of messages are none; rosbags takes what the YAML says."""
        for connection in connections:
            topic, count = connection.topic, connection.msgcount
            if not isinstance(topic, str):
                raise InputError(f"{self.path}: topic: expected a name, got {topic!r}")
            if type(count) is not int or not 0 <= count < 2**63:
                raise InputError(f"{self.path}: {topic}: message_count: expected a number of messages, got {count!r}")

    def _choice(self, reader: Any, topic: str | None) -> str:
        """Return the topic that is asked for, or the only one that fits."""
        kinds = {c.topic: c.msgtype for c in reader.connections}
        known = [str(name) for name, kind in kinds.items() if kind in (JOINT_STATE, MULTI_ARRAY)]
        if topic is not None:
            if topic not in known:
                got = f"'{topic}' of {kinds[topic]}" if topic in kinds else f"'{topic}', which is not in the bag"
                raise InputError(f"{self.path}: topic: expected one of {', '.join(known) or 'none'}, got {got}")
            return topic
        fitting = [name for name in known if self._fits(reader, name)]
        if len(fitting) != 1:
            raise InputError(
                f"{self.path}: topic: is missing: exactly one JointState or Float64MultiArray would have to hold "
                f"{len(self._tendons)} lengths, got {', '.join(fitting or known) or 'none'}"
            )
        return fitting[0]

    def _fits(self, reader: Any, topic: str) -> bool:
        """Return whether the first message of a topic holds lengths of the tendons."""
        try:
            _, message = next(self._messages(reader, topic))
            with _as_its_type_says(topic):
                lengths_of(message, self._tendons, topic)
        except (StopIteration, InputError):
            return False
        return True

    def _messages(self, reader: Any, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield when each message was recorded, ns, and the message."""
        count = 0
        try:
            for connection, recorded_ns, data in reader.messages(_connections(reader, topic)):
                message = reader.deserialize(data, connection.msgtype)
                count += 1
                yield recorded_ns, message
        except Exception as error:  # damaged bytes: what rosbags, struct, zstd and others raise
            raise InputError(
                f"{self.path}: {topic}: message {count + 1}: cannot be read: {_one_line(error)}"
            ) from error


@contextmanager
def _as_its_type_says(where: str) -> Iterator[None]:
    """Say that the definition of a message, which a bag contains, is another than that of its type."""
    try:
        yield
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{where}: its fields are not those of its type: {_one_line(error)}") from error


def lengths_of(message: Any, tendons: Sequence[int], where: str) -> NDArray[np.float64]:
    """Return (sensed,) lengths of a JointState or a Float64MultiArray, m; nan for a tendon that is not named.

    Args:
        message: its lengths are `position`, or `data` from `layout.data_offset` on.
        tendons: (sensed,) numbers of the tendons that have a sensor, in order.
        where: place of the message, for errors.

    Raises:
        InputError: for another number of lengths, or names that do not tell the tendons.
    """
    if message.__msgtype__ == MULTI_ARRAY:
        name, values, names = "data", message.data[message.layout.data_offset :], []
    else:
        name, values, names = "position", message.position, message.name
    expected = len(names) or len(tendons)
    if len(values) != expected:
        raise InputError(f"{where}: {name}: expected {expected} lengths, got {len(values)}")
    length_m = np.full(len(tendons), np.nan)
    length_m[_named_tendons(names, tendons, where) if names else np.arange(len(tendons))] = values
    return length_m


def _named_tendons(names: Sequence[str], tendons: Sequence[int], where: str) -> list[int]:
    """Return the place of each name among the tendons: the number at its end, as in `tendon_7`."""
    known = {number: place for place, number in enumerate(tendons)}
    numbers = f"from {tendons[0]} to {tendons[-1]}" if len(tendons) else "of which there is none"
    found: list[int] = []
    for name in names:
        digits = re.search(r"[0-9]+$", name)
        place = known.get(int(digits[0])) if digits else None
        if place is None or place in found:
            raise InputError(
                f"{where}: name: expected names that end in the number of a tendon with a sensor, {numbers}, each "
                f"once, or no names, got '{name}'"
            )
        found.append(place)
    return found


def header_ns(message: Any) -> int:
    """Return the stamp in the header of a JointState since 1970; 0 of a Float64MultiArray, which has none."""
    if message.__msgtype__ == MULTI_ARRAY:
        return 0
    return 10**9 * int(message.header.stamp.sec) + int(message.header.stamp.nanosec)


def _connections(reader: Any, topic: str) -> list[Any]:
    return [connection for connection in reader.connections if connection.topic == topic]


def _one_line(error: Exception) -> str:
    """Return what an error says; of bag metadata, rosbags repeats the words of Python, as of bytes that are damaged."""
    is_of_python = isinstance(error, UnicodeDecodeError | struct.error)
    said = "" if is_of_python else " ".join(str(error).split())
    is_of_metadata = said.startswith(("Invalid bag metadata", "A metadata key is missing"))
    return "metadata.yaml is not that of a bag" if is_of_metadata else said or "it is damaged"
