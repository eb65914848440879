"""Tables of Markdown for the pages that a program writes."""


def cell(text):
    """Return a text that fits into a cell of a table."""
    return " ".join(str(text).split()).replace("|", "\\|")


def code(text):
    """Return a text as code; an empty text stays empty."""
    return f"`{text}`" if str(text) else ""


def table(head, rows):
    """Return a table without the columns that are empty in all rows."""
    rows = [[cell(entry) for entry in row] for row in rows]
    kept = [column for column in range(len(head)) if any(row[column] for row in rows)]
    lines = [
        [head[column] for column in kept],
        ["---"] * len(kept),
        *([row[column] for column in kept] for row in rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
