"""The live view: what is sent, to whom, and that nobody can hold up the run."""

from __future__ import annotations

import base64
import http.client
import importlib.machinery
import json
import logging
import socket
import sys
import time
import types
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from clew.errors import InputError, MissingDependencyError
from clew.sim import LaserModel, SimulatedLog, simulate_kind
from clew.slam import Slam, Viewer
from clew.view.live import BrowserViewer, RerunViewer
from clew.view.live import rerun as rerun_view
from clew.view.live.frame import EMPTY, Feed, FrameMaker, LiveFrame
from clew.view.live.message import CLOUDS_AT_ONCE, Messenger
from clew.view.live.server import MOST_STREAMS


@cache
def drive() -> SimulatedLog:
    return simulate_kind("office", 5, duration=20.0, rate=3.0, laser=LaserModel(beams=181))


def mapped(viewer: Viewer | None = None, refine: bool = True) -> Slam:
    slam = Slam(viewer=viewer)
    for measurement in drive().measurements():
        slam.add(measurement)
    if refine:
        slam.refine()
    return slam


class Page:
    """What a page holds after the messages so far."""

    def __init__(self) -> None:
        self.poses = np.zeros((0, 3), np.float32)
        self.clouds: list[np.ndarray] = []
        self.closures = np.zeros((0, 2), np.int32)
        self.newest: dict[str, object] = {}
        self.last = False

    def take(self, event: bytes) -> None:
        lines = event.decode().splitlines()
        self.last = lines[0] == "event: last"
        message = json.loads(next(line for line in lines if line.startswith("data: "))[6:])
        new = array(message["poses"], "<f4").reshape(-1, 3)
        self.poses = np.concatenate([self.poses[: message["first"]], new])
        assert len(self.poses) == message["keyframes"]
        points = array(message["points"], "<i2").reshape(-1, 2)
        self.clouds += np.split(points, np.cumsum(message["clouds"])[:-1]) if message["clouds"] else []
        self.closures = array(message["closures"], "<i4").reshape(-1, 2)
        self.newest = message


def array(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=kind)


# --- messages


def test_page_holds_what_the_slam_holds() -> None:
    """Messages carry only what changed; put together they are the whole."""
    maker, messenger, page, slam = FrameMaker(len(drive().timestamps)), Messenger(), Page(), Slam()
    sizes = []
    for number, measurement in enumerate(drive().measurements()):
        slam.add(measurement)
        if number % 7 == 0 and slam.scan_count:
            event = messenger.write(maker.take(slam, "mapping"))
            sizes.append(len(event))
            page.take(event)
    slam.refine()
    page.take(messenger.write(maker.take(slam, "done")))
    np.testing.assert_allclose(page.poses, slam.keyframes.T_world_robot, atol=1e-5)
    assert len(page.clouds) == len(slam.keyframes) > 5
    for index, cloud in enumerate(page.clouds):
        points = slam.keyframe_points[index]
        step = -(-len(points) // 180)
        np.testing.assert_allclose(cloud / 100.0, points[::step], atol=0.0051)
    assert len(page.closures) == len(slam.closures)
    assert (page.newest["scans"], page.newest["total"]) == (slam.scan_count, drive().scan_count)
    np.testing.assert_allclose(page.newest["robot"], slam.pose.array, atol=1e-3)


def test_page_that_comes_late_gets_the_map_in_pieces() -> None:
    count = 2 * CLOUDS_AT_ONCE + 5
    clouds = [np.full((2, 2), k, np.int16) for k in range(count)]
    frame = LiveFrame("mapping", np.arange(3.0 * count).reshape(-1, 3), clouds, np.zeros(3), np.zeros(3),
                      np.zeros((0, 2), np.int16), np.zeros((0, 2), np.int32), 9, 0, 0, 1.0, last=True)  # fmt: skip
    messenger, page = Messenger(), Page()
    for piece in range(3):
        page.take(messenger.write(frame))
        assert page.last is (piece == 2)
        assert messenger.behind is (piece < 2)
    assert len(page.clouds) == count
    assert all((cloud == k).all() for k, cloud in enumerate(page.clouds))


def test_feed_keeps_the_newest_frame_only() -> None:
    feed = Feed()
    assert feed.wait(0, 0.01) is None
    for number in range(5):
        feed.publish(LiveFrame(**{**EMPTY.__dict__, "scans": number}))
    found = feed.wait(0, 0.01)
    assert found is not None
    assert (found[0], found[1].scans) == (5, 4)
    assert feed.wait(5, 0.01) is None


# --- the server


@pytest.fixture
def viewer() -> Iterator[BrowserViewer]:
    with BrowserViewer("a <b> log") as shown:
        yield shown


def ask(viewer: BrowserViewer, path: str, host: str | None = None, method: str = "GET") -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", viewer.server.port, timeout=10)
    connection.request(method, path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text


def test_page_and_its_parts_need_the_token(viewer: BrowserViewer) -> None:
    path = urlsplit(viewer.url).path
    status, page = ask(viewer, path)
    assert status == 200
    assert "a &lt;b&gt; log" in page
    for name in ("live.js", "draw.js", "live.css"):
        assert name in page or name in ask(viewer, path + "live.js")[1]
        assert ask(viewer, path + name)[0] == 200
        assert ask(viewer, "/" + name)[0] == 403
    assert "http://" not in page.replace("http-equiv", "")  # nothing from elsewhere
    assert ask(viewer, path.rstrip("/"))[0] == 301
    assert ask(viewer, path + "other")[0] == 404
    assert ask(viewer, path + "../live.js")[0] == 404


@pytest.mark.parametrize("path", ["/", "/events", "/x/events", "/x/", "//", "/" + "x" * 32 + "/", "/%00/"])
def test_without_the_token_nobody_gets_in(viewer: BrowserViewer, path: str) -> None:
    assert ask(viewer, path)[0] == 403


def test_tokens_differ_and_are_long() -> None:
    with BrowserViewer() as one, BrowserViewer() as other:
        assert one.server.token != other.server.token
        assert len(one.server.token) >= 32


def test_names_of_strangers_are_refused(viewer: BrowserViewer) -> None:
    """A page elsewhere whose name was made to point here sends its own name."""
    path, port = urlsplit(viewer.url).path, viewer.server.port
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1.evil.example", "", "192.168.7.7"):
        assert ask(viewer, path, host)[0] == 403, host
    for host in ("localhost", f"localhost:{port}", f"127.0.0.1:{port}", f"[::1]:{port}"):
        assert ask(viewer, path, host)[0] == 200, host


def test_only_this_machine_is_let_in_unless_told(viewer: BrowserViewer) -> None:
    assert viewer.server._http.server_address[0] == "127.0.0.1"
    assert urlsplit(viewer.url).hostname == "127.0.0.1"
    with BrowserViewer(host="0.0.0.0") as wide:
        path = urlsplit(wide.url).path
        assert ask(wide, path, "192.168.7.7:80")[0] == 200
        assert ask(wide, path, "evil.example")[0] == 403


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_nothing_but_reading_is_served(viewer: BrowserViewer, method: str) -> None:
    assert ask(viewer, urlsplit(viewer.url).path, method=method)[0] == 501


def test_place_that_cannot_be_listened_at_is_told(viewer: BrowserViewer) -> None:
    for host, port in (("127.0.0.1", viewer.server.port), ("no.such.host.invalid", 0), ("203.0.113.1", 0)):
        with pytest.raises(InputError, match="--live-host") as caught:
            BrowserViewer(host=host, port=port)
        assert "\n" not in str(caught.value)


# --- streams


class Stream:
    """An open stream of events."""

    def __init__(self, viewer: BrowserViewer) -> None:
        self.connection = http.client.HTTPConnection("127.0.0.1", viewer.server.port, timeout=10)
        self.connection.request("GET", urlsplit(viewer.url).path + "events")
        self.answer = self.connection.getresponse()

    def event(self) -> bytes:
        lines = []
        while line := self.answer.readline():
            if line == b"\n" and lines:
                return b"".join(lines)
            if not line.startswith((b":", b"\n")):
                lines.append(line)
        raise EOFError

    def close(self) -> None:
        self.connection.close()
        self.answer.close()


def until(condition: object, seconds: float = 10.0) -> bool:
    assert callable(condition)
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(condition())


def test_a_run_is_streamed_to_its_end() -> None:
    page = Page()
    with BrowserViewer(total=drive().scan_count) as viewer:
        stream = Stream(viewer)
        assert stream.answer.getheader("Content-Type") == "text/event-stream"
        slam = mapped(viewer)
        viewer.finish()
        while not page.last:
            page.take(stream.event())
        with pytest.raises(EOFError):
            stream.event()
        stream.close()
    np.testing.assert_allclose(page.poses, slam.keyframes.T_world_robot, atol=1e-5)
    assert page.newest["stage"] == "finished"


def test_the_estimate_does_not_depend_on_the_viewer() -> None:
    plain = mapped()
    with BrowserViewer() as viewer:
        stream = Stream(viewer)
        shown = mapped(viewer)
        stream.close()
    np.testing.assert_array_equal(shown.trajectory.T_world_robot, plain.trajectory.T_world_robot)


def test_pages_that_leave_are_forgotten_and_too_many_are_turned_away(viewer: BrowserViewer) -> None:
    streams = [Stream(viewer) for _ in range(MOST_STREAMS + 1)]
    assert [s.answer.status for s in streams] == [200] * MOST_STREAMS + [503]
    for stream in streams:
        stream.close()
    viewer.stage("next")  # writing to them shows that they have gone
    assert until(lambda: (viewer.stage("next"), viewer.server.streams == 0)[1])
    again = Stream(viewer)
    assert again.answer.status == 200
    again.close()


def test_page_that_reads_nothing_does_not_hold_up_the_run(viewer: BrowserViewer) -> None:
    """Its buffers are full long before: publishing still takes no time, and closing ends."""
    idle = socket.create_connection(("127.0.0.1", viewer.server.port))
    idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    idle.sendall(f"GET {urlsplit(viewer.url).path}events HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    assert until(lambda: viewer.server.streams == 1)
    rng = np.random.default_rng(0)
    begin = time.process_time()
    for _ in range(200):
        viewer.feed.publish(LiveFrame(**{**EMPTY.__dict__, "poses": rng.random((20_000, 3)),
                                         "clouds": [np.zeros((0, 2), np.int16)] * 20_000}))
    assert time.process_time() - begin < 5.0
    begin = time.monotonic()
    viewer.finish()
    viewer.server.close(seconds=0.5)
    assert time.monotonic() - begin < 5.0
    idle.close()


def test_nonsense_does_not_hurt_the_server(viewer: BrowserViewer) -> None:
    texts = [b"\r\n\r\n", b"GET\r\n\r\n", b"\x16\x03\x01" + bytes(100), b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 200,
             b"GET /\xc3\xa9/ HTTP/1.1\r\nHost: localhost\r\n\r\n"]
    for text in texts:
        with socket.create_connection(("127.0.0.1", viewer.server.port)) as rude:
            rude.sendall(text)
    assert ask(viewer, urlsplit(viewer.url).path)[0] == 200


# --- viewers that fail


class Broken:
    """A viewer that fails at its third scan."""

    def __init__(self) -> None:
        self.calls = 0

    def update(self, slam: Slam) -> None:
        self.calls += 1
        if self.calls == 3:
            raise OSError("the screen has gone")

    def moved(self, slam: Slam) -> None:
        self.calls += 1


def test_viewer_that_fails_is_dropped_and_the_run_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    broken = Broken()
    with caplog.at_level(logging.WARNING, "clew"):
        slam = mapped(broken)
    assert slam.scan_count == drive().scan_count
    assert broken.calls == 3
    assert [record.message for record in caplog.records] == [
        "the viewer failed (OSError: the screen has gone); the run goes on without it"]


# --- rerun


def test_missing_and_incompatible_rerun_are_told_apart(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"missing.*clew\[live\]"):
        RerunViewer(save=tmp_path / "a.rrd")
    monkeypatch.undo()
    old = types.ModuleType("rerun")
    old.__spec__ = importlib.machinery.ModuleSpec("rerun", None)
    monkeypatch.setitem(sys.modules, "rerun", old)
    with pytest.raises(MissingDependencyError, match=r"does not fit.*clew\[live\]"):
        RerunViewer(save=tmp_path / "a.rrd")


def test_rerun_recording_holds_the_run(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    with RerunViewer("office", tmp_path / "run.rrd", drive().scan_count) as viewer:
        slam = mapped(viewer)
    data = (tmp_path / "run.rrd").read_bytes()
    for name in (b"world/map", b"world/path", b"world/scan", b"world/closures"):
        assert name in data or name.replace(b"world/", b"/world/") in data
    assert len(data) > 10_000
    with pytest.raises(InputError, match="cannot be written"):
        RerunViewer("office", tmp_path / "none" / "run.rrd")
    frame = FrameMaker().take(slam, "done")
    points = rerun_view.map_points(frame)
    assert points.shape[1] == 2
    assert np.abs(points).max() < 100


