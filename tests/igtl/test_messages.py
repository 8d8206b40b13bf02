"""Laws of messages: what is sent arrives, byte for byte; what is damaged is refused in a sentence."""

import random
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError, SonocalError, igtl
from sonocal.igtl.fields import checksum
from tests.builders.damage import damage
from tests.builders.igtl_calls import sent_again
from tests.builders.messages import REFERENCES, TYPES, as_sent, contents, messages, pixels, pose, with_crc

MESSAGES = messages()


def crc_by_bits(data, crc=0):
    """The definition of ECMA-182, bit by bit."""
    for byte in data:
        crc ^= byte << 56
        for _ in range(8):
            crc = (crc << 1 ^ (0x42F0E1EBA9EA3693 if crc >> 63 else 0)) & (1 << 64) - 1
    return crc


@given(st.binary(max_size=70), st.binary(max_size=20))
def test_the_checksum_is_that_of_its_definition_in_one_piece_or_two(first, second):
    assert checksum(first) == crc_by_bits(first)
    assert checksum(second, checksum(first)) == checksum(first + second)


def test_the_checksum_is_the_published_one():
    assert checksum(b"123456789") == 0x6C40DF5F0B497347


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: f"{m.kind}-v{m.version}")
def test_what_is_decoded_says_what_was_encoded(message):
    data = as_sent(message)
    again = igtl.decode(data)
    assert as_sent(again) == data
    assert (again.kind, again.device, again.stamp, again.version) == (
        message.kind,
        message.device,
        message.stamp,
        message.version,
    )
    if message.version == 2:
        assert (again.meta, again.identity) == (message.meta, message.identity)
    for name, value in vars(message.content).items():
        other = getattr(again.content, name)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(other, value)
        elif name not in ("tools", "matrix"):
            assert other == value


@pytest.mark.skipif(not REFERENCES.is_dir(), reason="no reference messages in ../shared/data/igtl")
def test_the_reference_messages_come_back_byte_for_byte():
    paths = sorted(REFERENCES.glob("*.bin"))
    assert len(paths) == 21
    for path in paths:
        data = path.read_bytes()
        assert as_sent(igtl.decode(data, path.name)) == data, path.name


@pytest.mark.skipif(not REFERENCES.is_dir(), reason="no reference messages in ../shared/data/igtl")
def test_the_reference_messages_say_what_the_library_put_into_them():
    def read(name):
        return igtl.decode((REFERENCES / f"{name}.bin").read_bytes())

    matrix = read("transform").content.matrix
    assert matrix[:3, 3] == pytest.approx([46.0531, 19.4709, 46.0531], abs=1e-4)
    assert matrix[:3, 0] == pytest.approx([-0.954892, 0.196632, -0.222525], abs=1e-6)
    assert read("transform_v2").meta == {"First patient age": "22", "Second patient age": "25"}
    assert read("position").content.quaternion == pytest.approx([1 / 3, 0, 0.577350269, 0.577350269])
    assert [tool.name for tool in read("tdata").content.tools] == ["Tracker0", "Tracker1", "Tracker2"]
    assert read("string").content.text == "Welcome to OpenIGTLink"
    assert read("status").content == igtl.Status(15, 10, "ACTUATOR_DISABLED", "Actuator A is disabled.")
    assert read("capability").content.types == ("IMAGE", "GET_IMAGE", "TRANSFORM", "GET_TRANS")
    assert read("command").content == igtl.Command(5, "This is a test command", "Start the tracking machine")


@pytest.mark.parametrize("name", TYPES)
@pytest.mark.parametrize("order", [1, 2])
def test_pixels_arrive_in_whichever_byte_order(name, order):
    data = bytearray(as_sent(igtl.Message(igtl.Image.of(pixels(name)))))
    data[58 + 4] = order
    data[58 + 72 :] = pixels(name).astype((">" if order == 1 else "<") + name).tobytes()
    image = igtl.decode(with_crc(bytes(data))).content
    assert image.pixels.dtype.isnative
    np.testing.assert_array_equal(image.pixels[0], pixels(name))


def test_parts_of_a_volume_make_the_whole():
    whole = pixels("u2", (4, 5, 6))
    found = np.zeros_like(whole)
    for first in (0, 2):
        sent = igtl.Image(whole[first : first + 2], (6, 5, 4), (0, 0, first))
        igtl.decode(as_sent(igtl.Message(sent))).content.placed_in(found)
    np.testing.assert_array_equal(found, whole)
    with pytest.raises(InputError, match=r"the whole must be of \(4, 5, 6\) uint16; got \(1, 1, 1\) uint16"):
        sent.placed_in(whole[:1, :1, :1])


def test_a_long_name_is_cut_and_stands_whole_in_the_meta_data():
    name = "StylusTipToReferenceOfTheRoom"
    both = [
        igtl.decode(as_sent(igtl.Message(igtl.Transform(pose()), name, version=version)))
        for version in (1, 2)
    ]
    assert [one.device for one in both] == [name[:20]] * 2
    assert [one.name for one in both] == [name[:20], name]


def test_a_lost_tool_is_said_in_the_meta_data():
    content = igtl.Transform(pose())
    assert igtl.Message(content).valid
    assert not igtl.Message(content, version=2, meta={"TransformStatus": "INVALID"}).valid


REFUSED = {
    "checksum": (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "its checksum is .* the message is damaged"),
    "short": (lambda data: with_crc(data[:-4]), "48 bytes are due, 44 arrived"),
    "cut": (lambda data: data[:-4], "48 bytes are due, 44 arrived; send it again"),
    "version": (
        lambda data: b"\0\7" + data[2:],
        r"no header of OpenIGTLink 1 or 2 \(version 7, type 'TRANSF",
    ),
    "type": (lambda data: data[:2] + b"\0" * 12 + data[14:], "no header of OpenIGTLink"),
    "web": (lambda data: b"HTTP/1.1 400 Bad Request".ljust(58), "is it an OpenIGTLink server that sends"),
    "2^60": (
        lambda data: data[:42] + (1 << 60).to_bytes(8, "big") + data[50:],
        "a TRANSFORM of 1152921504606846976 bytes is announced, more than the 268435456",
    ),
    "nothing": (lambda data: b"", "a header has 58 bytes, 0 arrived"),
}


@pytest.mark.parametrize("damaged, sentence", REFUSED.values(), ids=REFUSED)
def test_damage_is_said(damaged, sentence):
    data = as_sent(igtl.Message(igtl.Transform(pose()), "ProbeToTracker"))
    with pytest.raises(FormatError, match=sentence):
        igtl.decode(damaged(data), "localhost:18944, message 3")


@pytest.mark.parametrize(
    "body, sentence",
    [
        (struct.pack(">HHII", 12, 2, 5, 0), "meta data of 2 . 5 bytes do not fit into the body of 12"),
        (struct.pack(">HHII", 3, 0, 0, 0), "an extended header of 3 bytes"),
        (struct.pack(">HHIIH", 12, 2, 0, 0, 4), "4 entries of meta data take 34 bytes of index, 2 are there"),
        (struct.pack(">HHIIHHHI", 12, 10, 1, 0, 1, 2, 3, 9) + b"a", "its index asks for 11"),
    ],
)
def test_damaged_meta_data_are_said(body, sentence):
    header = igtl.Header(2, "STRING", "", 0, len(body), checksum(body))
    with pytest.raises(FormatError, match=sentence):
        igtl.decode(header.as_bytes() + body)


@pytest.mark.parametrize(
    "message, sentence",
    [
        (igtl.Message(igtl.Transform(np.eye(3))), r"must have shape \(4, 4\); got \(3, 3\)"),
        (igtl.Message(igtl.Tools((igtl.Tool("n" * 21, pose()),))), "a tool's name must be at most 20 bytes"),
        (igtl.Message(igtl.Text("x" * 70000)), "a text to send must be at most 65535 bytes; got 70000"),
        (igtl.Message(igtl.Image.of(pixels("i8"))), "pixels to send must be whole numbers of 8 to 32 bits"),
        (igtl.Message(igtl.Text(""), stamp=-1), "a stamp must be between 0 and 2.64; got -1"),
    ],
)
def test_what_does_not_fit_is_not_sent(message, sentence):
    with pytest.raises(InputError, match=sentence):
        igtl.encode(message)


@pytest.mark.parametrize("time_s", [-1.0, float("nan"), float("inf"), 2.0**32])
def test_a_stamp_is_of_this_age(time_s):
    with pytest.raises(InputError, match="seconds since 1970"):
        igtl.stamp_of(time_s)


@given(damage(), st.integers(0, 10**6), st.booleans())
def test_mutated_messages_end_in_a_sentence_or_an_answer(damaged, which, mended):
    data = damaged(as_sent(random.Random(which).choice(MESSAGES)))
    try:
        message = igtl.decode(with_crc(data) if mended else data)
    except SonocalError as error:
        assert "\n" not in str(error)
    else:
        sent_again(message)


def test_every_type_is_among_the_messages_that_the_laws_run_on():
    from sonocal.igtl.message import _CONTENTS

    assert set(_CONTENTS) <= {content.kind for content in contents()}
