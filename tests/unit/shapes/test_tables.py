"""Tables of laboratories: what is read whatever has written it, and what is refused in one sentence."""

import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError
from voxgran.shapes import sizes


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"", "is empty: a table has the names of its columns in the first row"),
        (b"\xef\xbb\xbf# nothing\n\n", "is empty"),
        (b"opening;passing\n", "has only the row 'opening;passing'"),
        (b"1;0\n2;100\n", "begins with the row '1;0'"),
        (b"opening\n1,0\n2,5\n", "it must have 'opening', and 'passing' or 'retained'"),
        (b"PK\x03\x04\x14\x00\x06", "is a workbook: a table is text; save the sheet as CSV"),
        (b"\x89PNG\r\n\x1a\n\x00\x01", "is no text"),
    ],
)
def test_a_file_that_is_no_table_is_one_sentence(tmp_path, raw, words):
    (tmp_path / "a.csv").write_bytes(raw)
    for read in (sizes.sieve, lambda path: vg.pack(grains=path, container=vg.Box((9, 9, 9)), method="rsa")):
        with pytest.raises(FileFormatError, match=words if read is sizes.sieve else "a.csv") as found:
            read(tmp_path / "a.csv")
        assert "delimiter" not in str(found.value)


@pytest.mark.parametrize(
    "raw",
    [
        b"\xef\xbb\xbfopening,passing\r\n1,0\r\n2.5,50\r\n4,100\r\n",
        b"opening\tpassing\n1\t0\n2,5\t50\n4\t100\n",
        "opening;passing;Bemerkung\n1;0;groß\n2,5;50,0;\n4;100;\n".encode("cp1252"),
        "opening;passing\n1;0\n2,5;50\n4;100\n".encode("utf-16"),
        b"opening passing\n1 0\n2,5 50\n4 100\n",
    ],
)
def test_a_table_may_be_written_as_spreadsheets_do(tmp_path, raw):
    (tmp_path / "a.csv").write_bytes(raw)
    assert sizes.sieve(tmp_path / "a.csv").openings == (1.0, 2.5, 4.0)


def test_a_table_of_very_many_columns_is_refused_soon(tmp_path):
    (tmp_path / "a.csv").write_text("opening;passing" + ";x" * 50_000 + "\n1;2\n")
    (tmp_path / "b.csv").write_text("opening;passing\n" + "1;2" * 50_000 + "\n")
    for name in ("a.csv", "b.csv"):
        with pytest.raises(FileFormatError, match=r"has a row of 1\d{5} characters"):
            sizes.sieve(tmp_path / name, unit="mm")
    some = {f"column {k}": [1.0] for k in range(100)}
    with pytest.raises(FileFormatError, match=r"'column 7', \.\.\.: it must have 'opening'"):
        sizes.sieve(some)


def test_a_table_whose_rows_have_more_entries_than_names_is_refused(tmp_path):
    """Its first entries would be no column, and the others one column too far to the left."""
    (tmp_path / "a.csv").write_text("opening;passing\n1;2;3\n4;5;6\n")
    with pytest.raises(FileFormatError, match="rows of more entries than its first row has names"):
        sizes.sieve(tmp_path / "a.csv", unit="mm")
