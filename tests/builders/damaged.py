"""The damaged recordings of tests/broken; run it again after adding one. ORIGIN.md there says what each is."""

import gzip
import zlib
from pathlib import Path

BROKEN = Path(__file__).parent.parent / "broken"
POSE = "1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1"
PIXELS = bytes(range(24))  # two frames of 4 x 3
ITEMS = "".join(
    f"Seq_Frame{i:04d}_ProbeToTrackerTransform = {POSE}\nSeq_Frame{i:04d}_ProbeToTrackerTransformStatus = OK\n"
    f"Seq_Frame{i:04d}_Timestamp = {i}.5\n"
    for i in range(2)
)


def mha(
    pixels=PIXELS,
    size="4 3 2",
    items=ITEMS,
    compressed=False,
    stated=None,
    data="LOCAL",
    extra="",
    element="MET_UCHAR",
):
    header = f"ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = {size}\nElementType = {element}\n{extra}"
    if compressed:
        header += f"CompressedData = True\nCompressedDataSize = {len(pixels) if stated is None else stated}\n"
    return f"{header}UltrasoundImageOrientation = MF\n{items}ElementDataFile = {data}\n".encode() + pixels


def nrrd(pixels, sizes="4 3 2", encoding="gzip", extra="", end="\n"):
    head = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nkinds: domain domain list\n"
    head += f"encoding: {encoding}\n{extra}"
    return (head + ITEMS.replace(" = ", ":=") + end).encode() + pixels


PACKED = zlib.compress(PIXELS)
GZIPPED = gzip.compress(PIXELS, mtime=0)
FLIPPED = PACKED[:-1] + bytes([PACKED[-1] ^ 1])
XML = "<PlusConfiguration/>"

FILES = {
    "cut_file.igs.mha": mha(PACKED[:-9], compressed=True, stated=len(PACKED)),
    "cut_stream.igs.mha": mha(PACKED[:-9], compressed=True),
    "wrong_checksum.igs.mha": mha(FLIPPED, compressed=True),
    "more_pixels.igs.mha": mha(zlib.compress(PIXELS * 2), compressed=True),
    "fewer_pixels.igs.mha": mha(PIXELS[:-1]),
    "overflowing_size.igs.mha": mha(size="4294967296 4294967296 2"),
    "overflowing_count.igs.mha": mha(size="4 3 18446744073709551616"),
    "absurd_size.igs.mha": mha(PACKED, size="40000 40000 2", compressed=True),
    "absurd_count.igs.mha": mha(b"", size="0 0 999999999", element="MET_OTHER"),
    "undescribed_count.igs.mha": mha(b"", size="0 0 1000", element="MET_OTHER"),
    "negative_size.igs.mha": mha(size="-4 3 2"),
    "zero_frames.igs.mha": mha(b"", size="4 3 0", items="Seq_Frame0000_Timestamp = 1\n"),
    "no_end.igs.mha": mha().partition(b"ElementDataFile")[0],
    "latin_1.igs.mha": mha(extra="Comment = Kn\xfcppel\n").replace("\xfc".encode(), b"\xfc"),
    "pixels_for_header.igs.mha": bytes(range(256)) * 4,
    "duplicate_frame.igs.mha": mha(items=ITEMS + "Seq_Frame0001_Timestamp = 9\n"),
    "missing_frame.igs.mha": mha(
        items="".join(line for line in ITEMS.splitlines(True) if "1_Timestamp" not in line)
    ),
    "frame_beyond_size.igs.mha": mha(items=ITEMS + "Seq_Frame0002_Timestamp = 9\n"),
    "short_pose.igs.mha": mha(items=ITEMS.replace(POSE, POSE[:-2])),
    "word_in_pose.igs.mha": mha(items=ITEMS.replace(POSE, POSE[:-1] + "one")),
    "nan_pose.igs.mha": mha(items=ITEMS.replace(POSE, "nan" + POSE[1:], 1)),
    "non_rigid_pose.igs.mha": mha(items=ITEMS.replace(POSE, "0.93" + POSE[1:], 1)),
    "infinite_time.igs.mha": mha(items=ITEMS.replace("1.5", "inf")),
    "text_pixels.mha": mha(element="MET_STRING"),
    "outside.mhd": mha(b"", data="../../../etc/passwd"),
    "absolute.mhd": mha(b"", data="/etc/passwd"),
    "missing_raw.mhd": mha(b"", data="missing_raw.raw"),
    "long_header.mhd": mha(b"", data="long_header.raw", extra="HeaderSize = 99999\n"),
    "long_header.raw": PIXELS,
    "cut_gzip.igs.nrrd": nrrd(GZIPPED[:-9]),
    "wrong_size.igs.nrrd": nrrd(PIXELS, sizes="4 4 2", encoding="raw"),
    "no_end.igs.nrrd": nrrd(b"", end=""),
    "unknown_encoding.igs.nrrd": nrrd(GZIPPED, encoding="bzip2"),
    "outside.nhdr": nrrd(b"", encoding="raw", extra="data file: ../../../etc/passwd\n"),
    "no_dimension.nrrd": b"NRRD0004\ntype: uint8\nsizes: 4 3\nencoding: raw\n\n" + PIXELS[:12],
    "bomb.xml": ('<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "' + "&a;" * 100 + '">]>' + XML).encode(),
    "external_entity.xml": ('<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + XML).encode(),
}


if __name__ == "__main__":
    for name, content in FILES.items():
        (BROKEN / name).write_bytes(content)
