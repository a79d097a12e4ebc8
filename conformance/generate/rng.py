# SPDX-License-Identifier: Apache-2.0
"""Random numbers that are the same in every version of Python and on every machine: SplitMix64, and the
methods of random.Random that the generator uses. None of them calls the C library."""

M = (1 << 64) - 1


class Rng:
    def __init__(self, seed):
        self.state = seed & M

    def bits64(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) & M
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & M
        z = (z ^ z >> 27) * 0x94D049BB133111EB & M
        return z ^ z >> 31

    def random(self):
        """In [0, 1), a multiple of 2^-53."""
        return (self.bits64() >> 11) * 2.0 ** -53

    def randrange(self, n):
        """In 0..n-1; its bias is below n / 2^64."""
        return self.bits64() * n >> 64

    def randint(self, low, high):
        return low + self.randrange(high - low + 1)

    def uniform(self, low, high):
        return low + (high - low) * self.random()

    def bell(self, sigma):
        """About normal: the sum of twelve uniform numbers."""
        return (sum(self.random() for _ in range(12)) - 6) * sigma

    def power_of_two(self, low, high):
        """Between 2^low and 2^high, small ones as likely as large ones."""
        return (1 + self.random()) * 2.0 ** self.randint(low, high - 1)

    def choice(self, items):
        return items[self.randrange(len(items))]

    def shuffle(self, items):
        for i in range(len(items) - 1, 0, -1):
            j = self.randrange(i + 1)
            items[i], items[j] = items[j], items[i]

    def sample(self, items, k):
        items = list(items)
        self.shuffle(items)
        return items[:k]

    def randbytes(self, n):
        return bytes(self.randrange(256) for _ in range(n))
