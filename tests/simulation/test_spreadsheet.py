"""Tables as spreadsheets write them: read where there is no doubt, else refused with the cause."""

import numpy as np
import pandas as pd
import pytest

from labctl.errors import BadInput
from labctl.simulation.measured_heights import read_measured
from labctl.simulation.spreadsheet import read_spreadsheet

PLAIN = """\
point,x_mm,y_mm,z_mm_at_0_psi,z_mm_at_3.9_psi
1,35,70,0.5,1.75
2,70,70,0.5,
3,105.5,70,0.5,-4.25
"""
HEIGHTS_MM = [[1.25, np.nan, -4.75]]


def semicolons(text):
    """As a spreadsheet of a country of decimal commas saves it; the pressure is in a heading and keeps its point."""
    head, *rows = text.splitlines()
    return "\n".join([head.replace(",", ";"), *(row.replace(",", ";").replace(".", ",") for row in rows), ""])


WRITTEN = {
    "plain": PLAIN.encode(),
    "with a mark": PLAIN.encode("utf-8-sig"),
    "windows line ends": PLAIN.replace("\n", "\r\n").encode(),
    "old macintosh line ends": PLAIN.replace("\n", "\r").encode(),
    "semicolons and commas": semicolons(PLAIN).encode("utf-8-sig"),
    "semicolons and points": PLAIN.replace(",", ";").encode(),
    "tabs": PLAIN.replace(",", "\t").encode(),
    "tabs and commas": semicolons(PLAIN).replace(";", "\t").encode(),
    "sep=": b"sep=;\r\n" + PLAIN.replace(",", ";").encode(),
    "UTF-16": PLAIN.encode("utf-16"),
    "UTF-16, big end first, with tabs": b"\xfe\xff" + PLAIN.replace(",", "\t").encode("utf-16-be"),
    "UTF-16 without a mark": PLAIN.encode("utf-16-le"),
    "padded": PLAIN.replace(",", " , ").replace("z_mm", "\u00a0z_mm").encode(),
    "quoted": b'"point","x_mm","y_mm","z_mm_at_0_psi","z_mm_at_3.9_psi"\n'
    + PLAIN.partition("\n")[2].encode(),
    "empty rows": ("\n,,,,\n" + PLAIN.replace("\n2,", "\n,,,,\n\n2,") + "\n\n,,,,\n").encode(),
    "an empty column": "\n".join(row.replace(",", ",,", 1) for row in PLAIN.splitlines()).encode(),
    "empty columns at the end": "\n".join(row + ",,," for row in PLAIN.splitlines()).encode(),
    "the empty cell as NaN": PLAIN.replace("0.5,\n", "0.5,NaN\n").encode(),
    "points as pandas makes them beside a gap": PLAIN.replace("\n1,", "\n1.0,").encode(),
    "without the row": PLAIN.replace("2,70,70,0.5,\n", "").encode(),
}


@pytest.mark.parametrize("data", WRITTEN.values(), ids=WRITTEN.keys())
def test_whatever_a_spreadsheet_makes_of_a_table_is_the_same_table(tmp_path, data):
    path = tmp_path / "measured.csv"
    path.write_bytes(data)

    measured = read_measured(path)

    seen = np.isfinite(measured.heights_mm[0])
    assert measured.pressures_psi == (3.9,)
    assert measured.points_mm[seen].tolist() == [[35, 70], [105.5, 70]]
    assert measured.heights_mm[0][seen].tolist() == [1.25, -4.75]
    assert measured.unmeasured(0) == (2,)
    assert measured.points == 3


def test_parquet_is_a_table_too(tmp_path):
    path = tmp_path / "measured.parquet"
    (tmp_path / "measured.csv").write_text(PLAIN)
    pd.read_csv(tmp_path / "measured.csv").to_parquet(path, index=False)

    np.testing.assert_array_equal(read_measured(path).heights_mm, HEIGHTS_MM)


DOUBTFUL = {
    "two marks": (
        semicolons(PLAIN).replace("1,75", "1.75"),
        "decimal comma and line 2, z_mm_at_3.9_psi: '1.75'",
    ),
    "thousands": (semicolons(PLAIN).replace("1,75", "1.750,5"), "line 2, z_mm_at_3.9_psi: '1.750,5'"),
    "commas for both": (PLAIN.replace("105.5", "105,5"), "line 4: not as many cells as the head"),
    "a column without heading": (
        PLAIN.replace("70,0.5,1.75", "70,0.5,1.75,wet"),
        "line 2: not as many cells",
    ),
    "two separators": (
        "point,x_mm,y;x_cm;y_cm\n1,2,3;4;5\n",
        "could be separated by commas or by semicolons",
    ),
    "words": (PLAIN.replace("1.75", "about 2"), "line 2, z_mm_at_3.9_psi: 'about 2'"),
    "half a row": (PLAIN[:-12], "line 4: not as many cells"),
    "a point that has no number": (PLAIN.replace("\n2,", "\nP2,"), "point: line 3: 'P2': number the points"),
    "a point's number of 400 digits": (PLAIN.replace("\n2,", f"\n{'9' * 400},"), "point: line 3: '99999"),
    "another column's number": (PLAIN.replace("\n2,", "\n100000000000,"), "up to 10000 at most"),
    "a point twice": (PLAIN.replace("\n2,", "\n1,"), "point 1 is there more than once"),
    "nothing": ("", "the head is empty"),
    "an infinite height": (PLAIN.replace("1.75", "inf"), "line 2, z_mm_at_3.9_psi: 'inf'"),
    "a place that is not there": (PLAIN.replace("105.5", ""), "line 4, x_mm: ''"),
}


@pytest.mark.parametrize(("text", "words"), DOUBTFUL.values(), ids=DOUBTFUL.keys())
def test_what_could_be_meant_in_two_ways_is_refused_and_named(tmp_path, text, words):
    path = tmp_path / "measured.csv"
    path.write_text(text)
    with pytest.raises(BadInput) as error:
        read_measured(path)
    assert words in str(error.value)
    assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"PK\x03\x04 a workbook", "save the sheet as CSV (UTF-8)"),
        (PLAIN.encode().replace(b"point", b"p\xf6int"), "it is not UTF-8 (invalid start byte at byte 1)"),
        (b"PAR1 and no more", "cannot be read as Parquet"),
        (b"\0\1\0\0\0", "cannot be read as CSV"),
    ],
)
def test_what_is_no_text_is_refused_with_what_to_do(tmp_path, data, words):
    path = tmp_path / "measured.csv"
    path.write_bytes(data)
    with pytest.raises(BadInput) as error:
        read_measured(path)
    assert words in str(error.value)


def test_lines_count_from_the_top_of_the_file_whatever_stands_there(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text("sep=;\n\n" + PLAIN.replace(",", ";").replace("1.75", "x"))
    with pytest.raises(BadInput, match=r"line 4, z_mm_at_3\.9_psi: 'x'"):
        read_measured(path)


def test_the_points_of_the_rig_are_held_against_the_table(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text(PLAIN)
    assert read_measured(path, 5).unmeasured(0) == (2, 4, 5)
    with pytest.raises(BadInput, match=r"point 3: the rig has 2 points \(--points\)"):
        read_measured(path, 2)


def test_a_file_that_is_too_large_for_a_table_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_bytes(PLAIN.encode() + b"\n" * 17_000_000)
    with pytest.raises(BadInput, match="larger than 16 MB"):
        read_spreadsheet(path, ("point", "x_mm"))
