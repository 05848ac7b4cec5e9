"""A publisher of messages as bytes."""

from __future__ import annotations

from cyclonedds.core import DDSException
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from grasp_factory.capture.ros2.dds_names import check_topic, dds_topic
from grasp_factory.capture.ros2.message_types import sample_of, sample_type_of, type_hash
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.quality_of_service import TopicQuality
from grasp_factory.errors import CaptureError


class TopicPublisher:
    """Sends messages on one topic. One thread uses it.

    Attributes:
        name: the topic.
        sent: messages so far.
    """

    def __init__(
        self, participant: Participant, name: str, kind: str, quality: TopicQuality
    ) -> None:
        """Announce the topic.

        Args:
            participant: the member of a domain that it belongs to.
            name: the topic, such as ``/imu/data``.
            kind: the type of its messages, such as ``sensor_msgs/msg/Imu``.
            quality: its quality of service.

        Raises:
            UsageError: for a name or a type that ROS does not have.
        """
        check_topic(name)
        self._participant = participant  # its domain ends when nothing refers to it
        self.name, self.sent = name, 0
        self._sample_type = sample_type_of(kind)
        topic = Topic(participant.dds, dds_topic(name), self._sample_type)
        policies = quality.policies(f"typehash={type_hash(kind)};")
        self._writer = DataWriter(participant.dds, topic, policies)

    @property
    def subscribers(self) -> int:
        """How many there are now."""
        return int(self._writer.get_publication_matched_status().current_count)

    def send(self, data: bytes) -> None:
        """Send a message, CDR with its header.

        Raises:
            CaptureError: if a subscriber does not take messages in time.
        """
        try:
            self._writer.write(sample_of(self._sample_type, data))
        except DDSException as error:
            if error.code == DDSException.DDS_RETCODE_TIMEOUT:
                raise CaptureError(
                    f"{self.name}: a subscriber has taken no message for 10 s: end it, or send with"
                    " --reliability best-effort"
                ) from None
            raise CaptureError(f"{self.name}: message {self.sent} was not sent: {error}") from None
        self.sent += 1

    def wait_until_received(self, timeout_s: float) -> bool:
        """Wait until all reliable subscribers have all messages; return whether they do."""
        # The public method of Cyclone DDS 11.0.1 raises AttributeError when the time is over.
        code = self._writer._wait_for_acks(self._writer._ref, duration(seconds=timeout_s))
        return bool(code == DDSException.DDS_RETCODE_OK)
