"""The HTTP end of `cosim open`: who gets an answer, what a file may be, and that nothing of its name becomes a path."""

import http.client
import json
import re
import socket
from pathlib import Path

import psutil
import pytest

from cosim.browser import run
from cosim.browser.server import QUIET, serving
from cosim.errors import DataError, UsageError

TOP = Path(__file__).resolve().parents[2]
PATIENCE = QUIET / 2  # s; an answer that waits for what does not come takes longer


class Desk:
    """Takes files of at most 1000 bytes and remembers them."""

    def __init__(self, folder):
        self.folder, self.taken, self.asked, self.page, self.roles = folder, [], [], None, []

    def limits(self):
        return {".csv": 1000, ".toml": 10}

    def state(self, known=""):
        return {"taken": len(self.taken), "known": known}

    def report(self):
        return self.page

    def said(self, text):
        return {"this is no log": "no log, this is"}.get(text, text)

    def take(self, file, suffix, name, role):
        self.roles.append(role)
        if file.read_bytes() == b"bad":
            raise DataError("this is no log")
        self.taken.append((file, suffix, name, file.read_bytes()))

    def ask(self, what, given):
        {"stop": self.asked.append}[what](given)


@pytest.fixture
def desk(tmp_path):
    return Desk(tmp_path)


@pytest.fixture
def gate(desk):
    with serving(0, desk) as gate:
        yield gate


def ask(gate, method="GET", where="", body=None, host=None, origin="own", path=None, **headers):
    """One request; `origin` "own" is the page's own for POST and none for GET."""
    connection = http.client.HTTPConnection("127.0.0.1", gate.port, timeout=PATIENCE)
    connection.putrequest(
        method, f"/{gate.token}/{where}" if path is None else path, skip_host=True, skip_accept_encoding=True
    )
    host = [f"127.0.0.1:{gate.port}"] if host is None else host
    for name in host:
        connection.putheader("Host", name)
    if origin == "own":
        origin = f"http://{host[0]}" if method == "POST" else None
    if origin is not None:
        connection.putheader("Origin", origin)
    if body is not None and "Content-Length" not in headers and "Transfer_Encoding" not in headers:
        connection.putheader("Content-Length", str(len(body)))
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders(body)
    answer = connection.getresponse()
    text = answer.read()
    connection.close()
    return answer.status, text, answer.headers


def upload(gate, body, name="log.csv", **headers):
    return ask(gate, "POST", "file", body, X_Name=name, Content_Type="application/octet-stream", **headers)


def test_only_this_machine_is_listened_to(desk):
    with serving(0, desk) as gate:
        # asked of the system: a name server may take its time
        own = [
            a.address for known in psutil.net_if_addrs().values() for a in known if a.family == socket.AF_INET
        ]
        for address in {a for a in own if not a.startswith("127.")}:
            with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
                socket.create_connection((address, gate.port), timeout=2)
        with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE) as line:
            assert line.getpeername()[0] == "127.0.0.1"


def test_the_page_is_served_with_a_policy_and_kept_nowhere(gate):
    for where, kind in {"": "text/html", "page.js": "text/javascript", "page.css": "text/css"}.items():
        status, text, headers = ask(gate, where=where)
        assert status == 200, where
        assert text
        assert headers.get_content_type() == kind
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["Cache-Control"] == "no-store"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["X-Content-Type-Options"] == "nosniff"


def test_the_page_names_nothing_outside():
    for name in ("page.html", "page.js", "page.css"):
        text = (TOP / "cosim" / "browser" / name).read_text(encoding="utf-8")
        assert "://" not in text.replace("http://www.w3.org/2000/svg", ""), name
        assert not re.search(r"""["'(]//""", text), name
        assert "innerHTML" not in text
        assert "eval(" not in text


@pytest.mark.parametrize(
    "host",
    [["evil.example"], ["evil.example:{port}"], ["127.0.0.1"], [], ["127.0.0.1:{port}", "evil.example"]],
)
def test_another_name_of_this_machine_gets_nothing(gate, host):
    """DNS rebinding: a page elsewhere makes its own name mean 127.0.0.1."""
    status, text, _ = ask(gate, host=[name.format(port=gate.port) for name in host], origin=None)
    assert status in (421, 403)
    assert b"<html" not in text


def test_localhost_is_a_name_of_this_machine(gate):
    assert ask(gate, host=[f"localhost:{gate.port}"])[0] == 200
    assert (
        ask(gate, "POST", "stop", b"{}", host=[f"localhost:{gate.port}"], Content_Type="application/json")[0]
        == 200
    )


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1", "https://127.0.0.1:{port}"]
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_another_page_gets_nothing(gate, desk, method, origin):
    status, _, _ = ask(
        gate, method, "stop" if method == "POST" else "state", b"{}" if method == "POST" else None,
        origin=origin.format(port=gate.port), Content_Type="application/json",
    )  # fmt: skip
    assert status == 403
    assert desk.asked == []


def test_a_button_without_an_origin_is_refused(gate, desk):
    assert ask(gate, "POST", "stop", b"{}", origin=None, Content_Type="application/json")[0] == 403
    assert desk.asked == []


@pytest.mark.parametrize(
    "path", ["/", "/state", "/wrong/", "/{token}x/state", "/../{token}/", "/%7Btoken%7D/"]
)
def test_without_the_token_there_is_nothing(gate, path):
    status, text, _ = ask(gate, path=path.format(token=gate.token))
    assert status == 403, text
    assert "printed" in json.loads(text)["error"]


def test_a_ticket_leads_to_the_page_once(gate):
    path = gate.url_once.removeprefix(f"http://127.0.0.1:{gate.port}")
    assert ask(gate, path=path, host=["evil.example"])[0] == 421, (
        "and is not used up by those who may not ask"
    )
    status, text, headers = ask(gate, path=path)
    assert (status, text, headers["Location"]) == (303, b"", gate.url)
    assert ask(gate, path=path)[0] == 403
    assert ask(gate, path="/")[0] == 403, "no ticket is not the ticket that is gone"


@pytest.mark.parametrize(
    ("names", "started"), [({"DISPLAY": ":0"}, True), ({"BROWSER": "x"}, True), ({}, False)]
)
def test_a_browser_is_started_where_there_is_a_screen(monkeypatch, names, started):
    opened = []
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    for name, value in names.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(run.sys, "platform", "linux")
    monkeypatch.setattr(run.webbrowser, "open", opened.append)
    monkeypatch.setattr(run.threading.Thread, "start", lambda thread: thread._target(*thread._args))
    run.start_browser("http://there")
    assert opened == (["http://there"] if started else [])


def test_tokens_differ_and_are_long(desk):
    with serving(0, desk) as one, serving(0, desk) as other:
        assert one.token != other.token
        assert len(one.token) >= 32
        assert one.token not in repr(one)


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "HEAD"])
def test_other_methods_are_not_known(gate, method):
    assert ask(gate, method, "state")[0] == 501


@pytest.mark.parametrize("where", ["nothing", "../state", "page.html", "file", "__init__.py", "%2e%2e/state"])
def test_other_addresses_are_not_there(gate, where):
    assert ask(gate, where=where)[0] == 404


def test_the_report_runs_as_a_stranger(gate, desk):
    assert ask(gate, where="report")[0] == 404
    desk.page = b"<p>report"
    status, text, headers = ask(gate, where="report")
    assert (status, text) == (200, b"<p>report")
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("sandbox ")
    assert "allow-same-origin" not in policy


@pytest.mark.parametrize(
    "name",
    [
        "../../../etc/passwd.csv",
        "..%5C..%5Cwindows%5Cx.CSV",
        "/etc/x.csv",
        "a%00b%0A.csv",
        "CON.csv",
        "ü%20%3Cb%3E.csv",
    ],
)
def test_a_file_s_name_is_never_a_path(gate, desk, name):
    assert upload(gate, b"time\n1\n", name.encode().decode("latin-1"))[0] == 200
    ((file, suffix, shown, content),) = desk.taken
    assert file.parent == desk.folder
    assert file.suffix == suffix == ".csv"
    assert len(file.stem) == 16
    assert set(file.stem) <= set("0123456789abcdef")
    assert content == b"time\n1\n"
    assert "/" not in shown
    assert shown.isprintable()
    assert list(desk.folder.iterdir()) == [file]


def test_a_file_that_is_too_large_is_refused_before_it_comes(gate, desk):
    status, text, _ = upload(gate, None, Content_Length="1001")  # nothing is sent
    assert status == 413
    assert "log.csv is larger" in json.loads(text)["error"]
    assert upload(gate, None, Content_Length="9" * 4000)[0] == 413
    assert upload(gate, b"x" * 1000)[0] == 200
    assert len(desk.taken) == 1


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Content_Length": "-1"}, 411),
        ({"Content_Length": "1e3"}, 411),
        ({"Content_Length": "²"}, 411),
        ({"Transfer_Encoding": "chunked"}, 415),
        ({"Content_Type": "text/plain", "Content_Length": "1"}, 415),
        ({"Content_Type": "multipart/form-data", "Content_Length": "1"}, 415),
    ],
)
def test_a_file_of_no_stated_length_or_kind_is_refused(gate, desk, headers, status):
    given = {"X_Name": "a.csv", "Content_Type": "application/octet-stream"} | headers
    assert ask(gate, "POST", "file", None, **given)[0] == status
    assert list(desk.folder.iterdir()) == []


def test_a_file_of_another_kind_is_refused_with_the_kinds_that_are_taken(gate, desk):
    status, text, _ = upload(gate, b"x", "run.exe")
    assert status == 415
    assert json.loads(text)["error"].endswith("files that are taken end with .csv, .toml")


def test_a_file_that_breaks_off_leaves_nothing(gate, desk):
    with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE) as line:
        head = (
            f"POST /{gate.token}/file HTTP/1.1\r\nHost: 127.0.0.1:{gate.port}\r\nOrigin: http://127.0.0.1:{gate.port}\r\n"
            "Content-Type: application/octet-stream\r\nX-Name: a.csv\r\nContent-Length: 900\r\n\r\n"
        )
        line.sendall(head.encode() + b"x" * 10)
        line.shutdown(socket.SHUT_WR)
        assert b"did not come whole" in line.makefile("rb").read()
    assert list(desk.folder.iterdir()) == []
    assert desk.taken == []


def test_a_page_says_what_it_knows(gate):
    assert json.loads(ask(gate, where="state")[1])["known"] == ""
    assert json.loads(ask(gate, where="state?revision=3")[1])["known"] == "3"


def test_what_is_wrong_with_a_file_is_said(gate, desk):
    status, text, _ = upload(gate, b"bad")
    assert (status, json.loads(text)) == (422, {"error": "no log, this is"}), "in the desk's language"


@pytest.mark.parametrize("body", [b"", b"[1]", b"{", b"\xff", b'"a"', b"[" * 100_000])
def test_a_form_that_is_none(gate, body):
    assert ask(gate, "POST", "stop", body, Content_Type="application/json")[0] == 400


def test_a_form_is_limited_too(gate):
    assert (
        ask(gate, "POST", "stop", None, Content_Type="application/json", Content_Length=str(5 << 20))[0]
        == 413
    )


def test_a_button_and_one_that_is_not_there(gate, desk):
    assert ask(gate, "POST", "stop", b'{"a": 1}', Content_Type="application/json")[0] == 200
    assert desk.asked == [{"a": 1}]
    assert ask(gate, "POST", "start", b"{}", Content_Type="application/json")[0] == 404


def test_a_port_that_is_taken_is_named(desk, gate):
    said = rf"port {gate.port} cannot be used \(.+\): give another one, or leave --port out"
    with pytest.raises(UsageError, match=said), serving(gate.port, desk):
        pass


def test_the_command_says_that_the_port_is_taken(desk, command):
    with serving(0, desk) as gate:
        code, out, err = command("open", "--port", gate.port, "--no-browser")
    assert code == 2
    assert out == ""
    assert f"port {gate.port} cannot be used" in err


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["nowhere.csv"], 3, "there is no such file"),
        (["pyproject.toml", "--model", "half_order"], 2, "no model 'half_order'"),
        (["README.md"], 2, "neither log nor model nor mapping"),
        (["--model", "nowhere.fmu"], 3, "there is no such file"),
        (["--language", "fr"], 2, "one of en, de"),
    ],
)
def test_the_command_says_what_is_wrong_before_a_page_is_opened(command, monkeypatch, words, code, said):
    monkeypatch.chdir(TOP)
    found, out, err = command("open", *words, "--no-browser")
    assert (found, out) == (code, "")
    assert said in err
