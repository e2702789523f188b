"""Damaged copies of files: what transfers, editors and malice make of them."""

import re
from collections.abc import Callable

import numpy as np

NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
NUMBERS = (
    *(b"0", b"-1", b"1e999", b"-1e308", b"1e-320", b"nan", b".nan", b".inf", b"-.inf", b"NaN", b"Infinity"),
    *(b"null", b"yes", b"'1'", b"[1]", b"{}", b"999999999999999999999", b"2147483648", b"0x10", b"1_000"),
)
WORDS = (
    *(b"../../../../etc/passwd", b"/etc/passwd", b"package://a/../../b", b"file:///etc/hostname", b""),
    *(b"null", b"true", b"!!python/object/apply:os.system", b"&a", b"*a", b"<<", b"\xff\xfe", b"\x00"),
)
TEXT_BOMBS = (
    b"[" * 3000,
    b"{a: " * 2000,
    b"- " * 5000,
    b"a: &a [x]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b]\n"
    b"d: &d [*c,*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d,*d]\nf: [*e,*e,*e,*e,*e,*e,*e,*e]\n",
    b"".join(b"key%d: 1\n" % number for number in range(100_000)),
    b"\xef\xbb\xbf",
)


def mutated(content: bytes, seed: int, *, text: bool) -> bytes:
    """A damaged copy of a file's content; the same seed gives the same damage.

    Args:
        text: whether numbers and words of the file may be exchanged, besides bytes.
    """
    rng = np.random.default_rng(seed)
    kinds = (*_BYTES, *_TEXT) if text else _BYTES
    for _ in range(int(rng.choice([1, 1, 1, 2, 4, 12]))):
        content = kinds[int(rng.integers(len(kinds)))](content, rng)
    return content


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(content)
    for place in rng.integers(max(len(data), 1), size=int(rng.integers(1, 6))):
        if data:
            data[place] ^= 1 << int(rng.integers(8))
    return bytes(data)


def _truncate(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content) + 1))]


def _remove(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = sorted(int(place) for place in rng.integers(len(content) + 1, size=2))
    end = min(end, start + int(rng.choice([1, 4, 64, 4096])))
    return content[:start] + content[end:]


def _repeat(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = sorted(int(place) for place in rng.integers(len(content) + 1, size=2))
    piece = content[start : min(end, start + 4096)]
    return content[:end] + piece * int(rng.choice([1, 2, 20])) + content[end:]


def _noise(content: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(content) + 1))
    return content[:place] + rng.bytes(int(rng.choice([1, 8, 200]))) + content[place:]


def _extreme_word(content: bytes, rng: np.random.Generator) -> bytes:
    """Four or eight bytes become an extreme integer or float, as sizes and counts of binary files."""
    values = (b"\xff" * 8, b"\x00" * 8, b"\x00\x00\xc0\x7f" * 2, b"\xff\xff\xff\x7f" * 2)
    size, place = int(rng.choice([4, 8])), int(rng.integers(len(content) + 1))
    return content[:place] + values[int(rng.integers(len(values)))][:size] + content[place + size :]


def _other_number(content: bytes, rng: np.random.Generator) -> bytes:
    return _exchanged(content, NUMBER, NUMBERS, rng)


def _other_word(content: bytes, rng: np.random.Generator) -> bytes:
    return _exchanged(content, WORD, WORDS, rng)


def _exchanged(
    content: bytes, pattern: re.Pattern, choices: tuple[bytes, ...], rng: np.random.Generator
) -> bytes:
    found = list(pattern.finditer(content[:200_000]))
    if not found:
        return content
    match = found[int(rng.integers(len(found)))]
    return content[: match.start()] + choices[int(rng.integers(len(choices)))] + content[match.end() :]


def _swap_lines(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    first, second = (int(place) for place in rng.integers(len(lines), size=2))
    lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines)


def _shift_line(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    place = int(rng.integers(len(lines)))
    lines[place] = (b"  ", b"\t", b"- ", b"#", b"? ")[int(rng.integers(5))] + lines[place]
    return b"\n".join(lines)


def _bomb(content: bytes, rng: np.random.Generator) -> bytes:
    if rng.random() < 0.9:  # Few of them are enough: each takes a while to read.
        return _shift_line(content, rng)
    bomb = TEXT_BOMBS[int(rng.integers(len(TEXT_BOMBS)))]
    return (bomb + content, content + b"\n" + bomb, bomb)[int(rng.integers(3))]


Mutation = Callable[[bytes, np.random.Generator], bytes]
_BYTES: tuple[Mutation, ...] = (_flip, _truncate, _remove, _repeat, _noise, _extreme_word)
_TEXT: tuple[Mutation, ...] = (_other_number, _other_number, _other_word, _swap_lines, _shift_line, _bomb)
