"""What a file looks like that holds nothing to record, for the error that says so."""

from __future__ import annotations

SQLITE = b"SQLite format 3\0"
_MAGIC = {
    b"\x89MCAP": "a recording (`seatrial redecode` decodes one anew)",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"PK\x03\x04": "a ZIP archive: unpack it",
    b"%PDF": "a PDF document",
    b"PAR1": "a Parquet table: `seatrial import` reads it",
    b"MATLAB": "a .mat table: `seatrial import` reads it",
    SQLITE: 'an SQLite database: `type = "mqtt_file"` reads a log of MQTT messages',
    b"\xff\xfe": "text in UTF-16: save it as UTF-8",
    b"\xfe\xff": "text in UTF-16: save it as UTF-8",
    b"BZh": "packed by bzip2: unpack it",
    b"\xfd7zXZ": "packed by xz: unpack it",
    b"\x28\xb5\x2f\xfd": "packed by zstd: unpack it",
    b"MDF ": "an MDF measurement",
}
_MOST_LETTERS = 60


def looks_like(head: bytes) -> str:
    """A few words on a file by its first bytes.

    >>> looks_like(b"time,heading_deg\\n0.0,12.3\\n")
    'a table with the columns time, heading_deg: `seatrial import` reads tables'
    """
    for magic, name in _MAGIC.items():
        if head.startswith(magic):
            return name
    if head[:1] == b"\0" and head[8:9] in (b"\xfd", b"\xfe"):
        return 'a telemetry log of MAVLink: `type = "mavlink_file"` reads it'
    printable = sum(32 <= each < 127 or each in b"\t\r\n" or each > 127 for each in head)
    if printable < 0.9 * len(head):
        return f"binary, and begins with {head[:8].hex(' ')}"
    lines = [line.strip() for line in head.decode("utf-8", "replace").splitlines() if line.strip()]
    first = next((line for line in lines if not line.startswith("#")), "")
    if first.startswith(("{", "[")):
        return "JSON, already decoded by another program: what came off the bus is needed"
    if "$" in first or "!" in first:
        return f"sentences without a sound checksum ({_short(first)})"
    names = [name.strip(' "') for name in first.replace(";", ",").replace("\t", ",").split(",")]
    if len(names) > 1 and all(name and not name[0].isdigit() for name in names):
        return f"a table with the columns {_short(', '.join(names))}: `seatrial import` reads tables"
    return f"text ({_short(first)})" if first else "text without a word in it"


def _short(text: str) -> str:
    shown = "".join(each if each.isprintable() else "?" for each in text)
    return shown if len(shown) <= _MOST_LETTERS else f"{shown[:_MOST_LETTERS]}..."
