"""The ROS 2 graph as rmw_zenoh announces it: one liveliness token for each publisher.

Layout of a token: ``@ros2_lv/<domain>/<session>/<node id>/<id>/<kind>/<enclave>/<namespace>/<node>/
<topic>/<type>/<hash>/<qos>``, with ``%`` for each slash within a part (rmw_zenoh,
`liveliness_utils.cpp`).
"""

from __future__ import annotations

from typing import Final, NamedTuple

PREFIX: Final = "@ros2_lv"
TOKENS: Final = f"{PREFIX}/**"
_PUBLISHER: Final = "MP"
_NODE: Final = "NN"
_PARTS: Final = 13
# Reliable, volatile, the last one kept: what differs from ROS's default profile is written out.
_QOS: Final = "::,1:,:,:,,"
_ENCLAVE: Final = "%"
_NAMESPACE: Final = "%"


class Publisher(NamedTuple):
    """A publisher of ROS 2.

    Attributes:
        domain: ROS_DOMAIN_ID.
        topic: such as ``/scan``.
        type_name: such as ``sensor_msgs/LaserScan``.
        type_hash: with its scheme, such as ``RIHS01_...``.
        node: its name, with its namespace.
    """

    domain: int
    topic: str
    type_name: str
    type_hash: str
    node: str


def parse_publisher(token: str) -> Publisher | None:
    """Read the token of a publisher; None for anything else."""
    parts = token.split("/")
    if len(parts) != _PARTS or parts[0] != PREFIX or parts[5] != _PUBLISHER:
        return None
    domain, (namespace, node), type_name = parts[1], parts[7:9], parts[10]
    if not (domain.isascii() and domain.isdecimal() and len(domain) <= 3):
        return None
    path = "" if namespace == _NAMESPACE else namespace.replace("%", "/")
    package, _, name = type_name.partition("::msg::dds_::")
    topic = parts[9].replace("%", "/")
    return Publisher(
        int(domain), topic, f"{package}/{name.removesuffix('_')}", parts[11], f"{path}/{node}"
    )


def node_token(session: str, node: str, domain: int) -> str:
    """Return the token of a node of ours.

    Args:
        session: id of the Zenoh session, in hexadecimal.
        node: its name.
        domain: ROS_DOMAIN_ID.
    """
    return f"{PREFIX}/{domain}/{session}/0/0/{_NODE}/{_ENCLAVE}/{_NAMESPACE}/{node}"


def publisher_token(session: str, node: str, key: str) -> str:
    """Return the token of a publisher of that node, so that ROS lists its topic.

    Args:
        session: id of the Zenoh session, in hexadecimal.
        node: its name.
        key: that it publishes under: domain, topic, type and hash.
    """
    domain, *topic, type_name, type_hash = key.split("/")
    parts = (PREFIX, domain, session, "0", "1", _PUBLISHER, _ENCLAVE, _NAMESPACE, node)
    return "/".join((*parts, "%" + "%".join(topic), type_name, type_hash, _QOS))
