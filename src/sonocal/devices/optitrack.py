"""OptiTrack: rigid bodies that Motive streams over NatNet, with the package `natnet`."""

from __future__ import annotations

import time
from typing import Any

from sonocal.devices.tracker import Reading, pose_of
from sonocal.errors import InputError, UnsupportedError
from sonocal.files.closing import Closing
from sonocal.geometry.shown import quoted

__all__ = ["OptiTrack"]

MM_PER_M = 1000.0
CONNECT_S = 5.0
POLL_S = 0.001
NAMES_S = 1.0
"""Between two questions for the names of bodies that are not known yet."""
COMMAND_PORT, DATA_PORT = 1510, 1511


class OptiTrack(Closing):
    """Rigid bodies by the names that Motive gives them, in its frame: y up, in mm.

    Args:
        server: address of Motive's machine.
        local: address of this machine, as that one reaches it.
        multicast: as Motive's streaming pane says.
        command_port: of Motive.
        data_port: of Motive's multicast.

    Attributes:
        damaged: packets that were no NatNet.

    Raises:
        UnsupportedError: `natnet` is not installed.
        InputError: nobody answers there.
    """

    def __init__(
        self,
        server: str = "127.0.0.1",
        local: str = "127.0.0.1",
        *,
        multicast: bool = True,
        command_port: int = COMMAND_PORT,
        data_port: int = DATA_PORT,
    ) -> None:
        try:
            import natnet
        except ImportError:
            raise UnsupportedError(
                "OptiTrack needs natnet; pip install natnet, or read it through PLUS"
            ) from None
        self.damaged = 0
        self._where = f"{server}:{command_port}"
        self._names: dict[int, str] = {}
        self._readings: list[Reading] = []
        self._ask_from_s = 0.0
        self._client: Any = natnet.NatNetClient(
            server, local, command_port=command_port, data_port=data_port, use_multicast=multicast
        )
        self._client.on_data_description_received_event.handlers.append(self._described)
        self._client.on_data_frame_received_event.handlers.append(self._came)
        try:
            self._client.connect(CONNECT_S)
        except (OSError, natnet.NatNetError) as error:  # a timeout among them
            self._client.shutdown()
            reason = str(error) or "no answer"
            raise InputError(
                f"{self._where}: no Motive answers there ({reason}); see its streaming pane for address and port"
            ) from error

    def __repr__(self) -> str:
        return f"<OptiTrack at {quoted(self._where)}: {len(self._names)} rigid bodies>"

    def read(self, timeout_s: float) -> Reading | None:
        """The next reading; None where none came in time.

        Raises:
            InputError: the connection ended.
        """
        until_s = time.monotonic() + timeout_s
        while not self._readings and time.monotonic() < until_s:
            self._update()
            if not self._readings:
                time.sleep(POLL_S)
        return self._readings.pop(0) if self._readings else None

    def close(self) -> None:
        """End the connection."""
        self._client.shutdown()

    def _update(self) -> None:
        now_s = time.monotonic()
        try:
            if not self._names and now_s >= self._ask_from_s:
                self._ask_from_s = now_s + NAMES_S
                self._client.request_modeldef()
            self._client.update_sync()
        except OSError as error:
            raise InputError(
                f"{self._where}: the connection ended ({error.strerror}); open it again"
            ) from error
        except Exception:  # of whatever natnet makes of a packet that is none
            self.damaged += 1

    def _described(self, described: Any) -> None:
        self._names = {body.id_num: body.name or str(body.id_num) for body in described.rigid_bodies}

    def _came(self, frame: Any) -> None:
        poses = {}
        for body in frame.rigid_bodies:
            if body.id_num not in self._names:  # added meanwhile
                self._names = {}
                return
            x, y, z, w = body.rot
            lost = body.tracking_valid is False
            place = [MM_PER_M * one for one in body.pos]
            poses[self._names[body.id_num]] = None if lost else pose_of((w, x, y, z), place)
        self._readings.append(Reading(time.time(), poses))
