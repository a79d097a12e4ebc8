# SPDX-License-Identifier: Apache-2.0
"""Scenes in notebooks: the player for web pages, or pictures that the library renders."""

import base64
import html
import pathlib
import struct
import zlib
from typing import List, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import arguments as given
from .camera import Camera
from .core import Floats, Path, as_array, floats
from .decoder import Decoder

PLAYER = pathlib.Path(__file__).with_name("player.js")
"""All of the player in one module, where it was built before the package."""
MAX_BYTES = 64 << 20
"""The longest stream that goes into a page."""

PAGE = """<!doctype html><meta charset="utf-8"><title>{title}</title>
<style>html, body {{ margin: 0; height: 100%; background: #0b0d10 }} l4d-player {{ width: 100%; height: 100vh }}</style>
<l4d-player playback="auto" autoplay controls></l4d-player>
<script type="module">{player}</script>
<script type="module">
const text = atob("{data}"), bytes = new Uint8Array(text.length);
for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
document.querySelector("l4d-player").load(bytes);
</script>
"""


class Shown:
    """What show() returns. A notebook displays it; write() makes a file of it."""

    def __init__(self, data: bytes, kind: str, width: int, height: int) -> None:
        self.data, self.kind, self.width, self.height = data, kind, width, height

    def __repr__(self) -> str:
        return f"<Shown: {'a page' if self.kind == 'html' else 'a picture'} of {len(self.data)} bytes>"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> "dict[str, object]":
        if self.kind == "png":
            return {"image/png": base64.b64encode(self.data).decode(), "text/plain": repr(self)}
        page = html.escape(self.data.decode())
        return {"text/plain": repr(self), "text/html":
                f'<iframe srcdoc="{page}" width="{self.width}" height="{self.height}" style="border: 0" allowfullscreen>'
                "</iframe>"}

    def write(self, path: Path) -> None:
        """Writes the page (.html) or the picture (.png)."""
        pathlib.Path(path).write_bytes(self.data)


def show(stream: Decoder, *, width: int = 640, height: int = 360, camera: Optional[Camera] = None,
         time: Union[None, float, Sequence[float]] = None, fps: float = 10) -> Shown:
    """Shows a stream in a notebook: in the player, with the stream inside the page, so that the notebook shows it
    without this library, too.

    With `camera` or `time`, in seconds, it is a picture of that instant, or a moving one of several instants, `fps`
    a second. So it is, of the middle, where the player was not built (./dev web) or the stream is longer than 64 MiB.
    width, height: pixels; a camera has its own.
    """
    given.of_type("stream", stream, Decoder, "a Decoder, as open() returns it")
    for name, size in (("width", width), ("height", height)):
        given.whole(name, size, least=1)
    given.number("fps", fps, above=0)
    if camera is not None:
        given.of_type("camera", camera, Camera, "None or a Camera")
    if time is None and camera is None and PLAYER.exists() and stream.info.file_bytes <= MAX_BYTES:
        page = PAGE.format(title=html.escape(stream._name), player=PLAYER.read_text(encoding="utf-8"),
                           data=base64.b64encode(stream._read()).decode())
        return Shown(page.encode(), "html", width, height)
    if time is None:
        time = (stream.timeline.time_begin + stream.timeline.time_end) / 2
    if camera is None:
        camera = Camera.suggested(stream.info.presentation, width, height)
    if np.ndim(as_array("time", time)) == 0:
        times = [given.number("time", time)]
    else:
        times = floats("time", time, len(time))  # type: ignore[arg-type]
    if not times:
        raise given.wrong_value("time", time, "None, seconds, or a list of them that is not empty")
    return Shown(png([stream.render(t, camera) for t in times], fps), "png", camera.width, camera.height)


def png(images: Sequence[Floats], fps: float = 10) -> bytes:
    """A PNG of [height, width, 3] floats from 0 to 1, with 8 bits each; a moving one (APNG) of several images."""
    height, width, _ = images[0].shape
    out = [b"\x89PNG\r\n\x1a\n", _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))]
    if len(images) > 1:
        out.append(_chunk(b"acTL", struct.pack(">II", len(images), 0)))
    number = 0
    for k, image in enumerate(images):
        if len(images) > 1:
            out.append(_chunk(b"fcTL", struct.pack(">IIIIIHHBB", number, width, height, 0, 0, round(1000 / fps), 1000,
                                                   0, 0)))
            number += 1
        packed = zlib.compress(_filtered(image))
        if k == 0:
            out.append(_chunk(b"IDAT", packed))
        else:
            out.append(_chunk(b"fdAT", struct.pack(">I", number) + packed))
            number += 1
    return b"".join([*out, _chunk(b"IEND", b"")])


def _filtered(image: Floats) -> bytes:
    """Rows as differences from the rows above them."""
    rows: npt.NDArray[np.uint8] = np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8).reshape(len(image), -1)
    kinds = np.full((len(rows), 1), 2, np.uint8)
    out: bytes = np.concatenate([kinds, np.diff(rows, axis=0, prepend=np.zeros_like(rows[:1]))], axis=1).tobytes()
    return out


def _chunk(kind: bytes, data: bytes) -> bytes:
    parts: List[bytes] = [struct.pack(">I", len(data)), kind, data, struct.pack(">I", zlib.crc32(kind + data))]
    return b"".join(parts)
