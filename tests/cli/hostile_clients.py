#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Clients that try to block, exhaust or confuse `l4dcodec serve`, at loopback.

    hostile_clients.py TOOL FOLDER [NAME...]

FOLDER has small.l4d, and large.l4d, of which socket buffers hold only a part. Each function `try_NAME` has a server
of its own, which then must still answer others within a second, must have stayed small, and must end within a second
of SIGINT, with its document, while the clients are there. A busy machine can be late: more time has what would take
about as long without the clients, and only what is late three times counts. All names without NAME.
"""
import json
import pathlib
import re
import signal
import socket
import subprocess
import sys
import time

TOOL, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])
SMALL = (FOLDER / "small.l4d").read_bytes()
SOON = 1.0  # seconds
BUSY = 4.0  # times what a server without such clients takes, where that is longer
TIMEOUT = 60.0  # of a socket: that a server does not answer at all, and no measure of how late it is
MOST_MEMORY = 64 << 20
STRANGER, TAKING = 10.0, 60.0  # Connections::kStranger, kTaking


class Late(Exception):
    """Something took longer than it may."""


class Server:
    def __init__(self, *options):
        self.process = subprocess.Popen([TOOL, "serve", str(FOLDER), "--json", *options], stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE)
        listening = json.loads(self.process.stdout.readline())
        self.port = listening["port"]
        self.root = "/" + listening["url"].split("/")[3] + "/"
        self.clients = []

    def connect(self):
        client = socket.create_connection(("127.0.0.1", self.port), timeout=TIMEOUT)
        self.clients.append(client)
        return client

    def request(self, path="small.l4d", method="GET", more="", end="\r\n"):
        return (f"{method} {self.root}{path} HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\n{more}{end}").encode()

    def get(self):
        """One file by a connection of its own; how many seconds that took."""
        began = time.monotonic()
        client = socket.create_connection(("127.0.0.1", self.port), timeout=TIMEOUT)
        client.sendall(self.request(more="Connection: close\r\n"))
        text = read_to_end(client)
        client.close()
        assert text.startswith(b"HTTP/1.1 200 ") and text.endswith(SMALL), text[:100]
        return time.monotonic() - began

    def answers(self):
        try:
            return self.get() > 0
        except (AssertionError, ConnectionError):
            return False

    def memory(self):
        """Bytes in RAM, at most so far."""
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmHWM:\s*(\d+) kB", status)[1]) << 10

    def end(self):
        """By SIGINT, while the clients are there."""
        began = time.monotonic()
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=TIMEOUT)
        took = time.monotonic() - began
        document = json.loads(out)
        assert self.process.returncode == 0 and not err, (self.process.returncode, err)
        assert document["schema"] == "l4dcodec.serve/1", document
        return took

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        for client in self.clients:
            client.close()


def check_soon(what, took):
    """Late, unless this moment is: a server without such clients tells."""
    if took <= SOON:
        return
    quiet = Server()
    try:
        takes = {"answered": quiet.get(), "ended": quiet.end()}[what]
    finally:
        quiet.close()
    if took > BUSY * takes:
        raise Late(f"{what} after {took:.1f} s, and without such clients after {takes:.1f} s")


def read_to_end(client):
    """What comes until the connection ends, whether in order or not."""
    text = bytearray()
    try:
        while piece := client.recv(65536):
            text += piece
    except ConnectionError:
        pass
    return bytes(text)


def statuses(text):
    return [int(code) for code in re.findall(rb"HTTP/1\.1 (\d+) ", text)]


def send_much(client, piece, total):
    """Sends `total` bytes, or what goes until the other side has ended; how many."""
    sent = 0
    try:
        while sent < total:
            client.sendall(piece)
            sent += len(piece)
    except (ConnectionError, socket.timeout):
        pass
    return sent


def flood(server, piece):
    client = server.connect()
    client.sendall(server.request(end=""))
    sent = send_much(client, piece, 240 << 20)
    assert sent < 16 << 20, f"{sent} bytes of headers were taken"


def try_header_lines(server):
    flood(server, b"".join(b"X-%05d: %s\r\n" % (k, b"y" * 90) for k in range(640)))


def try_short_lines(server):
    flood(server, b"a:\r\n" * 16384)


def try_one_line(server):
    flood(server, b"y" * 65536)


def try_long_path(server):
    client = server.connect()
    client.sendall(b"GET /")
    sent = send_much(client, b"y" * 65536, 240 << 20)
    assert sent < 16 << 20, f"{sent} bytes of a path were taken"


def try_too_many_lines(server):
    client = server.connect()
    client.sendall(server.request(more="a: b\r\n" * 200))
    assert statuses(read_to_end(client)) == [431]
    client = server.connect()
    client.sendall(server.request(more=f"Host: 127.0.0.1:{server.port}\r\n"))
    assert statuses(read_to_end(client)) == [400]


def slow(server, count):
    """Clients of which each sends a byte, again and again."""
    text = server.request(more="X: " + "y" * 1000)
    clients = [server.connect() for _ in range(count)]
    for k in range(8):
        for client in clients:
            try:
                client.send(text[k:k + 1])
            except ConnectionError:
                pass
        check_soon("answered", server.get())
    return clients


def try_32_slow(server):
    """They get ten seconds for a request, however busy they are."""
    began = time.monotonic()
    clients = slow(server, 32)
    while clients and time.monotonic() < began + STRANGER + TIMEOUT:
        time.sleep(0.5)
        for client in list(clients):
            try:
                client.send(b"y")
            except ConnectionError:
                clients.remove(client)
    assert not clients, f"{len(clients)} slow clients are still served"
    assert time.monotonic() > began + STRANGER - 1, "slow clients were cut early"
    slow(server, 32)


def try_300_slow(server):
    slow(server, 300)


def try_300_idle(server):
    """With the token, but idle. They make room, too."""
    clients = [server.connect() for _ in range(300)]
    for client in clients:
        try:
            client.sendall(server.request(method="HEAD"))
            client.recv(65536)
        except ConnectionError:
            pass


def try_300_stalled(server):
    """With the token: they ask, and do not take the answer."""
    for k in range(300):
        try:
            server.connect().sendall(server.request("large.l4d"))
        except ConnectionError:
            pass
    # Who takes bytes within the last second is not cut, so that it can last until others are answered; not until the
    # time of those who stall is over.
    began, answers = time.monotonic(), False
    while not answers:
        time.sleep(0.1)
        answers = server.answers()
        if time.monotonic() > began + TAKING - 10:
            raise Late("no answer beside clients that stall")


def try_busy_downloads(server):
    """Connections in use stay: others come and go by the hundred."""
    client = server.connect()
    client.sendall(server.request("large.l4d", more="Connection: close\r\n"))
    head = client.recv(100)
    for _ in range(200):
        server.connect()
    size = (FOLDER / "large.l4d").stat().st_size
    text = head + read_to_end(client)
    assert len(text.split(b"\r\n\r\n", 1)[1]) == size


def try_bytes(server):
    """A request in single bytes is a request."""
    client = server.connect()
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    began = time.monotonic()
    try:
        for byte in server.request(more="Connection: close\r\n"):
            client.send(bytes([byte]))
            time.sleep(0.001)
    except ConnectionError:
        pass
    if (took := time.monotonic() - began) > STRANGER - 1:
        raise Late(f"a request in single bytes took {took:.1f} s of {STRANGER:.0f}")
    assert read_to_end(client).endswith(SMALL)


def try_bodies(server):
    """The connection ends with the refusal: a body is never a request."""
    inner = server.request()
    for method, status in (("POST", 405), ("PUT", 405), ("GET", 413), ("HEAD", 413)):
        for more, body in ((f"Content-Length: {len(inner)}\r\n", inner),
                           ("Transfer-Encoding: chunked\r\n", b"%x\r\n%s\r\n0\r\n\r\n" % (len(inner), inner)),
                           ("Content-Length: 100000000\r\nExpect: 100-continue\r\n", inner)):
            for pause in (0, 0.05):
                client = server.connect()
                client.sendall(server.request(method=method, more=more) + (b"" if pause else body))
                time.sleep(pause)
                try:
                    client.sendall(body if pause else b"")
                except ConnectionError:
                    pass
                text = read_to_end(client)
                assert statuses(text) == [status] and b"\r\nConnection: close\r\n" in text, (method, more, text)
    # Where servers could disagree on the end of a request, there is no second one.
    size = len(inner)
    for more in (f"Content-Length: 0\r\nContent-Length: {size}\r\n", f"Content-Length: {size}\r\nContent-Length: 0\r\n",
                 f"Content-Length: 0\r\nContent-Length: 0\r\n", f"Content-Length : {size}\r\n",
                 f"Content-Length:\r\n {size}\r\n", "Transfer-Encoding : chunked\r\n", "Transfer-Encoding:\r\n chunked\r\n",
                 f"Content-Length: +{size}\r\n", "Content-Length: \r\n"):
        for method in ("GET", "HEAD", "POST"):
            client = server.connect()
            client.sendall(server.request(method=method, more=more) + inner)
            text = read_to_end(client)
            assert set(statuses(text)) == {400} and SMALL not in text and b"\r\nConnection: close\r\n" in text, (method, more, text)
    # Without a body it goes on.
    client = server.connect()
    client.sendall(server.request(method="POST") + server.request(more="Connection: close\r\n"))
    assert statuses(read_to_end(client)) == [405, 200]


def try_pipelined(server):
    client = server.connect()
    client.sendall(server.request() * 2 + server.request("missing") + server.request(more="Connection: close\r\n") +
                   server.request())
    text = read_to_end(client)
    assert statuses(text) == [200, 200, 404, 200], statuses(text)
    assert text.count(SMALL) == 3 and text.endswith(SMALL)


def try_closing(server):
    host = f"Host: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode()
    for line, status in ((b"GET %ssmall.l4d HTTP/1.1\r\n" % server.root.encode(), 200),
                         (b"GET / HTTP/1.1\r\n", 404), (b"GET / HTTP/1.0\r\n", 404),
                         (b"DELETE / HTTP/1.1\r\n", 405), (b"GET / HTTP/1.1\r\nno colon\r\n", 400)):
        client = server.connect()
        client.sendall(line + host)
        assert statuses(read_to_end(client)) == [status], line


def try_garbage(server):
    noise = bytes((k * k * 31 + k // 7) % 256 for k in range(5000))
    for text in (noise, b"\0" * 5000, b"\r\n" * 5000, b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b" / HTTP/1.1\r\n\r\n",
                 b"\x16\x03\x01\x02\0\x01\0\x01\xfc\x03\x03" + noise, b"GET / HTTP/1.1\r\n\0: \0\r\n\r\n",
                 server.request(more="Content-Length: -1\r\n"), server.request(more="Content-Length: 5x\r\n"),
                 server.request(more="Content-Length: " + "9" * 40 + "\r\n"),
                 server.request(more="Transfer-Encoding: x\r\nContent-Length: 3\r\n")):
        client = server.connect()
        try:
            client.sendall(text)
            client.shutdown(socket.SHUT_WR)
        except OSError:
            pass
        answer = read_to_end(client)
        assert all(code >= 400 for code in statuses(answer)), (text[:60], answer)


def try_signal_while_idle(server):
    for _ in range(6):
        client = server.connect()
        client.sendall(server.request(method="HEAD"))
        client.recv(65536)
        server.connect()


def try_signal_while_delayed(server):
    server.connect().sendall(server.request())
    time.sleep(0.3)


def try_signal_while_limited(server):
    for _ in range(3):
        server.connect().sendall(server.request("large.l4d"))
    time.sleep(0.3)


def try_signal_while_stalled(server):
    server.connect().sendall(server.request("large.l4d"))
    server.connect().sendall(server.request(method="POST", more="Content-Length: 1000\r\n"))
    server.connect().sendall(server.request(end=""))
    time.sleep(0.3)


OPTIONS = {"try_signal_while_delayed": ["--delay", "60000"], "try_signal_while_limited": ["--rate", "0.01"]}


def run(name):
    server = Server(*OPTIONS.get(name, []))
    try:
        globals()[name](server)
        answered = 0.0
        if name not in OPTIONS:
            answered = server.get()
        memory = server.memory()
        ended = server.end()
        print(f"{name[4:]}: answered after {answered:.2f} s, ended after {ended:.2f} s, {memory >> 20} MiB", flush=True)
        assert memory < MOST_MEMORY, f"{memory} bytes"
        check_soon("answered", answered)
        check_soon("ended", ended)
    finally:
        server.close()


def main():
    names = [f"try_{name}" for name in sys.argv[3:]] or [name for name in globals() if name.startswith("try_")]
    for name in names:
        for attempt in range(3):
            try:
                run(name)
                break
            except (Late, socket.timeout, subprocess.TimeoutExpired) as late:
                print(f"{name[4:]}: {late}", flush=True)
                if attempt == 2:
                    sys.exit(f"{name[4:]}: late three times")
            except Exception:
                print(f"in {name[4:]}", file=sys.stderr)
                raise


if __name__ == "__main__":
    main()
