#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What captures and scenes that come from anywhere can make the tools take: the table of bombs.

captures.py L4DCODEC L4DTRAIN prints the table of docs/hostile-input.md. Each row is a small input that claims to be large. The tool refuses it with
the status of the row, and its peak memory stays below what it takes without any input (measured with
`version`), the limit, and SLACK.
"""
import json, os, re, resource, shutil, struct, subprocess, sys, tempfile, zlib

CODEC, TRAIN = (os.path.abspath(name) for name in sys.argv[1:3])
MIB = 1 << 20
SLACK = 24 * MIB  # threads, libraries and ffmpeg's pipes
SIZE = (48, 32)
# Name: what it is, and the file whose bytes count.
BOMBS = {
    "huge": ("a PNG of 16384 x 16384 pixels", "huge/cam01/0000.png"),
    "deep": ("PNGs of 16384 x 4096 pixels, 16 bits each", "deep/cam01/0000.png"),
    "texts": ("256 MiB in a compressed text and a colour profile of each PNG", "texts/cam01/0000.png"),
    "tail": ("64 MiB behind the end of a PNG", "tail/cam01/0000.png"),
    "mask": ("a mask of 16384 x 16384 pixels", "mask/mask.png"),
    "many": ("120 images that are one file of 2000 x 1500 pixels", "many/frame.png"),
    "cameras": ("60,000 cameras", "cameras/cameras.json"),
    "views": ("5,000 cameras of 16,000 frames", "views/cameras.json"),
    "brackets": ("2,000,000 brackets in a camera file", "brackets/cameras.json"),
    "count.ply": ("a PLY of 2^40 rows, none of which is there", "count.ply"),
    "bytes.ply": ("a PLY of signed bytes, which become floats", "bytes.ply"),
    "shape": ("a tensor of 2^60 numbers in four bytes", "shape.safetensors"),
    "nested": ("1,000,000 brackets in the header of tensors", "nested.safetensors"),
    "video": ("a video of 8192 x 8192 pixels", "video/cam00.mov"),
}


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, between=b"", depth=8):
    """A black RGB image; `between` are chunks before its pixels."""
    packer = zlib.compressobj(9)
    row, data = bytes(1 + 3 * width * depth // 8), b""
    for _ in range(height):
        data += packer.compress(row)
    data += packer.flush()
    header = struct.pack(">IIBBBBB", width, height, depth, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + between + chunk(b"IDAT", data) + chunk(b"IEND", b""))


def zeros(n):
    packer = zlib.compressobj(9)
    return b"".join(packer.compress(bytes(MIB)) for _ in range(n // MIB)) + packer.flush()


def camera(k, **more):
    return {"id": k, "K": [[50, 0, 24], [0, 50, 16], [0, 0, 1]], "images": "cam%02d/%%04d.png" % k,
            "w2c": [[1, 0, 0, 0.3 * k - 0.5], [0, 1, 0, 0], [0, 0, 1, 6], [0, 0, 0, 1]], **more}


def write_capture(folder, images, cameras=4, frames=2, **more):
    """images(camera, frame): bytes of a PNG. more: of camera 0."""
    os.makedirs(folder)
    for k in range(cameras):
        os.mkdir("%s/cam%02d" % (folder, k))
        for f in range(frames):
            open("%s/cam%02d/%04d.png" % (folder, k, f), "wb").write(images(k, f))
    write_cameras(folder, [camera(k, **(more if k == 0 else {})) for k in range(cameras)], frames)


def write_cameras(folder, cameras, frames):
    json.dump({"fps": 2, "width": SIZE[0], "height": SIZE[1], "frames": frames, "cameras": cameras},
              open(folder + "/cameras.json", "w"))


def peak(command):
    """Exit status, peak of memory in bytes, and what is written to stderr."""
    child = "import os,resource,subprocess,sys\n" \
            "code=subprocess.run(sys.argv[1:],stdout=subprocess.DEVNULL).returncode\n" \
            "open('peak','w').write(str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))\n" \
            "sys.exit(code)"
    done = subprocess.run([sys.executable, "-c", child] + command, stderr=subprocess.PIPE, timeout=300)
    return done.returncode, 1024 * int(open("peak").read()), done.stderr.decode(errors="replace")


def make_inputs():
    plain, huge = png(*SIZE), png(16384, 16384)
    write_capture("plain", lambda k, f: plain)
    write_capture("huge", lambda k, f: huge if k == 1 and f == 0 else plain)
    write_capture("deep", lambda k, f: png(16384, 4096, depth=16) if k == 1 else plain)
    text = chunk(b"zTXt", b"Comment\0\0" + zeros(256 * MIB))
    profile = chunk(b"iCCP", b"profile\0\0" + zeros(256 * MIB))
    write_capture("texts", lambda k, f: png(*SIZE, text + profile) if k == 1 else plain)
    write_capture("tail", lambda k, f: plain + bytes(64 * MIB) if k == 1 and f == 0 else plain)
    write_capture("mask", lambda k, f: plain, mask="mask.png")
    open("mask/mask.png", "wb").write(huge)
    # As many images as there may be, all of them this file.
    write_capture("many", lambda k, f: b"", cameras=1, frames=1)
    os.remove("many/cam00/0000.png")
    open("many/frame.png", "wb").write(png(2000, 1500))
    os.mkdir("many/cam01")
    for f in range(60):
        for k in range(2):
            os.symlink("../frame.png", "many/cam%02d/%04d.png" % (k, f))
    json.dump({"fps": 30, "width": 2000, "height": 1500, "frames": 60, "cameras": [
        dict(camera(k), K=[[2000, 0, 1000], [0, 2000, 750], [0, 0, 1]]) for k in range(2)]},
              open("many/cameras.json", "w"))
    os.mkdir("cameras")
    write_cameras("cameras", [camera(k) for k in range(60000)], 1)
    os.mkdir("views")
    write_cameras("views", [camera(k) for k in range(5000)], 16000)
    os.mkdir("brackets")
    open("brackets/cameras.json", "w").write('{"cameras":' + "[" * 2000000)
    header = ("ply\nformat %s 1.0\ncomment l4d_ply 1\nelement vertex %d\n" +
              "".join("property float p%d\n" % k for k in range(4)) + "end_header\n")
    open("count.ply", "wb").write((header % ("binary_little_endian", 1 << 40)).encode())
    names = ["x", "y", "z", "opacity"] + ["scale_%d" % k for k in range(3)] + ["rot_%d" % k for k in range(4)]
    names += ["f_dc_%d" % k for k in range(3)]
    # Of signed bytes, which become numbers of four.
    count = 400000
    head = "ply\nformat binary_little_endian 1.0\nelement vertex %d\n" % count
    head += "".join("property char %s\n" % name for name in names) + "end_header\n"
    open("bytes.ply", "wb").write(head.encode() + bytes(count * len(names)))
    tensor = {"dtype": "F32", "shape": [1 << 40, 1 << 20], "data_offsets": [0, 4]}
    text = json.dumps({"features.0.weight": tensor}).encode()
    open("shape.safetensors", "wb").write(struct.pack("<Q", len(text)) + text + bytes(4))
    text = b'{"a":' + b"[" * 1000000
    open("nested.safetensors", "wb").write(struct.pack("<Q", len(text)) + text + bytes(4))
    if shutil.which("ffmpeg"):
        write_capture("video", lambda k, f: plain)
        subprocess.run(["ffmpeg", "-v", "error", "-f", "lavfi", "-i", "color=size=8192x8192:rate=2:duration=1",
                        "-c:v", "mjpeg", "-q:v", "31", "video/cam00.mov"], check=True)
        one = camera(0)
        del one["images"]
        write_cameras("video", [dict(one, video="cam00.mov")] + [camera(k) for k in range(1, 4)], 2)


def rows():
    """Name, limit in MiB, status, pattern, command without the limit."""
    def images(folder, scene="s.ply"):
        return [CODEC, "compare", scene, scene, "--images", "--cameras", folder + "/cameras.json"]

    def train(folder, *more):
        return [TRAIN, "train", folder, "-o", "run", "--steps", "5", "--backend", "cpu", "-n", "100", "--sh-degree", "0", "--views", "1",
                "--init", "frustum", "--threads", "2", "-q"] + list(more)

    size = "has 16384 x (16384|4096) pixels, and the camera has 48 x 32"
    for name in ("huge", "deep"):
        yield name, 50, 4, "camera 1: .*" + size, images(name)
        yield name, 50, 4, "camera 1, frame 0: .*" + size, train(name)
    yield "texts", 50, 0, "", images("texts")
    yield "texts", 50, 0, "", train("texts")
    yield "tail", 50, 6, "camera 1: .* needs 67.1 MB", images("tail")
    yield "tail", 50, 6, "camera 1, frame 0: .* needs 67.1 MB", train("tail")
    yield "mask", 50, 4, "camera 0: its mask: .*" + size, train("mask")
    yield "many", 100, 6, "a set of images of camera 0 needs", images("many", "long.ply")
    yield "many", 100, 6, "needs .*, and --limit-memory is", train("many", "--host-memory", "4G")
    yield "cameras", 50, 6, "cameras.json needs", images("cameras")
    yield "cameras", 50, 6, "cameras.json needs", train("cameras")
    yield "views", 400, 6, "the views needs", images("views", "long.ply")
    yield "brackets", 50, 6, "cameras.json needs", images("brackets")
    yield "brackets", 50, 6, "cameras.json needs", train("brackets")
    yield "count.ply", 50, 4, "", [CODEC, "encode", "count.ply", "-o", "x.l4d"]
    yield "bytes.ply", 50, 6, "bytes.ply needs", [CODEC, "encode", "bytes.ply", "-o", "x.l4d"]
    for name, status, text in (("shape", 5, "the shape of neither"), ("nested", 6, "its header needs")):
        lpips = ["--lpips", name + ".safetensors"]
        yield name, 50, status, text, images("plain") + lpips
        yield name, 50, status, text, train("plain", *lpips)
    if os.path.isdir("video"):
        yield "video", 50, 4, "camera 0: .*(48 x 32|damaged)", images("video")
        yield "video", 50, 4, "camera 0: .*48 x 32", train("video")


def main():
    subprocess.run([CODEC, "synth", "--scene", "cloud", "-q", "-n", "200", "--seconds", "1", "--fps", "2", "-o", "s.ply"], check=True)
    subprocess.run([CODEC, "synth", "--scene", "cloud", "-q", "-n", "200", "--seconds", "600", "--fps", "30", "-o", "long.ply"], check=True)
    make_inputs()
    base = {tool: peak([tool, "--help" if tool == TRAIN else "version"])[1] for tool in (CODEC, TRAIN)}
    failures = 0
    print("| bomb | bytes | tool | limit, MiB | exit status | peak above start, MiB |\n|---|---|---|---|---|---|")
    for name, limit, status, pattern, command in rows():
        shutil.rmtree("run", ignore_errors=True)
        code, held, text = peak(command + ["--limit-memory", "%dMiB" % limit if command[0] == CODEC else
                                           str(limit * MIB)])
        above = held - base[command[0]]
        what, path = BOMBS[name]
        print("| %s | %d | %s | %d | %d | %.1f |" % (what, os.path.getsize(path), os.path.basename(command[0]), limit, code,
                                                    max(0, above) / MIB))
        wrong = []
        if code != status:
            wrong.append("status %d, not %d" % (code, status))
        if pattern and not re.search(pattern, text):
            wrong.append("nothing matches " + pattern)
        if above > limit * MIB + SLACK:
            wrong.append("%.1f MiB above the start" % (above / MIB))
        if wrong:
            failures += 1
            print("  WRONG: %s\n  %s" % ("; ".join(wrong), text.strip()[:500]))
    return 1 if failures else 0


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        code = main()
        os.chdir("/")
    sys.exit(code)
