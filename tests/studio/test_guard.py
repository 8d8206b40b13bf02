"""Whoever is not the page is refused: each rule by a request that breaks it alone."""

import json

import pytest

from sonocal.studio.uploads import MOST_BYTES


def test_the_page_is_answered_and_may_load_nothing_from_elsewhere(studio):
    status, headers, content = studio.ask("/")
    assert status == 200
    assert b"sonocal studio" in content
    assert headers["content-security-policy"].startswith("default-src 'self'")
    assert headers["x-content-type-options"] == "nosniff"


def test_the_cookie_is_kept_from_scripts_and_from_other_sites(sweep, tmp_path):
    from tests.builders.studio import running

    with running(tmp_path / "studio") as one:
        cookie = one.ask(f"/?key={one.key}")[1]["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        assert one.ask(f"/?key={one.key}")[0] == 401, "a key is good once"


@pytest.mark.parametrize(
    "path",
    ["/", "/page/main.js", "/frames/0", "/files/plus.xml", "/live/frame", "/live/slices", "/?key=wrong"],
)
def test_without_the_cookie_nothing_is_told(studio, path):
    assert studio.ask(path, Cookie=None)[0] == 401
    assert studio.ask(path, Cookie=studio.jar[:-1] + "?")[0] == 401


def test_a_foreign_host_is_refused(studio):
    assert studio.ask("/")[0] == 200
    assert studio.ask("/", Host=f"evil.example:{studio.port}")[0] == 421
    assert studio.ask("/", Host="127.0.0.1:1")[0] == 421


@pytest.mark.parametrize(
    ("path", "method"),
    [("/export", "POST"), ("/open", "POST"), ("/inputs", "PUT"), ("/live/end", "POST"), ("/tool", "POST")],
)
def test_a_foreign_origin_changes_nothing(studio, path, method):
    for origin in (None, "null", "http://evil.example", f"https://{studio.host}:{studio.port}"):
        assert studio.ask(path, method, b"{}", Origin=origin)[0] == 403


def test_a_foreign_origin_reads_nothing(studio):
    assert studio.ask("/frames/0", Origin="http://evil.example")[0] == 403


@pytest.mark.parametrize(
    "changes",
    [
        {"origin": "http://evil.example"},
        {"origin": None},
        {"additional_headers": {}},
        {"additional_headers": {"Cookie": "sonocal-studio=x"}},
    ],
)
def test_a_web_socket_from_elsewhere_is_refused(studio, changes):
    exceptions = pytest.importorskip("websockets.exceptions")
    with studio.events() as socket:
        assert json.loads(socket.recv())["kind"]
    with pytest.raises(exceptions.InvalidStatus), studio.events(**changes):
        pass


@pytest.mark.parametrize(
    "path",
    [
        "/page/../desk.py",
        "/page/%2e%2e%2fdesk.py",
        "/page/..%5cdesk.py",
        "/files/../session.jsonl",
        "/files/%2e%2e%2fsession.jsonl",
        "/files//etc/passwd",
        "/page//etc/passwd",
    ],
)
def test_no_path_leads_out(studio, path):
    assert studio.ask(path)[0] == 404


@pytest.mark.parametrize(
    "name", ["..%2Fescaped.mha", "%2Fetc%2Fescaped", "a%00b", "", ".", "..", "a%5Cb", ".hidden", "x" * 300]
)
def test_an_upload_has_a_name_that_leads_nowhere(studio, name):
    status, _, content = studio.ask("/inputs", "PUT", b"x", X_Name=name)
    assert status == 400
    assert "is no name for a file" in json.loads(content)["refused"]


def test_an_upload_that_says_it_is_large_is_refused_before_it_comes(studio):
    status, _, content = studio.ask("/inputs", "PUT", b"", X_Name="a.mha", Content_Length=str(1 << 30))
    assert status == 413
    assert "512 MB" in json.loads(content)["refused"]


def test_an_upload_that_does_not_say_so_is_cut_off(tmp_path):
    import asyncio

    from sonocal.errors import InputError
    from sonocal.studio.uploads import Uploads

    async def parts():
        for _ in range(9):
            yield b"x" * 1000

    with pytest.raises(InputError, match="larger than"):
        asyncio.run(Uploads(tmp_path, most_bytes=8999).take("a.mha", None, parts()))
    assert not list(tmp_path.iterdir())
    assert asyncio.run(Uploads(tmp_path, most_bytes=9000).take("a.mha", None, parts())) == "a.mha"
    assert MOST_BYTES < 1 << 30


def test_a_request_with_html_in_its_names_is_answered_as_json_or_text(studio):
    bad = "%3Cimg%20src=x%20onerror=alert(1)%3E"
    for path, method in ((f"/files/{bad}", "GET"), (f"/page/{bad}", "GET"), ("/open", "POST")):
        headers = studio.ask(
            path, method, json.dumps({"source": "<img src=x>"}).encode() if method == "POST" else None
        )[1]
        assert headers["content-type"].split(";")[0] in ("text/plain", "application/json")


def test_another_machine_is_not_listened_to(studio):
    assert studio.host == "127.0.0.1"
