"""NDI: Polaris, Vega and Aurora over their combined API, with the package `ndicapi`.

Poses are asked for in text (TX), of which a tool takes a line:

    handle (2)  Q0 Qx Qy Qz (6 each, 1e-4)  Tx Ty Tz (7 each, 0.01 mm)  error (6, 1e-4 mm)  status (8)  frame (8)

or the handle, MISSING, DISABLED or UNOCCUPIED, and the last two.

Source: NDI, Polaris and Aurora Application Program Interface Guide, "TX".
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.devices.tracker import Reading, pose_of
from sonocal.errors import InputError, UnsupportedError
from sonocal.files.closing import Closing
from sonocal.geometry import Array
from sonocal.geometry.shown import quoted

__all__ = ["Ndi", "tools_of"]

PORT = 8765
UNIT_Q, UNIT_MM = 1e-4, 1e-2
_SEEN = re.compile(r"([0-9A-F]{2})((?:[+-]\d{5}){4})((?:[+-]\d{6}){3})[+-]\d{5}[0-9A-F]{8}[0-9A-F]{8}")
_LOST = re.compile(r"([0-9A-F]{2})(?:MISSING|DISABLED|UNOCCUPIED)")
ANY_PORT = "PHRQ:*********1****"


class Ndi(Closing):
    """Tools by the names given here, in the tracker's frame, mm.

    Args:
        tools: the file (.rom) of each tool by its name; of an Aurora the number of its port, from 0.
        address: HOST or HOST:PORT of a Vega, or the name of a serial device such as "/dev/ttyUSB0" or "COM3".
        api: what has the functions of `ndicapy`; that unless told.

    Raises:
        UnsupportedError: `ndicapi` is not installed.
        InputError: nobody answers there, or a tool is not taken.
    """

    def __init__(self, tools: Mapping[str, str | Path | int], address: str, *, api: Any = None) -> None:
        self._api: Any = api or _api()
        self._where = address
        self._serial = address.startswith("/") or re.fullmatch(r"COM\d+", address, re.IGNORECASE) is not None
        self._names: dict[int, str] = {}
        self._device: Any = self._open()
        try:
            self._begin(tools)
        except InputError:
            self.close()
            raise

    def __repr__(self) -> str:
        return f"<Ndi at {quoted(self._where)}: {len(self._names)} tools>"

    def read(self, timeout_s: float) -> Reading | None:
        """The next reading; the tracker answers at once, whatever the time given.

        Raises:
            InputError: it says that something is wrong.
        """
        reply = self._say("TX:0001")
        found = tools_of(reply, self._where)
        return Reading(time.time(), {name: found.get(handle) for handle, name in self._names.items()})

    def close(self) -> None:
        """End the connection."""
        device, self._device = self._device, None
        if device is not None:
            self._api.ndiCommand(device, "TSTOP:")
            (self._api.ndiClose if self._serial else self._api.ndiCloseNetwork)(device)

    def _open(self) -> Any:
        if self._serial:
            device = self._api.ndiOpen(self._where)
        else:
            host, _, port = self._where.partition(":")
            if port and not (port.isascii() and port.isdecimal()):
                raise InputError(
                    f"an address must be HOST:PORT, such as 192.168.0.10:{PORT}; got {self._where!r}"
                )
            device = self._api.ndiOpenNetwork(host, int(port or PORT))
        if not device:
            raise InputError(
                f"{self._where}: no NDI tracker answers there; see that it is on, and the name of the device or address"
            )
        return device

    def _begin(self, tools: Mapping[str, str | Path | int]) -> None:
        self._say("INIT:")
        wired = _handles(self._say("PHSR:02"))
        for name, tool in tools.items():
            if isinstance(tool, int):
                if tool >= len(wired):
                    raise InputError(
                        f"{self._where}: has {len(wired)} wired tools, and none of number {tool} for {name}; plug it in"
                    )
                handle = wired[tool]
            else:
                handle = self._load(name, Path(tool))
            self._say(f"PINIT:{handle:02X}")
            self._say(f"PENA:{handle:02X}D")
            self._names[handle] = name
        self._say("TSTART:")

    def _load(self, name: str, rom: Path) -> int:
        """The handle of a tool without a wire, whose file goes to the tracker."""
        if not rom.is_file():
            raise InputError(f"{rom}: is no file; give the .rom of {name}")
        reply = self._say(ANY_PORT)
        handle = _number(reply[:2], reply, self._where)
        self._api.ndiPVWRFromFile(self._device, handle, str(rom))
        self._check(f"{rom.name} of {name}")
        return handle

    def _say(self, command: str) -> str:
        reply = self._api.ndiCommand(self._device, command)
        self._check(command)
        return str(reply or "")

    def _check(self, what: str) -> None:
        error = self._api.ndiGetError(self._device)
        if error != self._api.NDI_OKAY:
            said = quoted(self._api.ndiErrorString(error), 120)
            raise InputError(
                f"{self._where}: the tracker refuses {what} ({said}); see its manual, or switch it off and on"
            )


def tools_of(reply: str, where: str = "tracker") -> dict[int, Array | None]:
    """Poses (4, 4) in mm by the tool's handle, of a reply to TX; None of tools that are lost.

    Raises:
        InputError: it is no such reply.
    """
    lines = re.split(r"[\n\r]+", reply.strip())
    count, found = _number(reply[:2], reply, where), dict[int, Array | None]()
    lines[0] = lines[0][2:]
    for line in lines[:count]:
        if seen := _SEEN.match(line):
            turn = [UNIT_Q * int(one) for one in re.findall(r"[+-]\d{5}", seen[2])]
            place = [UNIT_MM * int(one) for one in re.findall(r"[+-]\d{6}", seen[3])]
            found[int(seen[1], 16)] = pose_of(np.array(turn), np.array(place))
        elif lost := _LOST.match(line):
            found[int(lost[1], 16)] = None
        else:
            raise InputError(f"{where}: no answer to TX: {quoted(line, 80)}; is it an NDI tracker?")
    if len(found) != count:
        raise InputError(f"{where}: {count} tools are announced and {len(found)} answered; ask again")
    return found


def _handles(reply: str) -> list[int]:
    """Those of a reply to PHSR: a count, then two digits a handle and three of its status."""
    return [int(one[:2], 16) for one in re.findall(r"[0-9A-F]{5}", reply[2:])]


def _number(digits: str, reply: str, where: str) -> int:
    try:
        return int(digits, 16)
    except ValueError:
        raise InputError(
            f"{where}: an answer of no tracker: {quoted(reply, 80)}; is it an NDI tracker?"
        ) from None


def _api() -> Any:
    try:
        import ndicapy
    except ImportError:
        raise UnsupportedError(
            "NDI's trackers need ndicapi; pip install ndicapi, or read them through PLUS"
        ) from None
    return ndicapy
