"""Numbers of texts: to the last bit those of Python's `float`, whatever the line looks like."""

import numpy as np
import pytest

from voxgran.shapes.formats.number_text import POWERS, line_at, numbers_of

#: halves between two numbers, longest words, powers at the ends of the table, and what only `float` reads
HARD = """
    9007199254740993 9007199254740992.5 9007199254740991.5 0.1 -0 -.5 5. +3e5 1E-5 1e22 1e23 9e-99 1e99 1e100 1e-100
    1e+5 123456789012345678e4 1234567890123456789 999999999999999999e-99 nan inf -Infinity 1_000 0.30000000000000004
    179769313486231570000e2 2.2250738585072011e-308 8.5e-1 00000000000000000000012 6.123233995736766e-17 1e-00005 4.35
    9223372036854775807 18446744073709551616 0.000000000000000000000000000001 5e-324 17976931348623157e292 1e99999
"""


def test_numbers_are_those_of_float():
    random = np.random.default_rng(1)
    values = random.normal(size=4000) * 10.0 ** random.integers(-40, 40, 4000)
    forms = ["{!r}", "{:.6f}", "{:.17g}", "{:.15e}", "{:.3g}", "{:.30f}"]
    words = [forms[k % 6].format(float(value)) for k, value in enumerate(values)] + HARD.split()
    words += [str(k) for k in random.integers(-(2**62), 2**62, 400) >> random.integers(0, 62, 400)]
    # halves of the last digit: whole numbers above 2^53, and their tenths
    words += [f"{2**53 + int(k)}{tail}" for k in random.integers(0, 2**20, 400) for tail in ("", ".5", "e-3", "e40")]
    found, first, begin = numbers_of(" ".join(words).encode())
    asked = np.array(list(map(float, words)))
    assert (found.view(np.int64) == asked.view(np.int64))[~np.isnan(asked)].all()
    assert np.isnan(found[np.isnan(asked)]).all()
    assert (first.tolist(), begin.tolist()) == ([0, len(words)], [0])
    assert [int(ten) + int(rest) for ten, rest in POWERS[:33]] == [10**k for k in range(33)]


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n", "\n\n", " # why\n", "\t\n"])
def test_lines_and_words(end):
    lines = [
        "v 1 2 3",
        "  v\t4 5 6 red",
        "vn 7 8 9",
        "# v 1 2 3",
        "V 1e0 2 3 0.5",
        "v",
        "f 1/2/3 2//3 3",
        "vertex 1 2 3",
    ]
    text = end.join([*lines, ""]).encode()
    found, first, begin = numbers_of(text, b"v", most=3)
    assert found.tolist() == [1, 2, 3, 4, 5, 6, 1, 2, 3]
    assert first.tolist() == [0, 3, 6, 9, 9]
    assert [text[k : k + 1] for k in begin] == [b"v", b"v", b"V", b"v"]
    assert numbers_of(text, b"f")[0].tolist() == [1, 2, 3]
    assert numbers_of(text, b"v", most=2, lines=2)[0].tolist() == [1, 2, 4, 5]
    with pytest.raises(ValueError, match=r"line \d, 'v.*4 5 6 red.*', has a word that is no number"):
        numbers_of(text, b"v")


@pytest.mark.parametrize("text", [b"", b" ", b"\n# 1 2\n", b"v", b"#"])
def test_texts_without_numbers(text):
    found, first, begin = numbers_of(text, b"v" if text == b"v" else b"")
    assert len(found) == 0
    assert len(first) == len(begin) + 1 == (2 if text == b"v" else 1)


def test_lines_are_counted_as_an_editor_counts_them():
    text = b"a\r\nb\rc\n\nlast one \r\nnext"
    assert line_at(text, text.index(b"one")) == "line 5, 'last one',"
    assert line_at(text, 0) == "line 1, 'a',"
