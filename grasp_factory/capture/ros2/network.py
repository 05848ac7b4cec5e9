"""The part of the network where topics are: a domain on one interface, this machine by default.

Settings of Cyclone DDS: https://cyclonedds.io/docs/cyclonedds/latest/config/config_file_reference.html
"""

from __future__ import annotations

import re
import socket
import threading
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakValueDictionary

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant

from grasp_factory.core.serialization import check, check_range, normalise
from grasp_factory.errors import CaptureError, ConfigError, shown

LOOPBACK = "lo"
LARGEST_DOMAIN = 232
"""Larger ones have no free ports: https://docs.ros.org/en/humble/Concepts/About-Domain-ID.html"""
SOCKET_BUFFER = 4 * 2**20
"""Bytes that are asked for. With the usual 208 kB, two cameras of 640x480 at 30 Hz lose images."""
_MESSAGE = 65500
"""Bytes of a packet: the most that UDP carries, with room for headers."""
_LARGEST_SAMPLE = 256 * 2**20
"""Bytes of a message that is received; a larger one is not."""
_LOCAL_PARTICIPANTS = 40
"""Programs on this machine that can find each other without multicast."""
_FAST_DDS = "1.15"
"""The vendor whose descriptions of types are ignored: those of Kilted would refuse ours."""
_INTERFACE = re.compile(r"[A-Za-z0-9_.:@-]{1,15}")
_KERNEL_LIMIT = Path("/proc/sys/net/core/rmem_max")
_CONFIG = """<CycloneDDS><Domain Id="{domain}">
<General><Interfaces><NetworkInterface name="{interface}"{more}/></Interfaces>
<AllowMulticast>{multicast}</AllowMulticast><MaxMessageSize>{message}B</MaxMessageSize></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>{participants}</MaxAutoParticipantIndex>{peers}</Discovery>
<Internal><MaxSampleSize>{sample}B</MaxSampleSize>
<SocketReceiveBufferSize max="{buffer}B"/>
<SocketSendBufferSize max="{buffer}B"/>
</Internal><Tracing><Verbosity>none</Verbosity></Tracing>
<Compatibility><IgnoreTypeInformation>{vendor}</IgnoreTypeInformation></Compatibility>
</Domain></CycloneDDS>"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2Network:
    """Where topics are."""

    domain_id: int = 0
    """``ROS_DOMAIN_ID`` of the others."""
    interface: str = LOOPBACK
    """Network interface; ``lo`` reaches programs on this machine only."""

    def __post_init__(self) -> None:
        normalise(self)
        check_range(self, "domain_id", 0, LARGEST_DOMAIN)
        is_name = _INTERFACE.fullmatch(self.interface) is not None
        check(is_name, "interface", self.interface, "a network interface such as lo or eth0")

    def config(self) -> str:
        """Return the settings of Cyclone DDS."""
        is_local = self.interface == LOOPBACK
        return _CONFIG.format(
            domain=self.domain_id,
            interface=self.interface,
            more=' multicast="false"' if is_local else "",
            multicast="false" if is_local else "default",
            message=_MESSAGE,
            participants=_LOCAL_PARTICIPANTS,
            peers='<Peers><Peer Address="127.0.0.1"/></Peers>' if is_local else "",
            sample=_LARGEST_SAMPLE,
            buffer=SOCKET_BUFFER,
            vendor=_FAST_DDS,
        )


class _OpenDomain:
    """A domain of this process; Cyclone DDS allows one of each id."""

    def __init__(self, network: Ros2Network) -> None:
        self.network = network
        self.domain = Domain(network.domain_id, network.config())


_domains: WeakValueDictionary[int, _OpenDomain] = WeakValueDictionary()
_lock = threading.Lock()


class Participant:
    """A member of a domain, which publishers and subscribers of this process belong to.

    Attributes:
        network: where it is.
        dds: Cyclone DDS's own object.
    """

    def __init__(self, network: Ros2Network) -> None:
        """Join a domain.

        Raises:
            CaptureError: if the interface is not there.
            ConfigError: if this process has joined the domain on another interface.
        """
        _check_interface(network.interface)
        self.network = network
        with _lock:
            self._domain = _joined(network)
        try:
            self.dds = DomainParticipant(network.domain_id)
        except DDSException as error:
            raise _refused(network, error) from None


def _joined(network: Ros2Network) -> _OpenDomain:
    found = _domains.get(network.domain_id)
    if found is None:
        try:
            found = _domains[network.domain_id] = _OpenDomain(network)
        except DDSException as error:
            raise _refused(network, error) from None
    if found.network != network:
        raise ConfigError(
            f"interface: got {network.interface} for domain {network.domain_id}, valid:"
            f" {found.network.interface}, with which this process uses the domain already"
        )
    return found


def _check_interface(name: str) -> None:
    """Check that an interface is there; else Cyclone DDS would print a line of its own."""
    there = [interface for _, interface in socket.if_nameindex()]
    if name not in there:
        raise CaptureError(f"interface: got {shown(name)}, valid: {', '.join(there)}")


def _refused(network: Ros2Network, error: DDSException) -> CaptureError:
    return CaptureError(
        f"domain {network.domain_id} on the interface {network.interface} cannot be joined (error"
        f" {error.code} of Cyclone DDS): check with `ip link` that the interface is up"
    )


def small_socket_buffers() -> str:
    """Return a sentence if the system's limit makes socket buffers too small; else nothing."""
    try:
        most = int(_KERNEL_LIMIT.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return ""
    if most >= SOCKET_BUFFER:
        return ""
    return (
        f"the system limits socket buffers to {most} bytes, so images can be lost: run `sysctl -w"
        f" net.core.rmem_max={SOCKET_BUFFER} net.core.wmem_max={SOCKET_BUFFER}` as root"
    )
