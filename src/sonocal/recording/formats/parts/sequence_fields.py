"""The fields that PLUS keeps of every item of a sequence, shared by its MetaIO and NRRD files.

``Seq_Frame0042_ProbeToTrackerTransform = m00 m01 ... m33``, ``...TransformStatus = OK``,
``...Timestamp = 12.5``, ``...ImageStatus = OK`` (``...Status`` in NRRD) and whatever else was recorded.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.geometry import Array
from sonocal.recording.poses import Poses, by_name

__all__ = ["IMAGE_STATUS", "PREFIX", "TRANSFORM", "ItemFields", "interpret", "sixteen_each"]

PREFIX = "Seq_Frame"
TRANSFORM = re.compile(r"(.+?)To([A-Z0-9_].*)Transform")
IMAGE_STATUS = ("ImageStatus", "Status")
# PLUS pads to four digits and other writers to ten; what has more than a whole number of 64 bits holds is no frame.
NUMBER_DIGITS = 18
# How Microsoft's C library spells what is no number, also cut or padded to the digits asked for: 1.#QNAN, -1.#IND00,
# nan(ind). Its infinities are no poses either.
NO_NUMBER = re.compile(r"[-+]?(?:1\.#[A-Z]+[0-9]*|nan\([a-z]+\))", re.IGNORECASE)


@dataclass
class ItemFields:
    """Fields as they are met while a header is read: field name -> item number -> text."""

    name: str
    columns: dict[str, dict[int, str]] = field(default_factory=dict)

    def add(self, key: str, value: str) -> None:
        """Keep one ``Seq_Frame<number>_<field>``.

        Raises:
            FormatError: the key is not of that form, or stands twice.
        """
        number, _, item_field = key[9:].partition("_")
        if not (number.isdecimal() and len(number) <= NUMBER_DIGITS and item_field):
            raise FormatError(f"{self.name}: header field {key[:80]!r} is not Seq_Frame<number>_<name>")
        index = int(number)
        column = self.columns.get(item_field)
        if column is None:
            column = self.columns[item_field] = {}
        if index in column:
            raise FormatError(
                f"{self.name}, frame {index}: {item_field} stands twice in the header; delete one"
            )
        column[index] = value

    def take(self, lines: Iterable[tuple[int, str]], separator: str) -> Iterator[tuple[int, str]]:
        """Keep the lines ``Seq_Frame<number>_<field> = ...`` of numbered ones; gives the others.

        What `add` does, in one loop for an hour's million lines.

        Raises:
            FormatError: as `add`.
        """
        columns, usual = self.columns, _usual_line(separator)
        for line, text in lines:
            if match := usual(text):
                number, item_field, value = match.groups()
                column = columns.get(item_field)
                if column is not None and (index := int(number)) not in column:
                    column[index] = value.strip()
                    continue
            key, equals, value = text.partition(separator)
            if text.startswith(PREFIX) and equals and separator[0] not in key:
                self.add(key.rstrip(), value.strip())
            else:
                yield line, text

    @property
    def count(self) -> int:
        """One more than the largest item number."""
        return 1 + max((max(column) for column in self.columns.values()), default=-1)


def _usual_line(separator: str) -> Callable[[str], re.Match[str] | None]:
    """Takes a line as nearly all are apart, in one step: the number, the field's name without blanks, the value."""
    name = rf"[^\s{separator[0]}]+"
    return re.compile(rf"{PREFIX}(\d{{1,{NUMBER_DIGITS}}})_({name})\s*{separator}(.*)", re.DOTALL).fullmatch


@dataclass(frozen=True, eq=False)
class Items:
    """What the fields of the items mean: the arguments of a `Recording`."""

    times: Array
    poses: dict[str, Poses]
    image_valid: np.ndarray[tuple[int], np.dtype[np.bool_]]
    others: dict[str, tuple[str | None, ...]]


def interpret(fields: ItemFields, count: int) -> Items:
    """Times, poses and the rest of `count` items.

    Raises:
        FormatError: an item number is beyond `count`, or a pose or time is not of numbers.
        InputError: some items have a time and others do not.
    """
    if fields.count > count:
        raise FormatError(
            f"{fields.name}: the header describes frame {fields.count - 1} but states {count} frames; "
            "correct the size or the field numbers"
        )
    columns = dict(fields.columns)
    times = _times(fields.name, columns.pop("Timestamp", {}), count)
    poses = list(_poses(fields.name, columns, count))
    others = {name: _full(column, count) for name, column in columns.items()}
    status = next((others[name] for name in IMAGE_STATUS if name in others), None)
    image_valid = np.array(
        [True if status is None else status[i] in (None, "OK") for i in range(count)], dtype=bool
    )
    return Items(times, by_name(poses, fields.name), image_valid, others)


def _poses(name: str, columns: dict[str, dict[int, str]], count: int) -> Iterator[Poses]:
    """The transforms among the columns, which are taken out; one never seen has its status alone."""
    names = dict.fromkeys(name.removesuffix("Status") for name in columns)
    for field_name in names:
        match = TRANSFORM.fullmatch(field_name)
        if match is None or not {field_name, field_name + "Status"} & columns.keys():
            continue
        matrices = _matrices(name, field_name, columns.pop(field_name, {}), count)
        status = columns.pop(field_name + "Status", None)
        valid = np.isfinite(matrices).all(axis=(1, 2))
        texts = _full(status or {}, count)
        valid &= np.array([text in (None, "OK") for text in texts], dtype=bool)
        yield Poses(match[1], match[2], matrices, valid, texts)


def _matrices(name: str, field_name: str, column: Mapping[int, str], count: int) -> Array:
    numbers = sixteen_each(column.values())
    if numbers is None:
        numbers = np.array([_sixteen(name, index, field_name, text) for index, text in column.items()])
    matrices = np.full((count, 4, 4), np.nan)
    matrices[np.fromiter(column, dtype=np.int64, count=len(column))] = numbers.reshape(-1, 4, 4)
    return matrices


def sixteen_each(texts: Collection[str]) -> Array | None:
    """(N, 16) of N sound texts, all at once, or None: an hour of poses is millions of numbers.

    An infinity is put after each pose: where it does not stand at every seventeenth place, one is not sound.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            numbers = np.fromstring(_plain(" inf ".join(texts) + " inf"), sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    if len(numbers) != 17 * len(texts) or not np.isposinf(numbers[16::17]).all():
        return None
    return numbers.reshape(-1, 17)[:, :16]


def _plain(text: str) -> str:
    """The text with every spelling of what is no number as Python and NumPy spell it."""
    return NO_NUMBER.sub("nan", text) if "#" in text or "(" in text else text


def _sixteen(name: str, index: int, field_name: str, text: str) -> list[float]:
    words = _plain(text).split()
    if len(words) != 16:
        raise FormatError(f"{name}, frame {index}: {field_name} has {len(words)} numbers where a pose has 16")
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise FormatError(f"{name}, frame {index}: {field_name} is not of numbers ({error})") from None


def _times(name: str, column: Mapping[int, str], count: int) -> Array:
    times = np.full(count, np.nan)
    try:
        numbers = np.array([float(text) for text in column.values()])
    except ValueError:
        numbers = np.array([float(text) if _is_number(text) else np.nan for text in column.values()])
    if not np.isfinite(numbers).all():
        index, text = list(column.items())[int(np.argmin(np.isfinite(numbers)))]
        raise FormatError(f"{name}, frame {index}: Timestamp {text[:40]!r} is not a finite number of seconds")
    times[np.fromiter(column, dtype=np.int64, count=len(column))] = numbers
    if column and len(column) < count:
        missing = int(np.flatnonzero(np.isnan(times))[0])
        raise InputError(
            f"{name}, frame {missing}: has no Timestamp where {len(column)} of {count} frames have; "
            "the header lacks it, record or export again"
        )
    return times


def _full(column: Mapping[int, str], count: int) -> tuple[str | None, ...]:
    return tuple(map(column.get, range(count)))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
