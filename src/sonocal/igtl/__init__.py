"""OpenIGTLink, the protocol in which trackers and scanners speak with PLUS, 3D Slicer and robots."""

from sonocal.igtl.client import Client, address
from sonocal.igtl.control import Other, Query, Reply, Start
from sonocal.igtl.header import HEADER_BYTES, MOST_BODY, Header, read_header
from sonocal.igtl.image import Image
from sonocal.igtl.message import Message, decode, decode_body, encode, stamp_of
from sonocal.igtl.plus import HeldTransform, PlusServer
from sonocal.igtl.poses import Position, QuaternionTool, QuaternionTools, Tool, Tools, Transform
from sonocal.igtl.server import Arrival, Server
from sonocal.igtl.words import Capability, Command, CommandReply, Status, Text

__all__ = [
    "HEADER_BYTES",
    "MOST_BODY",
    "Arrival",
    "Capability",
    "Client",
    "Command",
    "CommandReply",
    "Header",
    "HeldTransform",
    "Image",
    "Message",
    "Other",
    "PlusServer",
    "Position",
    "QuaternionTool",
    "QuaternionTools",
    "Query",
    "Reply",
    "Server",
    "Start",
    "Status",
    "Text",
    "Tool",
    "Tools",
    "Transform",
    "address",
    "decode",
    "decode_body",
    "encode",
    "read_header",
    "stamp_of",
]
