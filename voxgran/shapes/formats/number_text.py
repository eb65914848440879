"""Numbers of a text, line by line, each as Python's `float` reads it.

Words of up to 18 digits are rounded from a quotient or product of twice the precision. The few whose rounding is in
doubt, and words that are no plain number, are given to `float`.
"""

import re

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel

#: powers of ten, each as the sum of two numbers, and the factor that splits a number in two halves of its digits
POWERS = np.array([(float(10**k), float(10**k - int(float(10**k)))) for k in range(100)])
SPLIT = 2.0**27 + 1.0
#: most digits of a whole number of 64 bits, and the share of a result that bounds the errors of its second half
DIGITS, DOUBT = 18, 1e-30
#: characters
BLANK, FEED, RETURN, HASH, PLUS, MINUS, POINT, SLASH, ZERO, NINE, E, FACE = (*b" \n\r#+-./09ef",)
_WORD = re.compile(rb"[^\s#]*")


def numbers_of(
    raw: bytes, head: bytes = b"", *, start: int = 0, most: int = 2**62, lines: int = 2**62
) -> tuple[Floats, Integers, Integers]:
    """Return the numbers of all lines that begin with a word, which of them is the first of each, and where it begins.

    Empty lines are left out, and so is what follows a hash and, in lines that begin with f, a slash.

    Parameters
    ----------
    raw : bytes
        The text; lines end with a line feed, a carriage return or both.
    head : bytes
        Word in lower case, which is no number; without it all lines count.
    start : int
        Byte of the text at which reading begins.
    most, lines : int
        Number of words of a line that are read, and of such lines.

    Returns
    -------
    numbers : (n,) ndarray of float64
    first : (m + 1,) ndarray of int64
        Number of each line at which its numbers begin, and n.
    begin : (m,) ndarray of int64
        Byte of the text at which each line begins.

    Raises
    ------
    ValueError
        If a word is no number, or the text has two bytes a character.
    """
    if (byte := raw.find(0, start)) >= 0:
        line = raw[:byte].count(b"\n") + 1
        raise ValueError(f"line {line} has a byte 0, as UTF-16 has, and texts are in UTF-8")
    text = np.frombuffer(raw, np.uint8)[start:]
    # each word ends with a blank, but for the last, and each line has one
    many = int(np.count_nonzero((text[:-1] > BLANK) & (text[1:] <= BLANK))) + 1
    numbers, places, rows = np.empty(many), np.empty(many, np.int64), np.empty((many + 1, 2), np.int64)
    words, found = list_numbers(text, np.frombuffer(head, np.uint8), (most, lines), numbers, places, rows)
    for k in np.flatnonzero(np.isnan(numbers[:words])):
        byte = start + int(places[k])
        word = _WORD.match(raw, byte)
        try:
            numbers[k] = float((word[0].partition(b"/")[0] if head == b"f" else word[0]) if word else b"")
        except ValueError:
            raise ValueError(f"{line_at(raw, byte)} has a word that is no number") from None
    return numbers[:words].copy(), rows[: found + 1, 0].copy(), rows[:found, 1] + start


def line_at(raw: bytes, byte: int) -> str:
    """Return the number and the first characters of the line of a byte, for messages."""
    before = re.split(rb"\r\n|\r|\n", raw[:byte])
    text = before[-1] + re.split(rb"[\r\n]", raw[byte : byte + 200])[0]
    return f"line {len(before)}, {text.decode(errors='replace').strip()[:40]!r},"


@bare_kernel
def list_numbers(
    text: NDArray[np.uint8],
    head: NDArray[np.uint8],
    most: tuple[int, int],
    numbers: Floats,
    places: Integers,
    rows: Integers,
) -> tuple[int, int]:
    """Write the numbers, where each begins, and of each line its first number and its byte; return how many there are.

    A word that has to be looked at again is NaN. most: words of a line, and lines.
    """
    n, at, words, lines = len(text), 0, 0, 0
    faces = len(head) == 1 and head[0] == FACE
    while at < n and lines < most[1]:
        if text[at] <= BLANK:
            at += 1
            continue
        begin, same, left = at, 0, 0
        while same < len(head) and at < n and text[at] | 32 == head[same]:
            at, same = at + 1, same + 1
        if same == len(head) and (same == 0 or at == n or text[at] <= BLANK) and (at == n or text[at] != HASH):
            rows[lines, 0], rows[lines, 1] = words, begin
            lines, left = lines + 1, most[0]
        while at < n and text[at] != FEED and text[at] != RETURN:
            if text[at] == HASH:
                left = 0
            if text[at] <= BLANK or left == 0:
                at += 1
                continue
            places[words] = at
            numbers[words], at = _number(text, at)
            if at < n and text[at] == SLASH and not faces:
                numbers[words] = np.nan
            words, left = words + 1, left - 1
            while at < n and text[at] > BLANK:
                at += 1
    rows[lines, 0] = words
    return words, lines


@inlined_kernel
def _number(text, at):  # type: ignore[no-untyped-def]
    """Return the number of a word, NaN where it has to be looked at again, and where reading ended."""
    n, negative = len(text), text[at] == MINUS
    at += 1 if negative or text[at] == PLUS else 0
    whole, power, digits, read, fraction = np.int64(0), np.int64(0), 0, 0, 0
    while at < n and (ZERO <= text[at] <= NINE or (text[at] == POINT and fraction == 0)):
        if text[at] == POINT:
            fraction = 1
        else:
            whole = 10 * whole + np.int64(text[at]) - ZERO
            read += 1
            digits += 1 if whole != 0 else 0
            power -= fraction
        at += 1
    if at + 1 < n and text[at] | 32 == E and read > 0:
        below = text[at + 1] == MINUS
        at += 2 if below or text[at + 1] == PLUS else 1
        read, tens = 0, np.int64(0)
        while at < n and ZERO <= text[at] <= NINE and read < 4:
            tens, read, at = 10 * tens + np.int64(text[at]) - ZERO, read + 1, at + 1
        power += -tens if below else tens
    whole_word = at == n or text[at] <= BLANK or text[at] == SLASH or text[at] == HASH
    if not whole_word or read == 0 or digits > DIGITS or abs(power) >= len(POWERS):
        return np.nan, at
    high = float(whole)
    low, ten, more = float(whole - np.int64(high)), POWERS[abs(power), 0], POWERS[abs(power), 1]
    # the value is first + second, the error of which is far below the last digit of the first
    if power < 0:
        first = high / ten
        product, rest = _product(first, ten)
        second = (high - product - rest - first * more + low) / ten
    else:
        first, rest = _product(high, ten)
        second = rest + high * more + low * ten
    near = first * DOUBT
    value = first + (second + near)
    if value != first + (second - near):
        return np.nan, at
    return -value if negative else value, at


@inlined_kernel
def _product(a, b):  # type: ignore[no-untyped-def]
    """Return the product of two numbers as the sum of two (Dekker 1971, doi:10.1007/BF01397083)."""
    product, c, d = a * b, SPLIT * a, SPLIT * b
    a_high, b_high = c - (c - a), d - (d - b)
    a_low, b_low = a - a_high, b - b_high
    return product, a_high * b_high - product + a_high * b_low + a_low * b_high + a_low * b_low
