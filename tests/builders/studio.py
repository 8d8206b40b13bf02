"""A studio that runs as a user's does, in a process of its own, and requests of it that a browser would not make."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

ADDRESS = re.compile(r"http://([^/]+):(\d+)/\?key=(\S+)")


@dataclass
class Running:
    """A studio: its process, address, and, once `cookie` was called, the cookie of its page."""

    process: subprocess.Popen
    host: str
    port: int
    key: str
    jar: str = ""

    @property
    def address(self):
        return f"http://{self.host}:{self.port}/?key={self.key}"

    @property
    def origin(self):
        return f"http://{self.host}:{self.port}"

    def ask(self, path, method="GET", body=None, **headers):
        """The status, the headers and the content of an answer; headers replace those that the page would send."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=20)
        own = {"Cookie": self.jar, "Origin": self.origin} if method != "GET" else {"Cookie": self.jar}
        own |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(
            method, path, body, {name: value for name, value in own.items() if value is not None}
        )
        answer = connection.getresponse()
        found = answer.status, dict(answer.getheaders()), answer.read()
        connection.close()
        return found

    def cookie(self):
        """Exchange the key for the cookie."""
        status, headers, _ = self.ask(f"/?key={self.key}")
        assert status == 200
        self.jar = headers["set-cookie"].split(";")[0]
        return self

    def events(self, **changes):
        """The WebSocket, opened as the page opens it but for some changes."""
        client = pytest.importorskip("websockets.sync.client")
        how = {"origin": self.origin, "additional_headers": {"Cookie": self.jar}} | changes
        return client.connect(f"ws://{self.host}:{self.port}/events", max_size=None, proxy=None, **how)

    def kill(self):
        """SIGKILL: nothing can be tidied up."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()


@contextmanager
def running(folder, *arguments):
    for name in ("starlette", "uvicorn", "websockets"):
        pytest.importorskip(name)
    command = [
        sys.executable,
        "-m",
        "sonocal",
        "studio",
        *map(str, arguments),
        "--no-browser",
        "-o",
        str(folder),
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        found = ADDRESS.search(process.stdout.readline())
        assert found, process.communicate(timeout=20)[1]
        yield Running(process, found[1], int(found[2]), found[3])
    finally:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
        process.communicate()


def heard(socket, kind, within=60, **wanted):
    """The next message of a kind, with some of its fields as wanted."""
    while True:
        message = json.loads(socket.recv(timeout=within))
        if message["kind"] == kind and all(message.get(name) == value for name, value in wanted.items()):
            return message
