#!/usr/bin/env python3
"""Draw the rooms of the package and who imports whom: ``house.py [FILE, default docs/figures/house.svg]``.

The arrows are read from the import statements of the files, late ones included, and those that follow from others are
left out (transitive reduction; Aho, Garey & Ullman 1972, doi:10.1137/0201008). A room stands above all that it imports.
The question of each room is that of the table in docs/contribute/design.md.
"""

import argparse
import re
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, PLAN = ROOT / "voxgran", ROOT / "docs" / "contribute" / "design.md"
#: width and height of a box, and what lies between two, in pixels
WIDE, HIGH, ACROSS, DOWN = 196, 62, 18, 40
#: letters on a line of a question
LETTERS = 34
#: the tip of an arrow
TIP = (
    '<defs><marker id="tip" markerWidth="8" markerHeight="8" refX="7" refY="4" orient="auto">'
    '<path d="M0,0 L8,4 L0,8 z" fill="#555"/></marker></defs>'
)

Graph = dict[str, set[str]]
#: an import of a room, also within a function
IMPORT = re.compile(r"^ *(?:from|import) voxgran\.(\w+)", re.MULTILINE)


def imports() -> Graph:
    """Return the rooms, and which others the files of each import."""
    rooms = {path.parent.name for path in PACKAGE.glob("*/*.py")}
    found: Graph = {room: set() for room in rooms}
    for path in PACKAGE.glob("*/**/*.py"):
        found[path.relative_to(PACKAGE).parts[0]] |= rooms & {*IMPORT.findall(path.read_text(encoding="utf-8"))}
    return {room: others - {room} for room, others in found.items()}


def reduced(graph: Graph) -> Graph:
    """Return the graph without the arrows that follow from others."""
    below = {room: reached(graph, room) for room in graph}
    return {room: {one for one in near if not any(one in below[two] for two in near)} for room, near in graph.items()}


def reached(graph: Graph, room: str) -> set[str]:
    """Return all rooms that one imports, itself or by others."""
    found: set[str] = set()
    ahead = list(graph[room])
    while ahead:
        new = ahead.pop()
        if new not in found:
            found.add(new)
            ahead += graph[new]
    return found


def layers(graph: Graph) -> list[list[str]]:
    """Return the rooms from the ground up; each stands one layer above the highest that it imports."""
    depth: dict[str, int] = {}
    while len(depth) < len(graph):
        free = [room for room in graph if room not in depth and graph[room] <= depth.keys()]
        if not free:
            raise ValueError(f"rooms import each other: {', '.join(sorted(graph.keys() - depth.keys()))}")
        depth |= {room: 1 + max((depth[one] for one in graph[room]), default=-1) for room in free}
    return [sorted(room for room in depth if depth[room] == level) for level in range(max(depth.values()) + 1)]


def questions() -> dict[str, str]:
    """Return the question that each room answers, as the plan has it."""
    rows = re.findall(r"^\| `(\w+)/`[^|]*\| ([^|]*\?) \|", PLAN.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {room: text.replace("`", "") for room, text in rows}


def lines_of(text: str) -> list[str]:
    """Return a text in lines of at most so many letters."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        lines = [*lines[:-1], longer] if len(longer) <= LETTERS else [*lines, word]
    return lines


def drawing(graph: Graph) -> str:
    """Return the figure as SVG."""
    floors, asked = layers(graph), questions()
    width = max(map(len, floors)) * (WIDE + ACROSS) + ACROSS
    height = len(floors) * (HIGH + DOWN) + DOWN // 2
    corner = {}
    for level, rooms in enumerate(floors):
        left = (width - len(rooms) * (WIDE + ACROSS) + ACROSS) / 2
        for k, room in enumerate(rooms):
            corner[room] = (left + k * (WIDE + ACROSS), height - (level + 1) * (HIGH + DOWN))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" role="img">',
        "<title>The rooms of voxgran; each arrow points to a room that is imported</title>",
        TIP,
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for room, others in sorted(reduced(graph).items()):
        for other in sorted(others):
            (x, y), (u, v) = corner[room], corner[other]
            ends = f'x1="{x + WIDE / 2:g}" y1="{y + HIGH:g}" x2="{u + WIDE / 2:g}" y2="{v:g}"'
            parts.append(f'<line data-from="{room}" data-to="{other}" {ends} stroke="#555" marker-end="url(#tip)"/>')
    for room, (x, y) in sorted(corner.items()):
        box = f'x="{x:g}" y="{y:g}" width="{WIDE}" height="{HIGH}" rx="5"'
        parts.append(f'<rect {box} fill="#eaf1f8" stroke="#2c5c8a"/>')
        middle = f'x="{x + WIDE / 2:g}" text-anchor="middle"'
        parts.append(f'<text {middle} y="{y + 18:g}" font-size="14" font-weight="bold">{room}</text>')
        for k, line in enumerate(lines_of(asked.get(room, ""))):
            parts.append(f'<text {middle} y="{y + 34 + 12 * k:g}" font-size="10.5">{escape(line)}</text>')
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=ROOT / "docs" / "figures" / "house.svg")
    parser.parse_args().file.write_text(drawing(imports()), encoding="utf-8")
