"""What the colours of a picture mean: entries of a legend, or a colour bar, in a strip at the lower edge."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.report.colors import COLORS, Coloring
from voxgran.report.stage import LETTERS, add_label, add_tiles, text_size, text_width

#: where the strip begins and ends, in widths of the picture; a scale bar is to the left of it
LEFT, RIGHT = 0.34, 0.97
#: largest share of the height of the picture that a legend takes; one that needs more is left out
TALLEST = 0.35
#: lowest point of a legend, in heights of the picture
LOWEST = 0.02
#: largest number of values at a colour bar, and steps of its colours
TICKS, STEPS = 5, 128
#: in sizes of the text: height of a line, of a colour bar and of a mark at it, distance of entries, and of words
LINE, BAR, MARK, APART, SPACE = 1.35, 0.7, 0.25, 1.2, 0.28


@dataclass(frozen=True, slots=True)
class Legend:
    """Texts and coloured tiles, placed in pixels from the lower left corner of a picture."""

    height: float  # of the strip that they take, in heights of the picture
    size: int  # of the texts
    labels: tuple[tuple[str, float, float, str], ...]  # text, x and y of its base line, and which part of it is at x
    tiles: Floats  # (n, 4) left, low, right and high
    colors: Floats  # (n, 3) in [0, 1]

    def add_to(self, stage: Any, *, color: Any = LETTERS) -> None:
        """Draw the legend, with texts of this colour."""
        add_tiles(stage, self.tiles, self.colors)
        for text, x, y, side in self.labels:
            add_label(stage, text, (x, y), side=side, color=color, size=self.size)


def legend_of(colors: Coloring, window: tuple[int, int], *, shades: str = COLORS) -> Legend | None:
    """Return the legend of a colouring for a picture of this size in pixels: an entry for each of a few values that
    have names, or for a single value; else a colour bar.

    `shades` is the map of the colours. None without values, and for a picture in which it would take too much room.
    """
    if not len(colors.values):
        return None
    size, begin, end = text_size(window), LEFT * window[0], RIGHT * window[0]
    low = LOWEST * window[1] + MARK * size
    made = _entries if colors.entries else _bar
    labels, tiles, values, top = made(colors, size, (begin, end, low))
    words = colors.title.split()
    lines = _rows([text_width(word, size) + SPACE * size for word in words], end - begin)
    for k, line in enumerate(reversed(lines)):
        text = " ".join(words[index] for index, _ in line)
        labels.append((text, begin, top + (MARK + LINE * k) * size, "left"))
    highest = top + (MARK + LINE * len(lines)) * size
    if highest > TALLEST * window[1]:
        return None
    bottom, brightest = colors.limits
    shown = load("matplotlib").colormaps[shades]((values - bottom) / (brightest - bottom))[:, :3]
    return Legend(highest / window[1], size, tuple(labels), np.array(tiles), np.asarray(shown, dtype=np.float64))


def _entries(colors: Coloring, size: int, place: tuple[float, float, float]) -> tuple[list[Any], Any, Floats, float]:
    """Return labels, tiles, values and upper end of the entries in rows, from the left end, right end and low end."""
    begin, end, low = place
    names = [_shortened(name, size, end - begin - LINE * size) for name in colors.entries.values()]
    step = (LINE + APART) * size
    # the last of a row needs no distance from a next one
    rows = _rows([text_width(name, size) + step for name in names], end - begin + APART * size)
    labels, tiles = [], []
    top = low + LINE * size * len(rows)
    for k, row in enumerate(rows):
        y = top - LINE * size * (k + 1)
        for index, x in row:
            tiles.append((begin + x, y, begin + x + size, y + 0.8 * size))
            labels.append((names[index], begin + x + LINE * size, y, "left"))
    return labels, tiles, np.array(list(colors.entries)), top


def _bar(colors: Coloring, size: int, place: tuple[float, float, float]) -> tuple[list[Any], Any, Floats, float]:
    """Return labels, tiles, values and upper end of a colour bar, from the left end, right end and low end."""
    begin, end, low = place
    least, most = colors.limits
    foot, end = low + LINE * size, end - APART * size
    edges = np.linspace(begin, end, STEPS + 1)
    tiles = np.column_stack([edges[:-1], np.full(STEPS, foot), edges[1:], np.full(STEPS, foot + BAR * size)])
    whole = bool((colors.values == np.round(colors.values)).all())
    for ticks in range(TICKS, 0, -1):
        locator = load("matplotlib.ticker").MaxNLocator(ticks, steps=[1, 2, 5, 10], integer=whole)
        marks = locator.tick_values(least, most)
        marks = marks[(marks >= least) & (marks <= most)]
        texts = [f"{mark:.10g}" for mark in marks]
        if sum(text_width(text, size) + APART * size for text in texts) <= end - begin:
            break
    places = begin + (marks - least) / (most - least) * (end - begin)
    labels = [(text, x, low, "middle") for text, x in zip(texts, places, strict=True)]
    return labels, tiles, np.linspace(least, most, STEPS), foot + BAR * size


def _rows(widths: Sequence[float], most: float) -> list[list[tuple[int, float]]]:
    """Return items of these widths in rows of at most that width, as the index and the place of each."""
    rows: list[list[tuple[int, float]]] = [[]]
    x = 0.0
    for index, width in enumerate(widths):
        if rows[-1] and x + width > most:
            rows.append([])
            x = 0.0
        rows[-1].append((index, x))
        x += width
    return rows


def _shortened(text: str, size: int, most: float) -> str:
    """Return a text, without its last letters where it is wider."""
    short = text
    while len(short) > 4 and text_width(short, size) > most:
        short = f"{short.removesuffix('...')[:-1]}..."
    return short
