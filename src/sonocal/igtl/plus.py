"""PLUS's commands on its transforms: ask for one, replace one, have the configuration saved.

A COMMAND of version 2 carries XML; the RTS_COMMAND with its identity says how it went, and what was asked for in its
meta data. PLUS writes texts into its answers as they are, so that these are searched and not parsed as XML.

Source: PlusLib, src/PlusServer/Commands (vtkPlusUpdateTransformCommand, vtkPlusGetTransformCommand,
vtkPlusSaveConfigCommand).
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief, quoted
from sonocal.igtl.client import Client
from sonocal.igtl.message import Message
from sonocal.igtl.words import Command, CommandReply

__all__ = ["HeldTransform", "PlusServer"]

ANSWER_S = 5.0
NOT_FOUND = "not found"
MOST_TOLD = 160
TOLERANCE = 1e-4
"""Of the largest entry: PLUS answers with six digits."""
_TOLD = {key: re.compile(f'{key}="([^"]*)"') for key in ("Status", "Error", "Message")}


@dataclass(frozen=True, eq=False)
class HeldTransform:
    """A transform as a server holds it.

    Attributes:
        matrix: (4, 4), to six digits.
        date: of it, as it was written; "" where there is none.
        error_mm: as it was written; None where none was.
    """

    matrix: Array
    date: str = ""
    error_mm: float | None = None

    __repr__ = brief


class PlusServer:
    """A running PlusServer.

    Args:
        client: connected to it; what else it sends meanwhile is passed over.
        name: HOST:PORT, for messages.
        timeout_s: how long an answer may take.
    """

    def __init__(self, client: Client, name: str, timeout_s: float = ANSWER_S) -> None:
        self._client, self._name, self._timeout_s = client, name, timeout_s
        self._identity = 0

    def __repr__(self) -> str:
        return f"<PlusServer at {quoted(self._name)}>"

    def transform(self, name: str) -> HeldTransform | None:
        """The transform of that name, such as "ImageToProbe"; None where there is none.

        Raises:
            InputError: it answers nothing, or refuses for another reason.
        """
        message, refusal = self._ask("GetTransform", {"TransformName": name})
        if refusal:
            if NOT_FOUND in refusal.lower():
                return None
            raise InputError(
                f"{self._name}: does not tell {name} ({quoted(refusal, MOST_TOLD)}); see PlusServer's log"
            )
        try:
            matrix = np.array(message.meta[name].split(), dtype=float).reshape(4, 4)
        except (KeyError, ValueError):
            raise InputError(
                f"{self._name}: its answer to GetTransform holds no 4 x 4 matrix {name}; is it PlusServer 2.8 or later?"
            ) from None
        return HeldTransform(matrix, message.meta.get("date", ""), _error(message.meta.get("error", "")))

    def update_transform(self, name: str, matrix: Array, *, error_mm: float | None, date: str) -> None:
        """Replace a transform, or add it, and see that it is there then.

        Raises:
            InputError: it answers nothing, refuses, or holds another matrix afterwards.
        """
        values = " ".join(repr(float(x)) for x in matrix.ravel())
        asked = {"TransformName": name, "TransformValue": values, "TransformPersistent": "TRUE"}
        if error_mm is not None:
            asked["TransformError"] = repr(float(error_mm))
        self._do("UpdateTransform", asked | {"TransformDate": date})
        held = self.transform(name)
        if held is None or np.abs(held.matrix - matrix).max() > TOLERANCE * np.abs(matrix).max():
            raise InputError(
                f"{self._name}: said that it took {name} and holds another matrix; another client may have changed it"
            )

    def save_config(self, filename: str | None = None) -> None:
        """Have it write its configuration: over its own, or into another file of its machine.

        Raises:
            InputError: it answers nothing, or refuses.
        """
        self._do("SaveConfig", {} if filename is None else {"Filename": filename})

    def _do(self, command: str, attributes: Mapping[str, str]) -> None:
        _, refusal = self._ask(command, attributes)
        if refusal:
            raise InputError(
                f"{self._name}: refuses {command} ({quoted(refusal, MOST_TOLD)}); see PlusServer's log"
            )

    def _ask(self, command: str, attributes: Mapping[str, str]) -> tuple[Message, str]:
        """Its answer, and why it refuses; "" where it does not."""
        self._identity += 1
        words = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
        xml = f"<Command Name={quoteattr(command)}{words} />"
        content = Command(self._identity, command, xml)
        self._client.send(Message(content, "Sonocal", version=2))
        until = time.monotonic() + self._timeout_s
        while (left := until - time.monotonic()) > 0:
            for message in self._client.take(left):
                answer = message.content
                if isinstance(answer, CommandReply) and answer.identity == self._identity:
                    return message, _refusal(message)
        raise InputError(
            f"{self._name}: answers nothing to {command} within {self._timeout_s:g} s; is it a PlusServer, and not "
            "another that speaks OpenIGTLink?"
        )


def _refusal(message: Message) -> str:
    told = {key: find.search(message.content.text) for key, find in _TOLD.items()}
    if told["Status"] is not None and told["Status"][1].upper() == "SUCCESS":
        return ""
    said = next((one[1] for one in (told["Error"], told["Message"]) if one and one[1]), message.content.text)
    return said.strip() or "no reason given"


def _error(text: str) -> float | None:
    try:
        error = float(text)
    except ValueError:
        return None
    return error if np.isfinite(error) and error >= 0 else None
