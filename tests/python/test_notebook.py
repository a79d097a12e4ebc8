# SPDX-License-Identifier: Apache-2.0
"""What notebooks show: pictures of the library, and the player, where it was built."""

import base64
import html
import http.server
import json
import os
import pathlib
import re
import shutil
import struct
import subprocess
import threading
import zlib
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest
from test_tool import read_png

import l4dcodec as l4d
from l4dcodec import notebook

SOURCE = pathlib.Path(os.environ["L4D_SOURCE"])
CHROMIUM = shutil.which("chromium")


def frames_of(data: bytes) -> "Tuple[List[np.ndarray[Any, Any]], List[Tuple[int, ...]]]":
    """The images of a PNG whose rows have the filter Up, and what its frame controls say."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, images, controls, size = 8, [], [], (0, 0)
    numbers = []
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        assert struct.unpack(">I", data[at + 8 + length:at + 12 + length])[0] == zlib.crc32(kind + body)
        if kind == b"IHDR":
            size = int.from_bytes(body[:4], "big"), int.from_bytes(body[4:8], "big")
        if kind in (b"fcTL", b"fdAT"):
            numbers.append(struct.unpack(">I", body[:4])[0])
        if kind == b"fcTL":
            controls.append(struct.unpack(">IIIIIHHBB", body))
        if kind in (b"IDAT", b"fdAT"):
            rows = np.frombuffer(zlib.decompress(body[4 if kind == b"fdAT" else 0:]), np.uint8)
            rows = rows.reshape(size[1], 1 + 3 * size[0])
            assert (rows[:, 0] == 2).all()
            images.append(np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).reshape(size[1], size[0], 3))
        at += length + 12
    assert numbers == list(range(len(numbers)))
    return images, controls


def test_pictures_are_renders(folder: pathlib.Path) -> None:
    with l4d.open(folder / "scene.l4d") as stream:
        camera = l4d.Camera.suggested(stream.info.presentation, 96, 54)
        still, moving = stream.show(time=0.5, width=96, height=54), l4d.show(stream, time=[0, 1], camera=camera, fps=4)
        expected = [255 * stream.render(t, camera).clip(0, 1) for t in (0.5, 0, 1)]
    (image,), controls = frames_of(still.data)
    assert not controls and image.std() > 5 and np.abs(image - expected[0]).max() <= 0.51
    images, controls = frames_of(moving.data)
    assert [(c[1:3], c[5:7]) for c in controls] == [((96, 54), (250, 1000))] * 2
    for image, wanted in zip(images, expected[1:]):
        assert np.abs(image - wanted).max() <= 0.51
    bundle = still._repr_mimebundle_()
    assert base64.b64decode(str(bundle["image/png"])) == still.data and "picture" in repr(still)


def test_without_the_player_it_is_a_picture(folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = l4d.open(folder / "scene.l4d")
    monkeypatch.setattr(notebook, "PLAYER", folder / "absent.js")
    assert stream.show(width=32, height=18).data == stream.show(time=1, width=32, height=18).data
    monkeypatch.undo()
    monkeypatch.setattr(notebook, "MAX_BYTES", 10)
    assert stream.show(width=32, height=18).kind == "png"


def test_pages_have_the_stream(folder: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "player.js"
    script.write_text("const answer = 6 < 7;")
    monkeypatch.setattr(notebook, "PLAYER", script)
    data = (folder / "scene.l4d").read_bytes()
    sources: List[Any] = [folder / "scene.l4d", data, bytearray(data)]
    for source in sources:
        with l4d.open(source) as stream:
            bundle: Dict[str, Any] = stream.show(width=320, height=200)._repr_mimebundle_()
        frame = re.fullmatch(r'<iframe srcdoc="([^"]*)" width="320" height="200".*</iframe>', bundle["text/html"], re.S)
        assert frame
        page = html.unescape(frame.group(1))
        found = re.search(r'atob\("([^"]*)"\)', page)
        assert found and base64.b64decode(found.group(1)) == data and "const answer = 6 < 7;" in page
    with pytest.raises(ValueError, match="closed"):
        stream.show()


@pytest.mark.skipif(not notebook.PLAYER.exists(), reason="the player was not built (./dev web)")
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_the_page_plays(folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """As a notebook has it: in a frame without an address of its own, on a server."""
    bundle = l4d.open(folder / "scene.l4d").show(width=320, height=180)._repr_mimebundle_()
    page = ("<!doctype html><body style='margin: 0'>" + str(bundle["text/html"]) + """<img src="slow" width="0"><script>
        const frame = document.querySelector("iframe"), wait = () => {
          const player = frame.contentDocument.querySelector("l4d-player");
          player?.isOpen ? setTimeout(() => fetch("shown"), 1000) : setTimeout(wait, 50);
        };
        wait();
        </script>""")
    shown = threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        """The page, and a picture that comes when the player shows something: a screenshot waits for it."""

        def do_GET(self) -> None:
            if self.path == "/slow":
                shown.wait(60)
            if self.path == "/shown":
                shown.set()
            body = page.encode() if self.path == "/page.html" else b""
            self.send_response(200 if self.path in ("/page.html", "/shown") else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        shot = tmp_path / "shot.png"
        # Without SwiftShader of these flags there is no WebGL2 on a machine without a display.
        subprocess.run([str(CHROMIUM), "--headless", "--no-sandbox", "--disable-dev-shm-usage", "--use-gl=angle",
                        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-watchdog",
                        f"--user-data-dir={tmp_path / 'profile'}", "--window-size=320,180", "--hide-scrollbars",
                        f"--screenshot={shot}", f"http://127.0.0.1:{server.server_port}/page.html"],
                       check=True, capture_output=True, timeout=120)
        server.shutdown()
    assert shown.is_set()
    colors = read_png(shot)
    assert (colors.max(axis=2) - colors.min(axis=2)).mean() > 20  # the player itself is grey


def test_the_notebook_was_run_and_runs(folder: pathlib.Path, tmp_path: pathlib.Path,
                                       monkeypatch: pytest.MonkeyPatch) -> None:
    path = SOURCE / "examples/notebook.ipynb"
    assert path.stat().st_size < 300_000
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1)) and len(cells) > 4
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert not any(output["output_type"] == "error" for output in outputs)
    assert any("image/png" in output.get("data", {}) for output in outputs)

    shutil.copy(folder / "scene.l4d", tmp_path)
    monkeypatch.chdir(tmp_path)
    names: Dict[str, Any] = {}
    for cell in cells:
        exec(compile("".join(cell["source"]), "notebook", "exec"), names)
    assert (tmp_path / "brighter.l4d").exists()
