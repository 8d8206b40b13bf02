"""A server that answers commands as PLUS's does, and sends transforms meanwhile."""

from __future__ import annotations

import threading
from typing import Self
from xml.etree import ElementTree

import numpy as np

from sonocal import igtl
from tests.builders.messages import pose


class FakePlus:
    """Attributes: `held`, transforms by name with their attributes; `saved`, the names of configurations."""

    def __init__(self, held: dict[str, dict[str, str]] | None = None, *, broken: str = "") -> None:
        self.held, self.saved, self.broken = dict(held or {}), list[str](), broken
        self.versions: set[int] = set()

    def __enter__(self) -> Self:
        self._server = igtl.Server()
        self.address = f"127.0.0.1:{self._server.port}"
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()
        self._server.close()

    def matrix(self, name: str) -> np.ndarray:
        """What it holds."""
        return np.array(self.held[name]["TransformValue"].split(), dtype=float).reshape(4, 4)

    def _run(self) -> None:
        while not self._closing.is_set():
            self._server.send(igtl.Message(igtl.Transform(pose()), "ProbeToTracker", igtl.stamp_of(1.7e9)))
            for arrival in self._server.take(0.02):
                self.versions.add(arrival.message.version)
                if isinstance(arrival.message.content, igtl.Command) and self.broken != "silent":
                    self._answer(arrival)

    def _answer(self, arrival: igtl.Arrival) -> None:
        command = arrival.message.content
        asked = ElementTree.fromstring(command.text)
        status, message, error, meta = "SUCCESS", f"{command.name} completed successfully", "", {}
        name = asked.get("TransformName", "")
        if command.name == self.broken:
            status, message, error = "FAIL", "Command failed. See error message.", "Unable to <write>"
        elif command.name == "GetTransform":
            if name in self.held:
                numbers = " ".join(f"{x:.6g}" for x in self.matrix(name).ravel())
                stored = self.held[name]
                meta = {
                    name: numbers,
                    "date": stored.get("TransformDate", ""),
                    "error": stored.get("TransformError", "-1"),
                }
            else:
                status, message = "FAIL", "Command failed. See error message."
                error = f"GetTransform ({name}) Failed. Transform not found."
        elif command.name == "UpdateTransform":
            if self.broken != "forgetful":
                self.held[name] = dict(asked.attrib)
        elif command.name == "SaveConfig":
            self.saved.append(asked.get("Filename", "its own"))
        said = f' Error="{error}"' if error else ""
        text = (
            f'<CommandReply Name="{command.name}" Status="{status}"{said} Message="{message}"></CommandReply>'
        )
        reply = igtl.CommandReply(command.identity, command.name, text)
        arrival.peer.send(igtl.Message(reply, "PlusServer", version=2, meta=meta))
