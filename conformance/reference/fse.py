# SPDX-License-Identifier: Apache-2.0
"""The entropy codes of zstd: finite state and Huffman tables, RFC 8878, section 4."""

from arithmetic import require

RULE = "CHNK-5"


class Bits:
    """Bits of bytes from their begin, least significant first."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def read(self, n):
        require(self.at + n <= 8 * len(self.data), RULE, "zstd: a table ends too early")
        first = self.at >> 3
        word = int.from_bytes(self.data[first:first + 8], "little")
        self.at += n
        return word >> (self.at - n - 8 * first) & (1 << n) - 1

    def bytes_used(self):
        return (self.at + 7) >> 3


class BackwardBits:
    """Bits of bytes from their end, where the highest bit that is set marks what comes first. Before
    the begin there are zeros; `left` is below 0 when one has been read."""

    def __init__(self, data):
        require(len(data) > 0 and data[-1] > 0, RULE, "zstd: a bitstream without its end mark")
        self.data = data
        self.left = 8 * len(data) - 9 + data[-1].bit_length()

    def peek(self, n):
        low = self.left - n
        if self.left <= 0:
            return 0
        first = max(low, 0) >> 3
        word = int.from_bytes(self.data[first:(self.left + 7) >> 3], "little") << 8 * first
        word &= (1 << self.left) - 1
        return word >> low if low >= 0 else word << -low

    def read(self, n):
        value = self.peek(n)
        self.left -= n
        return value


def read_counts(data, most_log, num_symbols):
    """(accuracy log, normalised counts, bytes used) of an FSE table description."""
    bits = Bits(data)
    log = bits.read(4) + 5
    require(log <= most_log, RULE, "zstd: accuracy of a table")
    left, counts = 1 << log, []
    while left > 0:
        width = (left + 1).bit_length()
        spare = (1 << width) - 1 - (left + 1)         # so many values are a bit shorter
        value = bits.read(width - 1)
        if value >= spare:
            value += bits.read(1) << (width - 1)
            if value >> (width - 1):
                value -= spare
        counts.append(value - 1)                      # -1: less than one
        left -= abs(value - 1)
        repeat = 3 if value == 1 else 0
        while repeat == 3:
            repeat = bits.read(2)
            counts += [0] * repeat
        require(len(counts) <= num_symbols, RULE, "zstd: symbols of a table")
    return log, counts, bits.bytes_used()


class Fse:
    """A table of states: (symbol, bits to read, base of the next state) each."""

    def __init__(self, log, counts):
        self.log, size = log, 1 << log
        symbols, last = [0] * size, size - 1
        for symbol, count in enumerate(counts):
            if count == -1:
                symbols[last] = symbol
                last -= 1
        at = 0
        for symbol, count in enumerate(counts):
            for _ in range(count):
                symbols[at] = symbol
                at = (at + (size >> 1) + (size >> 3) + 3) % size
                while at > last:
                    at = (at + (size >> 1) + (size >> 3) + 3) % size
        following = [abs(c) for c in counts]
        self.states = []
        for symbol in symbols:
            n = following[symbol]
            following[symbol] += 1
            bits = log - (n.bit_length() - 1)
            self.states.append((symbol, bits, (n << bits) - size))

    @staticmethod
    def of_one(symbol):
        """The table of RLE mode."""
        table = Fse(0, [1])
        table.states = [(symbol, 0, 0)]
        return table


class Huffman:
    """slots: (symbol, length of its code) for each value of the next `width` bits."""

    def __init__(self, weights):
        total = sum(1 << w >> 1 for w in weights)
        require(total > 0, RULE, "zstd: Huffman weights")
        self.width = total.bit_length()
        rest = (1 << self.width) - total
        require(self.width <= 11 and rest & (rest - 1) == 0 and len(weights) < 256, RULE,
                "zstd: Huffman weights")
        weights = [*weights, rest.bit_length()]
        self.slots = []
        for weight in range(1, self.width + 1):
            for symbol, w in enumerate(weights):
                if w == weight:
                    self.slots += [(symbol, self.width + 1 - w)] * (1 << w >> 1)
        require(len(self.slots) == 1 << self.width, RULE, "zstd: Huffman weights")

    @staticmethod
    def read(data):
        """The table that a description stands for, and how many bytes that takes."""
        require(len(data) > 0, RULE, "zstd: a Huffman table ends too early")
        head = data[0]
        size = head if head < 128 else (head - 127 + 1) // 2
        body = data[1:1 + size]
        require(len(body) == size, RULE, "zstd: a Huffman table ends too early")
        if head >= 128:
            weights = [b >> shift & 15 for b in body for shift in (4, 0)][:head - 127]
        else:
            weights = coded_weights(body)
        return Huffman(weights), 1 + size

    def decode(self, data, count):
        bits, out = BackwardBits(data), bytearray()
        for _ in range(count):
            symbol, length = self.slots[bits.peek(self.width)]
            bits.left -= length
            out.append(symbol)
        require(bits.left == 0, RULE, "zstd: the end of a Huffman stream")
        return out


def coded_weights(body):
    """Weights from two states that take turns until the bits are used up."""
    log, counts, used = read_counts(body, 6, 256)
    table, bits = Fse(log, counts), BackwardBits(body[used:])
    states = [bits.read(log), bits.read(log)]
    require(bits.left >= 0, RULE, "zstd: Huffman weights")
    weights, turn = [], 0
    while True:
        symbol, width, base = table.states[states[turn]]
        weights.append(symbol)
        require(len(weights) <= 255, RULE, "zstd: Huffman weights")
        states[turn] = base + bits.read(width)
        turn = 1 - turn
        if bits.left < 0:
            return [*weights, table.states[states[turn]][0]]
