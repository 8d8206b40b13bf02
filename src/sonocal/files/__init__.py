"""Bytes, tables and pictures in files, with every failure turned into one sentence; what a format says of itself."""

from sonocal.files.disk import (
    beside,
    digest,
    file_beside,
    file_size,
    make_folder,
    path_of,
    read_at,
    read_bytes,
    read_text,
    reading,
    refuse_device,
    remove,
    write_atomically,
    write_into_folder,
    writing,
)

__all__ = [
    "beside",
    "digest",
    "file_beside",
    "file_size",
    "make_folder",
    "path_of",
    "read_at",
    "read_bytes",
    "read_text",
    "reading",
    "refuse_device",
    "remove",
    "write_atomically",
    "write_into_folder",
    "writing",
]
