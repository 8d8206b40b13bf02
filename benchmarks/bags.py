"""Memory and time of reading large ROS bags: images of a gigabyte, one after the other.

    python -m benchmarks.bags [--images 1024]

Each bag is written into the temporary folder, read by a process of its own, and removed. The memory is all that the
process had at most, Python and NumPy included.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

SIDE = 1024
KIND = "sensor_msgs/msg/Image"
FORMS = ("ROS 1", "MCAP", "SQLITE3")
READER = """
import json, resource, sys, time
import sonocal
start = time.process_time()
recording = sonocal.read_recording(sys.argv[1])
opened = time.process_time()
total = sum(int(frame[0, 0]) for frame in recording.frames)
scale = 1 if sys.platform == "darwin" else 1024
memory = scale * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps([len(recording), memory, opened - start, time.process_time() - opened]))
"""


def writer_of(form, path):
    """A writer of rosbags, and the definitions of its messages."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    if form == "ROS 1":
        return rosbag1.Writer(path), get_typestore(Stores.ROS1_NOETIC)
    plugin = rosbag2.StoragePlugin[form]
    return rosbag2.Writer(path, version=9, storage_plugin=plugin), get_typestore(Stores.LATEST)


def write(form, path, count):
    """A bag of so many noisy images."""
    writer, store = writer_of(form, path)
    base = np.random.default_rng(0).integers(0, 255, (SIDE, SIDE), dtype=np.uint8)
    encode = store.serialize_ros1 if form == "ROS 1" else store.serialize_cdr
    make = store.types
    sequence = {"seq": 0} if form == "ROS 1" else {}
    with writer:
        connection = writer.add_connection("/us", KIND, typestore=store)
        for i in range(count):
            stamp = make["builtin_interfaces/msg/Time"](sec=1 + i, nanosec=0)
            header = make["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="us")
            pixels = (base + np.uint8(i % 200)).ravel()
            image = make[KIND](header, SIDE, SIDE, "mono8", 0, SIDE, pixels)
            writer.write(connection, (1 + i) * 10**9, encode(image, KIND))


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=1024)
    count = parser.parse_args().images
    print(f"{count} images of {SIDE} x {SIDE} px, {count * SIDE**2 / 1e6:.0f} MB")
    for form in FORMS:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "big.bag"
            write(form, path, count)
            done = subprocess.run(
                [sys.executable, "-c", READER, str(path)], capture_output=True, text=True, check=True
            )
        items, memory, opening, reading = json.loads(done.stdout)
        assert items == count
        print(f"  {form:8} {memory / 1e6:6.0f} MB   opened in {opening:5.2f} s, images in {reading:5.2f} s")


if __name__ == "__main__":
    main()
