"""The page's server over real sockets: what it refuses, and that nothing it says can do harm."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.browse_process import Running, browsing
from support.fake_episodes import JOINTS, make_episode, make_spec, small_config

from grasp_factory.apps.browse.guard import HEADERS, MOST_BODY, Guard
from grasp_factory.apps.browse.serving import MOST_HEADER
from grasp_factory.apps.browse.static_files import FOLDER
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.robots import ROBOTS
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config()
SCRIPT = "<script>alert(1)</script><img src=x onerror=alert(2)>"
SECRET = "the secret of another folder"
JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store with script wherever text may be, beside a file that is nobody's business."""
    folder = tmp_path_factory.mktemp("security")
    (folder / "secret.png").write_text(SECRET)
    path = folder / "grasps.zarr"
    prepare_store(path, CONFIG, JOINTS, 8, {"robot": ROBOTS[CONFIG.robot].facts()})
    rows: list[Any] = [make_episode(CONFIG, i) for i in range(3)]
    for row in rows:
        row.columns["object_id"] = SCRIPT
        row.columns["object_ids"][0] = SCRIPT
    ZarrWriter(path).write_block(0, [*rows, Quarantined(make_spec(CONFIG, 3), f"no: {SCRIPT}")])
    AnnotationLog(path).append(SCRIPT[:64], [1], [("tag", SCRIPT), ("note", SCRIPT)])
    return path


@pytest.fixture(scope="module")
def server(store: Path) -> Iterator[Running]:
    with browsing(store) as server:
        yield server
        assert server.stop() == (0, "", ""), "something was said, such as a traceback"


@pytest.fixture
def own_server(store: Path, tmp_path: Path) -> Iterator[tuple[Running, Path]]:
    """Give a server of a copy of the store, which the test may change."""
    own = Path(shutil.copytree(store, tmp_path / "own.zarr"))
    with browsing(own) as server:
        yield server, own


def talk(server: Running, data: bytes, address: str = "127.0.0.1") -> tuple[int, bytes, bytes]:
    """Send bytes as they are; return status, header and body of the answer."""
    with socket.create_connection((address, server.port), timeout=20) as connection:
        connection.sendall(data)
        answer = b""
        with contextlib.suppress(ConnectionResetError):
            while piece := connection.recv(65536):
                answer += piece
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split()[1]), head, body


def ask(
    server: Running,
    address: str,
    headers: Mapping[str, str] | None = None,
    method: str = "GET",
    body: bytes = b"",
) -> tuple[int, bytes, bytes]:
    """Send a request whose address is not mended on its way."""
    lines = {"Host": server.host, "Connection": "close"} | dict(headers or {})
    if body:
        lines["Content-Length"] = str(len(body))
    head = "".join(f"{name}: {value}\r\n" for name, value in lines.items() if value)
    return talk(server, f"{method} {address} HTTP/1.1\r\n{head}\r\n".encode("latin-1") + body)


def tagging(server: Running, **changes: Any) -> tuple[dict[str, str], bytes]:
    """Return headers and body of a request that sets a tag."""
    headers = JSON | {"X-Token": server.token, "Origin": f"http://{server.host}"}
    body = {"episodes": [[0, 0]], "who": "ada", "changes": [["tag", "odd"]]} | changes
    return headers, json.dumps(body).encode()


def is_whole(head: bytes) -> bool:
    """Say whether an answer has all the headers that every answer has."""
    lines = head.decode("latin-1").split("\r\n")[1:]
    found = {k.lower(): v for k, _, v in (line.partition(": ") for line in lines)}
    return all(found.get(name.lower()) == value for name, value in HEADERS.items())


class TestPaths:
    HOPS = (
        *("..", "%2e%2e", "%2E.", "..%2f", "%2e%2e%2f", "%252e%252e%252f", "..\\", "..%5c"),
        *("....//", "%c0%ae%c0%ae", "..%00", "..;", "%ff%fe"),
    )

    @pytest.mark.parametrize("hop", HOPS)
    @pytest.mark.parametrize(
        "where",
        [
            "/static/{}/{}/app.py",
            "/static/{}{}{}{}{}{}{}{}etc/passwd",
            "/{}/{}/secret.png",
            "/image/0/0/{}/{}/0.png",
            "/image/0/0/front/{}/secret.png",
            "/image/{}/{}/front/rgb/0.png",
            "/image/0/0/front/rgb/{}0.png",
            "/image/0/0/{}{}{}{}secret/rgb/0.png",
            "/thumb/0/{}.jpg",
            "/thumb/0/0.jpg?camera={}/{}/secret",
            "/cloud/0/0/0?camera={}/../../secret.png",
            "/video/0/0/{}/0.jpg",
            "/api/episode/0/{}",
            "/api/series/{}/0",
        ],
    )
    def test_none_leads_out_of_the_page_and_its_stores(
        self, server: Running, where: str, hop: str
    ) -> None:
        code, head, body = ask(server, where.replace("{}", hop))
        assert code in (400, 404)
        assert is_whole(head)
        assert set(json.loads(body)) == {"error"}
        assert SECRET.encode() not in body
        assert b"import" not in body

    @pytest.mark.parametrize("up", ["../", "%2e%2e/", "..%2f", "%2e%2e%2f", "./../"])
    def test_no_file_of_another_folder_is_served_though_its_kind_is(
        self, server: Running, store: Path, up: str
    ) -> None:
        secret = store.parent / "secret.svg"
        secret.write_text(SECRET)
        way = os.path.relpath(secret, FOLDER).replace("../", up)
        code, head, body = ask(server, f"/static/{way}")
        assert code == 404
        assert is_whole(head)
        assert SECRET.encode() not in body

    @pytest.mark.parametrize(
        "address",
        [
            *("/static//etc/passwd", "//etc/passwd", "/static/%2fetc%2fpasswd", "/static/"),
            *(
                "/static/vendor",
                "/static/index.html%00.js",
                "/static/main.js/",
                "/static/nul%00.js",
            ),
            *("/image/0/0//etc/passwd/rgb/0.png", "/image/0/0/%2fetc%2fpasswd/rgb/0.png"),
            *("/image/0/0/front%00/rgb/0.png", "/image/0/0/front/rgb%00/0.png"),
            *("/image/-1/0/front/rgb/0.png", "/image/0/-1/front/rgb/0.png"),
            *(f"/image/0/{'9' * 5000}/front/rgb/0.png", f"/thumb/{'9' * 30}/0.jpg"),
            *("/image/0/%D9%A1/front/rgb/0.png", "/image/0x0/0/front/rgb/0.png"),
            *("/image/0/0/front/rgb/-1.png", "/image/0/1e0/front/rgb/0.png"),
            *("/api/episode/0/0.5", "/api/episode/0/ 0", "/api/episode/0/0%20", "/API/library"),
            *("/zarr.json", "/0/zarr.json", "/.git/config", "/static/.gitignore"),
        ],
    )
    def test_what_is_no_address_of_the_page_is_not_found(
        self, server: Running, address: str
    ) -> None:
        code, head, body = ask(server, address.replace(" ", "%09"))
        assert code == 404
        assert is_whole(head)
        assert set(json.loads(body)) == {"error"}

    @pytest.mark.parametrize("name", ["../../../secret", "front/../front", "", "front\x00", SCRIPT])
    def test_a_camera_is_a_name_and_never_a_path(self, server: Running, name: str) -> None:
        code, _, body = ask(server, f"/image/0/0/{quote(name, safe='')}/rgb/0.png")
        assert code == 404
        assert SECRET.encode() not in body

    @settings(max_examples=150)
    @given(address=st.text(st.characters(min_codepoint=0x21, max_codepoint=0x7E), max_size=60))
    def test_any_address_has_a_proper_answer(self, server: Running, address: str) -> None:
        code, head, _ = ask(server, f"/{address}")
        assert code in (200, 400, 404)
        assert is_whole(head)

    def test_a_link_in_a_store_to_a_file_outside_does_not_give_it_away(
        self, own_server: tuple[Running, Path]
    ) -> None:
        server, store = own_server
        secret = store.parent / "secret.txt"
        secret.write_text(SECRET)
        for file in (store / "cameras/front/rgb").glob("0.*"):
            file.unlink()
            file.symlink_to(secret)
        (store / "cameras/front/rgb/more.png").symlink_to(secret)
        for address in ("/image/0/0/front/rgb/0.png", "/thumb/0/0.jpg", "/cloud/0/0/0"):
            code, _, body = ask(server, address)
            assert code == 503
            assert SECRET.encode() not in body

    def test_a_tag_is_not_written_through_a_link(self, own_server: tuple[Running, Path]) -> None:
        server, store = own_server
        victim = store.parent / "victim.txt"
        victim.write_text("unfinished line")
        log = store / "annotations" / "log.jsonl"
        log.unlink()
        log.symlink_to(victim)
        headers, body = tagging(server)
        code, _, said = ask(server, "/api/annotations", headers, "POST", body)
        assert (code, b"link" in said) == (503, True)
        assert victim.read_text() == "unfinished line"


class TestHosts:
    ADDRESSES = ("/", "/api/library", "/static/main.js", "/image/0/0/front/rgb/0.png", "/nowhere")
    FOREIGN = (
        *("evil.example", "evil.example:{port}", "EVIL.EXAMPLE", "127.0.0.1.evil.example:{port}"),
        *(
            "localhost.evil.example",
            "evil.example#127.0.0.1",
            "localhost@evil.example",
            "localhost.",
        ),
        *(
            "127.0.0.2:{port}",
            "0.0.0.0:{port}",
            "[::1]:{port}",
            "[::ffff:127.0.0.1]:{port}",
            "[::]",
        ),
        *(
            "2130706433",
            "0x7f000001",
            "127.1",
            "127.0.0.1:{port}:{port}",
            "127.0.0.1:evil",
            ":{port}",
        ),
        *(
            "localhost, evil.example",
            "192.168.0.1:{port}",
            "[127.0.0.1]:{port}x",
            "*",
            "null",
            "[",
            "]",
        ),
    )

    @pytest.mark.parametrize("host", FOREIGN)
    @pytest.mark.parametrize("address", ADDRESSES)
    def test_a_foreign_name_is_refused_everywhere(
        self, server: Running, host: str, address: str
    ) -> None:
        code, head, body = ask(server, address, {"Host": host.format(port=server.port)})
        assert code == 403
        assert is_whole(head)
        assert b"Host" in body

    def test_a_request_without_a_name_is_refused(self, server: Running) -> None:
        assert talk(server, b"GET / HTTP/1.0\r\n\r\n")[0] == 403
        assert talk(server, b"GET /api/library HTTP/1.0\r\nHost:\r\n\r\n")[0] == 403
        assert talk(server, b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n")[0] == 403

    def test_two_names_are_refused(self, server: Running) -> None:
        names = f"Host: {server.host}\r\nHost: evil.example\r\n"
        code, *_ = talk(server, f"GET / HTTP/1.1\r\n{names}Connection: close\r\n\r\n".encode())
        assert code in (400, 403)

    @pytest.mark.parametrize(
        "header", ["X-Forwarded-Host", "Forwarded", "X-Host", "X-Original-Host", "X-Original-URL"]
    )
    def test_a_proxy_s_headers_change_nothing(self, server: Running, header: str) -> None:
        trusted = "host=localhost" if header == "Forwarded" else "localhost"
        assert ask(server, "/", {"Host": "evil.example", header: trusted})[0] == 403
        foreign = "host=evil.example" if header == "Forwarded" else "evil.example"
        assert ask(server, "/", {header: foreign})[0] == 200

    @pytest.mark.parametrize(
        "host", ["127.0.0.1", "127.0.0.1:{port}", "localhost", "localhost:{port}", "LOCALHOST:1"]
    )
    def test_its_own_names_are_answered(self, server: Running, host: str) -> None:
        assert ask(server, "/api/library", {"Host": host.format(port=server.port)})[0] == 200

    def test_a_name_that_was_allowed_is_answered(self, store: Path) -> None:
        with browsing(store, "--allow-host", "Lab-PC") as server:
            assert ask(server, "/", {"Host": "lab-pc:8642"})[0] == 200
            assert ask(server, "/", {"Host": "lab-pc2:8642"})[0] == 403

    @pytest.mark.parametrize(
        ("target", "code"),
        [
            ("http://evil.example/api/live", 403),
            ("http://evil.example:{port}/api/live", 403),
            ("http://127.0.0.1@evil.example/api/live", 403),
            ("ftp:///api/live", 403),
            ("http://127.0.0.1:{port}/api/live", 200),
        ],
    )
    def test_a_whole_address_as_the_target_is_taken_by_its_own_name(
        self, server: Running, target: str, code: int
    ) -> None:
        assert ask(server, target.format(port=server.port))[0] == code

    def test_connections_on_which_nothing_comes_keep_nobody_out(self, server: Running) -> None:
        with contextlib.ExitStack() as stack:
            for k in range(120):
                where = ("127.0.0.1", server.port)
                idle = stack.enter_context(socket.create_connection(where, timeout=20))
                if k % 2:
                    idle.sendall(b"GET /api/live HTTP/1.1\r\nHost: 127.0")
            started = time.monotonic()
            assert ask(server, "/api/live")[0] == 200
            assert time.monotonic() - started < 5.0

    def test_it_listens_at_this_machine_s_own_address_alone(self, server: Running) -> None:
        for address in other_addresses():
            with pytest.raises(OSError):
                socket.create_connection((address, server.port), timeout=2).close()
        with pytest.raises(OSError):
            socket.create_connection(("::1", server.port), timeout=2).close()

    def test_everywhere_is_every_address_of_the_machine_and_no_name(self, store: Path) -> None:
        with browsing(store, "--host", "0.0.0.0") as server:
            for address in ["127.0.0.1", *other_addresses()]:
                host = {"Host": f"{address}:{server.port}", "Connection": "close"}
                head = "".join(f"{k}: {v}\r\n" for k, v in host.items())
                request = f"GET /api/live HTTP/1.1\r\n{head}\r\n".encode()
                assert talk(server, request, address)[0] == 200
            assert ask(server, "/", {"Host": "evil.example"})[0] == 403

    @given(host=st.text(max_size=40))
    def test_no_other_text_is_a_name_of_the_server(self, host: str) -> None:
        guard = Guard.of(["127.0.0.1", "localhost"], "")
        name = host.lower().partition(":")[0]
        if guard._is_ours(host.lower()):
            assert name in ("127.0.0.1", "localhost", "[127.0.0.1]", "[localhost]")


def other_addresses() -> list[str]:
    """Return addresses of this machine that are not loopback; without a network there are none."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing
        return [probe.getsockname()[0]]
    return []


class TestOrigins:
    @pytest.mark.parametrize(
        "origin",
        [
            *("http://evil.example", "https://evil.example", "null", "http://localhost:1"),
            *("http://127.0.0.1:1", "file://", "http://127.0.0.1.evil.example", "http://", "*"),
            *("chrome-extension://abc", "{own}.evil.example", "{own}/", "ftp://{host}", "{host}"),
        ],
    )
    def test_a_foreign_origin_is_refused_with_or_without_the_token(
        self, server: Running, store: Path, origin: str
    ) -> None:
        foreign = origin.format(own=f"http://{server.host}", host=server.host)
        before = AnnotationLog(store).changes()
        headers, body = tagging(server)
        code, *_ = ask(server, "/api/annotations", headers | {"Origin": foreign}, "POST", body)
        assert code == 403
        assert ask(server, "/api/library", {"Origin": foreign})[0] == 403
        assert AnnotationLog(store).changes() == before

    @pytest.mark.parametrize("site", ["cross-site", "same-site", "", "nonsense"])
    def test_another_site_s_page_may_only_follow_a_link_to_the_page(
        self, server: Running, site: str
    ) -> None:
        said = {"Sec-Fetch-Site": site or "cross-site", "Sec-Fetch-Mode": "no-cors"}
        assert ask(server, "/", said)[0] == 403
        navigating = said | {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
        assert ask(server, "/", navigating)[0] == 200
        assert ask(server, "/", navigating | {"Sec-Fetch-Dest": "iframe"})[0] == 403
        for address in (
            "/api/library",
            "/image/0/0/front/rgb/0.png",
            "/static/main.js",
            "/thumb/0/0.jpg",
        ):
            assert ask(server, address, navigating)[0] == 403
            assert ask(server, address, said | {"Sec-Fetch-Dest": "image"})[0] == 403

    def test_the_page_itself_may_do_all(self, server: Running) -> None:
        same = {"Sec-Fetch-Site": "same-origin", "Origin": f"http://{server.host}"}
        assert ask(server, "/api/library", same)[0] == 200
        assert ask(server, "/", {"Sec-Fetch-Site": "none"})[0] == 200

    def test_no_answer_allows_another_origin_to_read(self, server: Running) -> None:
        for method in ("GET", "OPTIONS"):
            asked = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
            code, head, _ = ask(server, "/api/annotations", asked, method)
            assert code == 403
            assert b"access-control" not in head.lower()
        assert b"access-control" not in ask(server, "/api/library")[1].lower()


class TestWriting:
    @pytest.mark.parametrize(
        ("change", "code"),
        [
            ({"X-Token": ""}, 403),
            ({"X-Token": "wrong"}, 403),
            ({"X-Token": "\xe9\xff"}, 403),
            ({"X-Token": "{token}x"}, 403),
            ({"X-Token": "", "Cookie": "X-Token={token}"}, 403),
            ({"X-Token": "", "Authorization": "Bearer {token}"}, 403),
            ({"Content-Type": ""}, 415),
            ({"Content-Type": "text/plain"}, 415),
            ({"Content-Type": "application/x-www-form-urlencoded"}, 415),
            ({"Content-Type": "multipart/form-data; boundary=x"}, 415),
            ({"Content-Type": "text/plain; application/json"}, 415),
        ],
    )
    def test_without_token_or_as_a_form_nothing_is_written(
        self, server: Running, store: Path, change: dict[str, str], code: int
    ) -> None:
        before = AnnotationLog(store).changes()
        headers, body = tagging(server)
        headers |= {name: value.format(token=server.token) for name, value in change.items()}
        got, head, _ = ask(server, "/api/annotations", headers, "POST", body)
        assert got == code
        assert is_whole(head)
        assert AnnotationLog(store).changes() == before

    def test_the_token_does_not_count_in_the_address(self, server: Running) -> None:
        headers, body = tagging(server)
        del headers["X-Token"]
        for where in (f"?token={server.token}", f"?X-Token={server.token}"):
            assert ask(server, f"/api/annotations{where}", headers, "POST", body)[0] == 403

    def test_the_token_is_in_no_answer(self, server: Running) -> None:
        for address in ("/", "/api/library", "/api/episodes", "/api/live", "/api/episode/0/0"):
            _, head, body = ask(server, address)
            assert server.token.encode() not in head + body

    def test_read_only_takes_no_token_at_all(self, store: Path) -> None:
        before = AnnotationLog(store).changes()
        with browsing(store, "--read-only") as server:
            assert "#" not in server.url
            assert json.loads(ask(server, "/api/library")[2])["writable"] is False
            for token in ("", "x"):
                headers, body = tagging(server)
                headers["X-Token"] = token
                code, _, said = ask(server, "/api/annotations", headers, "POST", body)
                assert (code, b"--read-only" in said) == (403, True)
        assert AnnotationLog(store).changes() == before

    @pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "TRACE", "OPTIONS", "GET", "FOO"])
    @pytest.mark.parametrize("address", ["/api/annotations", "/", "/api/library"])
    def test_no_other_method_does_anything(
        self, server: Running, method: str, address: str
    ) -> None:
        if method == "GET" and address != "/api/annotations":
            return
        headers, body = tagging(server)
        code, head, said = ask(server, address, headers, method, body)
        assert code == 405
        assert is_whole(head)
        assert server.token.encode() not in said  # TRACE would echo it

    def test_a_post_elsewhere_is_refused(self, server: Running) -> None:
        headers, body = tagging(server)
        for address in ("/", "/api/library", "/api/episode/0/0", "/static/main.js"):
            assert ask(server, address, headers, "POST", body)[0] == 405


class TestBodies:
    def test_ten_megabytes_are_refused_before_they_are_read(self, server: Running) -> None:
        size = 10_000_000
        headers, _ = tagging(server)
        head = "".join(f"{k}: {v}\r\n" for k, v in headers.items())
        start = time.monotonic()
        with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
            connection.sendall(
                f"POST /api/annotations HTTP/1.1\r\nHost: {server.host}\r\n{head}"
                f"Content-Length: {size}\r\n\r\n".encode()
            )
            answer = connection.recv(65536)  # although no byte of the body was sent
        assert b" 413 " in answer.split(b"\r\n")[0]
        assert is_whole(answer.partition(b"\r\n\r\n")[0])
        assert time.monotonic() - start < 5
        assert ask(server, "/api/live")[0] == 200

    def test_ten_megabytes_that_come_nevertheless_do_no_harm(self, server: Running) -> None:
        headers, _ = tagging(server)
        with contextlib.suppress(ConnectionError):
            code, *_ = ask(server, "/api/annotations", headers, "POST", bytes(10_000_000))
            assert code == 413
        assert ask(server, "/api/live")[0] == 200

    def test_a_body_in_chunks_without_an_end_is_refused(self, server: Running) -> None:
        headers, _ = tagging(server)
        head = "".join(f"{k}: {v}\r\n" for k, v in headers.items())
        with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
            connection.sendall(
                f"POST /api/annotations HTTP/1.1\r\nHost: {server.host}\r\n{head}"
                "Transfer-Encoding: chunked\r\n\r\n".encode()
            )
            sent = 0
            piece = b"2000\r\n" + bytes(0x2000) + b"\r\n"
            with contextlib.suppress(ConnectionError):
                while sent < 10_000_000:
                    connection.sendall(piece)
                    sent += len(piece)
        assert sent < 10_000_000, "all of it was taken"
        assert ask(server, "/api/live")[0] == 200

    def test_a_body_of_the_largest_size_is_read(self, server: Running) -> None:
        headers, _ = tagging(server)
        for size, code in ((MOST_BODY, 400), (MOST_BODY + 1, 413)):
            assert ask(server, "/api/annotations", headers, "POST", b" " * size)[0] == code

    @pytest.mark.parametrize(
        "body",
        [
            *(b"", b"{", b"[]", b"null", b"7", b'"x"', b"{}", b"\xff\xfe", b"\x00"),
            *(b"[" * 60_000, b'{"a":' * 10_000, b"1" * 60_000, b"-" + b"9" * 5_000),
            b'{"episodes": [[0, ' + b"1" * 5_000 + b']], "who": "a", "changes": [["tag", "x"]]}',
            b'{"episodes": [[0, 1e999]], "who": "a", "changes": [["tag", "x"]]}',
            b'{"episodes": [[0, NaN]], "who": "a", "changes": [["tag", "x"]]}',
            b'{"episodes": [[0, 0]], "who": "a", "changes": [["tag", ' + b"[" * 9_000 + b"]]}",
            b'{"episodes": [[0, 0]], "who": "\\ud800", "changes": [["tag", "\\ud800"]]}',
            b'{"episodes": [[0, 0]], "who": "a", "changes": [["quality", 1' + b"0" * 400 + b"]]}",
            b'{"episodes": [[0, 0]], "who": "a", "changes": [["mark", {"id": 1}]]}',
            b'{"episodes": [[0, 0]], "who": "a", "changes": [["tag", {"__proto__": 1}]]}',
        ],
        ids=lambda body: repr(body[:24]),
    )
    def test_nonsense_is_a_mistake_and_no_trouble(
        self, server: Running, store: Path, body: bytes
    ) -> None:
        before = AnnotationLog(store).changes()
        headers, _ = tagging(server)
        code, head, said = ask(server, "/api/annotations", headers, "POST", body or b" ")
        assert code == 400
        assert is_whole(head)
        assert len(said) < 3000
        assert set(json.loads(said)) == {"error"}
        assert AnnotationLog(store).changes() == before

    def test_a_header_without_an_end_is_refused(self, server: Running) -> None:
        code, head, body = ask(server, "/", {"X-Long": "x" * (2 * MOST_HEADER)})
        assert code in (400, 431)
        assert is_whole(head)
        assert b"xxx" not in body

    @pytest.mark.parametrize(
        "data",
        [
            *(b"<script>\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/1.1\r\n<b>x</b>\r\n\r\n"),
            *(
                b"GET /<script> HTTP/9.9\r\n\r\n",
                b"get / HTTP/1.1\r\n\r\n",
                b"\x16\x03\x01\r\n\r\n",
            ),
            b"GET / HTTP/1.1\r\nContent-Length: <b>\r\n\r\n",
            b"GET http://[<script> HTTP/1.1\r\n\r\n",
        ],
    )
    def test_what_is_no_http_gets_an_answer_without_a_word_of_it(
        self, server: Running, data: bytes
    ) -> None:
        code, head, body = talk(server, data)
        assert 400 <= code < 600
        assert is_whole(head)
        assert b"<" not in body
        assert b"content-type: application/json" in head.lower()


class TestScript:
    def test_text_of_the_data_is_json_and_never_html(self, server: Running) -> None:
        where = quote(f"object_id={SCRIPT}", safe="")
        for address in (
            *("/api/episodes", f"/api/episodes?where={where}", "/api/episode/0/0", "/api/library"),
            *("/api/episode/0/1", "/api/episode/0/3", "/api/histogram?column=object_id"),
        ):
            code, head, body = ask(server, address)
            assert code == 200
            assert b"content-type: application/json" in head.lower()
            assert is_whole(head)
            assert SCRIPT in body.decode().replace('\\"', '"')

    @pytest.mark.parametrize(
        "address",
        [
            "/{script}",
            "/api/episodes?where={script}",
            "/api/episodes?sort={script}",
            "/api/episodes?limit={script}",
            "/api/histogram?column={script}",
            "/image/0/0/{script}/rgb/0.png",
            "/image/0/0/front/{script}/0.png",
            "/thumb/0/0.jpg?camera={script}",
            "/thumb/0/0.jpg?frame={script}",
        ],
    )
    def test_an_error_that_quotes_what_was_asked_is_json(
        self, server: Running, address: str
    ) -> None:
        code, head, body = ask(server, address.format(script=quote(SCRIPT, safe="")))
        assert code in (400, 404)
        assert b"content-type: application/json" in head.lower()
        assert is_whole(head)
        assert set(json.loads(body)) == {"error"}

    def test_no_header_can_be_made_by_what_is_asked(self, server: Running) -> None:
        for address in ("/%0d%0aX-Evil:%201", "/thumb/0/0.jpg?v=%0d%0aX-Evil:%201"):
            assert b"x-evil" not in ask(server, address)[1].lower()

    def test_the_page_has_no_script_of_its_own_in_the_html(self, server: Running) -> None:
        _, head, body = ask(server, "/")
        assert b"unsafe" not in head
        page = body.decode()
        assert "<style" not in page
        assert " style=" not in page
        assert " on" not in page.replace(" on ", " ").split("<body")[0]
        for part in page.split("<script")[1:]:
            tag, _, rest = part.partition(">")
            assert "src=" in tag
            assert rest.lstrip().startswith("</script>")

    @pytest.mark.slow
    def test_a_bug_shows_nobody_a_traceback(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from grasp_factory.apps.browse.app import create_app
        from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
        from grasp_factory.dataset.index import Index, fresh

        def fail(*_: object) -> None:
            raise ZeroDivisionError("the secret inside")

        monkeypatch.setattr(Index, "page", fail)
        with fresh([store], tmp_path / "index.sqlite") as index:
            app = create_app(index, "", {"localhost"}, thumbnails=Thumbnails(tmp_path))
            answer = app.test_client().get("/api/episodes")
        assert answer.status_code == 500
        assert b"secret" not in answer.data
        assert b"Traceback" not in answer.data
        assert is_whole(f"x\r\n{answer.headers}".encode())
