"""Files that are small and expand, or say what is not so: built one by one, each in a process of its own.

``python -m tests.attacks.bombs NAME PATH`` writes one: what it takes to build it is no part of what is measured.
"""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import sqlite3
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import zstandard
from mcap import records as mcap

from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Sample
from seatrial.acquisition.recording.messages import encode, encode_sample, message_kind_of_topic
from seatrial.acquisition.recording.scan import MCAP_MAGIC, MESSAGE
from seatrial.acquisition.recording.writer import file_end_without_index, serialise_record

START_NS = 1_780_000_000_000_000_000
CHUNK_BYTES = 64 * 1024 * 1024  # the largest that is read


def record_of(opcode: int, body: bytes) -> bytes:
    """A record of any kind, of whatever content."""
    return bytes([opcode]) + len(body).to_bytes(8, "little") + body


def message(channel: int, data: bytes, log_ns: int = START_NS) -> bytes:
    """A message as it stands in a chunk."""
    return record_of(5, MESSAGE.pack(channel, 0, log_ns, log_ns) + data)


def chunk(plain: bytes, size_bytes: int | None = None, compression: str = "zstd", level: int = 19) -> bytes:
    """A compressed chunk that says that it unpacks to ``size_bytes``: the truth, unless told otherwise."""
    data = zstandard.compress(plain, level) if compression == "zstd" else lz4.frame.compress(plain)
    return chunk_of(data, len(plain) if size_bytes is None else size_bytes, compression, zlib.crc32(plain))


def chunk_of(data: bytes, size_bytes: int, compression: str, checksum: int = 0) -> bytes:
    """A chunk of these compressed bytes."""
    return serialise_record(
        mcap.Chunk(
            compression=compression, data=data, message_start_time=0, message_end_time=2**63,
            uncompressed_crc=checksum, uncompressed_size=size_bytes,
        )
    )  # fmt: skip


def defined(*topics: str) -> bytes:
    """Definitions of our topics, by their own schemas."""
    records = b""
    for number, topic in enumerate(topics, start=1):
        kind = message_kind_of_topic(topic)
        records += serialise_record(mcap.Schema(number, kind.descriptors, "protobuf", kind.title))
        records += serialise_record(mcap.Channel(number, topic, "protobuf", {}, number))
    return records


def write_mcap(path: Path, *records: bytes, end: bytes = b"") -> Path:
    """A recording of a stranger with these records."""
    header = serialise_record(mcap.Header("", "stranger"))
    path.write_bytes(MCAP_MAGIC + header + b"".join(records) + (end or file_end_without_index()))
    return path


def full_of(record: bytes) -> bytes:
    """A chunk as large as is read, full of one record."""
    return chunk(record * (CHUNK_BYTES // len(record)))


SAMPLE_DATA = encode_sample(Sample("surge_mps", 1.0, "line", START_NS, 1, START_NS, START_NS))
EVENT_DATA = encode("/event", {"timestamp": {"seconds": 1, "nanos": 0}, "level": 1, "message": "m", "name": "n"})


def text_field(number: int, text: bytes) -> bytes:
    """A field of a protobuf message that holds a text."""
    length, size = b"", len(text)
    while size:
        length, size = length + bytes([size & 0x7F | (0x80 if size > 0x7F else 0)]), size >> 7
    return bytes([number << 3 | 2]) + length + text


def write_declared(path: Path, channels: int) -> Path:
    """A recording whose run sheet declares many channels, with a sample of each at a time of its own."""
    names = [f"extra_{number}_m" for number in range(channels)]
    declared = json.dumps(
        [{"name": name, "unit": "m", "meaning": "x", "low": 0, "high": 1} for name in names], separators=(",", ":")
    )
    kind = message_kind_of_topic("/channel/x")
    records = serialise_record(mcap.Schema(1, kind.descriptors, "protobuf", kind.title))
    records += b"".join(
        serialise_record(mcap.Channel(number, f"/channel/{name}", "protobuf", {}, 1))
        + message(number, SAMPLE_DATA, START_NS + number)
        for number, name in enumerate(names, start=1)
    )
    return write_mcap(
        path, serialise_record(mcap.Metadata("trial", {"trial": "x", "channels": declared})), chunk(records)
    )


def write_apart(path: Path, time_ns: int) -> Path:
    """A recording with samples of all channels today and at another time, and raw input beyond all time."""
    topics = [f"/channel/{name}" for name in NAMES]
    times = [
        message(number, SAMPLE_DATA, each) for number in range(1, len(topics) + 1) for each in (START_NS, time_ns)
    ]
    raw = message(len(topics) + 1, b"", 2**64 - 1)
    return write_mcap(path, defined(*topics, "/raw/can/bus"), chunk(b"".join(times) + raw))


MCAP_BOMBS: dict[str, Callable[[Path], Path]] = {
    "samples": lambda path: write_mcap(
        path, defined("/channel/surge_mps"), *[full_of(message(1, SAMPLE_DATA))] * 20
    ),
    "samples of one time": lambda path: write_mcap(
        path, defined("/channel/surge_mps"), chunk(message(1, SAMPLE_DATA, 0) * 300_000)
    ),
    "events": lambda path: write_mcap(path, defined("/event"), *[full_of(message(1, EVENT_DATA))] * 18),
    "raw messages without data": lambda path: write_mcap(
        path, defined("/raw/can/bus"), *[full_of(message(1, b""))] * 10
    ),
    "a chunk of zeros, often": lambda path: write_mcap(path, *[full_of(record_of(8, bytes(1_000_000)))] * 100),
    "records without content": lambda path: write_mcap(path, *[full_of(record_of(0x90, b""))] * 4),
    "definitions, often": lambda path: write_mcap(path, *[full_of(defined("/event"))] * 4),
    "a million topics": lambda path: write_mcap(
        path,
        *(
            chunk(
                b"".join(
                    serialise_record(mcap.Channel(number % 65_536, f"/t{number}", "json", {}, 0))
                    for number in range(start, start + 250_000)
                )
            )
            for start in range(0, 1_000_000, 250_000)
        ),
    ),
    "schemas of 60 MB": lambda path: write_mcap(
        path,
        *(chunk(serialise_record(mcap.Schema(number, bytes(60_000_000), "x", "x"))) for number in range(1, 30)),
    ),
    "a topic of 60 MB": lambda path: write_mcap(
        path,
        chunk(serialise_record(mcap.Channel(1, "/raw/can/" + "n" * 60_000_000, "json", {}, 0)) + message(1, b"")),
    ),
    "events of 60 MB": lambda path: write_mcap(
        path, defined("/event"), *[chunk(message(1, text_field(3, bytes(60_000_000))))] * 10
    ),
    "sources of 60 MB": lambda path: write_mcap(
        path, defined("/channel/surge_mps"),
        *(chunk(message(1, SAMPLE_DATA + text_field(5, bytes([number]) * 60_000_000))) for number in range(65, 80)),
    ),
    "14,000 channels declared": lambda path: write_declared(path, 14_000),
    "65,000 channels declared": lambda path: write_declared(path, 65_000),
    "two samples a month apart": lambda path: write_apart(path, START_NS + 30 * 86_400 * 10**9),
    "a sample at the end of time": lambda path: write_apart(path, 2**63 - 1),
    "a sample beyond the end of time": lambda path: write_apart(path, 2**64 - 1),
    "a sample in 1970": lambda path: write_apart(path, 0),
}  # fmt: skip


def write_xlsx(path: Path, sheet: bytes, shared: bytes = b"") -> Path:
    """A workbook of one sheet with these rows, and shared texts."""
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{package}/content-types"><Default Extension="xml" ContentType="application/xml"/>'
            '<Default Extension="rels" '
            'ContentType="application/vnd.openxmlformats-package.relationships+xml"/></Types>',
        )
        book.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{package}/relationships">'
            f'<Relationship Id="r" Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        )
        book.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets><sheet name="a" sheetId="1" r:id="s"/>'
            "</sheets></workbook>",
        )
        book.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{package}/relationships">'
            f'<Relationship Id="s" Type="{office}/worksheet" Target="worksheets/a.xml"/>'
            f'<Relationship Id="t" Type="{office}/sharedStrings" Target="sharedStrings.xml"/></Relationships>',
        )
        sheet_head = f'<worksheet xmlns="{main}"><sheetData>'.encode()
        book.writestr("xl/worksheets/a.xml", sheet_head + sheet + b"</sheetData></worksheet>")
        book.writestr("xl/sharedStrings.xml", f'<sst xmlns="{main}">'.encode() + shared + b"</sst>")
    return path


def write_ods(path: Path, cells: str) -> Path:
    """An OpenDocument sheet with these rows."""
    names = "urn:oasis:names:tc:opendocument:xmlns"
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("mimetype", kind)
        book.writestr(
            "content.xml",
            f'<office:document-content xmlns:office="{names}:office:1.0" xmlns:table="{names}:table:1.0" '
            f'xmlns:text="{names}:text:1.0"><office:body><office:spreadsheet><table:table table:name="a">{cells}'
            "</table:table></office:spreadsheet></office:body></office:document-content>",
        )
        book.writestr(
            "META-INF/manifest.xml",
            f'<manifest:manifest xmlns:manifest="{names}:manifest:1.0"><manifest:file-entry manifest:full-path="/" '
            f'manifest:media-type="{kind}"/></manifest:manifest>',
        )
    return path


def write_mat(path: Path, *elements: tuple[int, tuple[int, ...], bytes]) -> Path:
    """A MATLAB file of compressed variables: class, dimensions that they claim, and their content."""
    content = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    for number, (kind, shape, body) in enumerate(elements):
        dimensions = b"".join(size.to_bytes(4, "little") for size in shape)
        head = element(6, bytes([kind, 0, 0, 0]) + bytes(4)) + element(5, dimensions) + element(1, b"v%d" % number)
        packed = zlib.compress(element(14, head + body), 9)
        content += (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed
    path.write_bytes(content)
    return path


def element(kind: int, body: bytes) -> bytes:
    """An element of a MATLAB file."""
    return kind.to_bytes(4, "little") + len(body).to_bytes(4, "little") + body + bytes(-len(body) % 8)


def write_hdf5(path: Path, fill: Callable[[Any], object]) -> Path:
    """A file of HDF5 that a function fills; one of MATLAB begins with a header of its own."""
    is_matlab = path.suffix == ".mat"
    with h5py.File(path, "w", userblock_size=512 if is_matlab else 0) as file:
        fill(file)
    if is_matlab:
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def link_to_another(file: Any, kind: str) -> None:
    """Refer to a file beside this one."""
    with h5py.File(Path(file.filename).with_name("secret.h5"), "w") as other:
        other["time"] = np.arange(10.0)
    if kind == "link":
        file["time"] = h5py.ExternalLink("secret.h5", "/time")
    elif kind == "storage":
        file.create_dataset("time", (10,), "f8", external=[("secret.h5", 0, 80)])
    else:
        layout = h5py.VirtualLayout((10,), "f8")
        layout[:] = h5py.VirtualSource("secret.h5", "time", (10,))
        file.create_virtual_dataset("time", layout)


def nest(file: Any, depth: int) -> None:
    """Groups in groups, the innermost of which is the outermost."""
    group = file
    for _ in range(depth):
        group = group.create_group("g")
    group["again"] = file["/"]


def huge(file: Any) -> None:
    """A data set of a terabyte that takes no room, as nothing was written to it."""
    file.create_dataset("time", (2**37,), "f8", chunks=(2**16,), fillvalue=1.0)


def write_parquet(path: Path, columns: dict[str, Any]) -> Path:
    """A Parquet file of these columns."""
    pq.write_table(pa.table(columns), path, compression="zstd")
    return path


def write_packed(path: Path, text: bytes) -> Path:
    """A text, packed as its name says."""
    pack = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}.get(path.suffix, bytes)
    path.write_bytes(pack(text))
    return path


def numbers(rows: int, columns: int = 14) -> bytes:
    """A table of zeros."""
    names = ",".join(["time", *(f"c{number}" for number in range(1, columns))])
    return (names + "\n").encode() + (",".join(["0"] * columns) + "\n").encode() * rows


def gpx(content: bytes, before: bytes = b"") -> bytes:
    """A GPX file of this content."""
    return b'<?xml version="1.0"?>' + before + b"<gpx>" + content + b"</gpx>"


ENTITIES = b"<!DOCTYPE g [<!ENTITY a0 'aaaaaaaaaa'>" + b"".join(
    b"<!ENTITY a%d '%s'>" % (level, b"&a%d;" % (level - 1) * 10) for level in range(1, 10)
) + b"]>"  # fmt: skip
POINT = b"<trkpt lat='1' lon='2'>%s</trkpt>"
CELL = b'<c r="%s"><v>1</v></c>'


def corner(cell: bytes) -> bytes:
    """Rows of a sheet with two cells, of which one is in a corner."""
    return b'<row r="1">' + CELL % b"A1" + b'</row><row r="1048576">' + CELL % cell + b"</row>"


def many_columns(count: int) -> bytes:
    """A text table of this many columns and one row."""
    return ",".join(f"{number:x}" for number in range(count)).encode() + b"\n" + b",".join([b"1"] * count) + b"\n"


def zeros_in_hdf5(file: Any) -> None:
    """Zeros that are stored, and compressed."""
    file.create_dataset("time", data=np.zeros(10**8), compression="gzip", chunks=(10**6,))


def zeros() -> Any:
    """A long column of zeros."""
    return pa.array(np.zeros(2 * 10**8, np.int8))


def repeated_text() -> Any:
    """A long text in many rows, stored once."""
    return pa.array(["x" * 10_000_000]).dictionary_encode().take(pa.array([0] * 3000))


def write_with_json(path: Path) -> Path:
    """A text table with a JSON beside it, as our own exports have one, nested deeply."""
    path.with_name(f"{path.name}.json").write_bytes(b"[" * 3_000_000)
    return write_packed(path, numbers(3))


REPEATED = (
    '<table:table-row table:number-rows-repeated="1000000"><table:table-cell office:value-type="float" '
    'office:value="1" table:number-columns-repeated="1000000"/></table:table-row>'
)
TABLE_BOMBS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "a cell in the last corner": (".xlsx", lambda path: write_xlsx(path, corner(b"XFD1048576"))),
    "a cell in the last row": (".xlsx", lambda path: write_xlsx(path, corner(b"AZ1048576"))),
    "a sheet of blanks": (".xlsx", lambda path: write_xlsx(path, b" " * 10**9)),
    "many cells": (
        ".xlsx",
        lambda path: write_xlsx(path, (b"<row>" + b"<c><v>1</v></c>" * 1000 + b"</row>") * 20_000),
    ),
    "one shared text in many cells": (
        ".xlsx",
        lambda path: write_xlsx(
            path,
            b"<row>" + b'<c t="s"><v>0</v></c>' * 3000 + b"</row>",
            b"<si><t>" + b"x" * 10_000_000 + b"</t></si>",
        ),
    ),
    "a cell repeated a billion times": (".ods", lambda path: write_ods(path, REPEATED)),
    "zeros": (".mat", lambda path: write_mat(path, (6, (1, 10**8), element(9, bytes(8 * 10**8))))),
    "many variables of zeros": (
        ".mat",
        lambda path: write_mat(path, *[(6, (1, 5_000_000), element(9, bytes(40_000_000)))] * 40),
    ),
    "a cell array of a billion": (".mat", lambda path: write_mat(path, (1, (1, 2**30), b""))),
    "a struct of a billion": (
        ".mat",
        lambda path: write_mat(path, (2, (1, 2**30), element(5, b"\x04\0\0\0") + element(1, b"abc\0"))),
    ),
    "dimensions beyond all memory": (
        ".mat",
        lambda path: write_mat(path, (6, (2**31 - 1, 2**31 - 1), element(9, bytes(8)))),
    ),
    "a variable of a terabyte": (".mat", lambda path: write_hdf5(path, huge)),
    "groups within themselves": (".mat", lambda path: write_hdf5(path, lambda file: nest(file, 3))),
    "groups 2,000 deep": (".mat", lambda path: write_hdf5(path, lambda file: nest(file, 2000))),
    "a data set of a terabyte": (".nc", lambda path: write_hdf5(path, huge)),
    "a data set of zeros": (".nc", lambda path: write_hdf5(path, zeros_in_hdf5)),
    "a long text in 3,000 rows": (".parquet", lambda path: write_parquet(path, {"time": repeated_text()})),
    "zeros in 200 million rows": (".parquet", lambda path: write_parquet(path, {"time": zeros()})),
    "a list of 200 million zeros": (
        ".parquet",
        lambda path: write_parquet(path, {"time": pa.ListArray.from_arrays([0, 2 * 10**8], zeros())}),
    ),
    "zero bytes": (".csv.gz", lambda path: write_packed(path, bytes(10**9))),
    "a table of zeros": (".csv.gz", lambda path: write_packed(path, numbers(10_000_000))),
    "a table of zeros by bzip2": (".csv.bz2", lambda path: write_packed(path, numbers(4_000_000))),
    "a table of zeros by xz": (".csv.xz", lambda path: write_packed(path, numbers(4_000_000))),
    "a column of zeros": (".csv.xz", lambda path: write_packed(path, b"time\n" + b"0\n" * 16_000_000)),
    "a cell of 300 MB": (".csv", lambda path: write_packed(path, b"time,a\n1,2\n1," + b"9" * 300_000_000)),
    "a quoted cell of 300 MB": (".csv", lambda path: write_packed(path, b'time,a\n1,"' + b"9" * 300_000_000)),
    "a header of 300 MB": (".csv", lambda path: write_packed(path, b"a" * 300_000_000 + b"\n1\n2\n")),
    "100,000 columns": (".csv", lambda path: write_packed(path, many_columns(100_000))),
    "20,000 columns": (".csv", lambda path: write_packed(path, many_columns(20_000))),
    "2,000 columns": (".csv", lambda path: write_packed(path, many_columns(2_000))),
    "a JSON nested deeply beside it": (".csv", write_with_json),
    "entities of entities": (".gpx", lambda path: write_packed(path, gpx(POINT % b"<a>&a9;</a>", ENTITIES))),
    "elements a million deep": (".gpx", lambda path: write_packed(path, gpx(b"<a>" * 1_000_000))),
    "a million empty elements": (".gpx", lambda path: write_packed(path, gpx(b"<a/>" * 1_000_000))),
    "a point of 300,000 texts": (
        ".gpx",
        lambda path: write_packed(
            path, gpx(POINT % b"".join(b"<a%d>1</a%d>" % (number, number) for number in range(300_000)))
        ),
    ),
    "a text of 300 MB": (".gpx", lambda path: write_packed(path, gpx(POINT % (b"<a>" + b"9" * 300_000_000)))),
}

SENTENCE = b"$GPHDT,123.4,T*31\r\n"


def write_blf(path: Path, *containers: tuple[bytes, int]) -> Path:
    """A BLF log of containers: what they unpack to, and the length that they claim; 0 for the true one."""
    numbers, times = (144, 0, 0, 0, 0, 2, 6, 8, 1, 0, 0, 1, 0), [2026, 5, 0, 17, 12, 0, 0, 0] * 2
    head = struct.pack("<4sLBBBBBBBBQQLL8H8H", b"LOGG", *numbers, *times)
    objects = b""
    for plain, claimed in containers:
        body = struct.pack("<H6xL4x", 2, len(plain)) + zlib.compress(plain, 9)
        objects += struct.pack("<4sHHLL", b"LOBJ", 16, 1, claimed or 16 + len(body), 10) + body
        objects += bytes(len(body) % 4)
    path.write_bytes(head.ljust(144, b"\0") + objects)
    return path


def write_sqlite(path: Path, *statements: str) -> Path:
    """A database made by these statements."""
    with sqlite3.connect(path) as database:
        for statement in statements:
            database.execute(statement)
    database.close()
    return path


ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS ID, 1.78e9 AS UNIX_TIME"
LOG_TABLE = "CREATE TABLE LOG (ID INTEGER, RUN_ID INTEGER, UNIX_TIME REAL, TOPIC TEXT, MESSAGE TEXT)"
OBJECT = struct.pack("<4sHHLL", b"LOBJ", 32, 1, 2**32 - 1, 1)  # says that it goes on for 4 GB
LOG_BOMBS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "zero bytes": (".log.gz", lambda path: write_packed(path, bytes(10**9))),
    "sentences": (".log.gz", lambda path: write_packed(path, SENTENCE * 700_000)),
    "a sentence of 50 MB": (".nmea", lambda path: write_packed(path, SENTENCE + b"$GPHDT," + b"1" * 50_000_000)),
    "a line of 300 MB after a date": (".asc", lambda path: write_packed(path, b"date Sun\n" + b"1 " * 150_000_000)),
    "a line of 300 MB after a head": (
        ".trc",
        lambda path: write_packed(path, b";$FILEVERSION=2.1\n" + b"1" * 300_000_000),
    ),
    "containers of zeros": (".blf", lambda path: write_blf(path, *[(bytes(60_000_000), 0)] * 40)),
    "a container of a gigabyte": (".blf", lambda path: write_blf(path, (bytes(10**9), 0))),
    "a container longer than the log": (".blf", lambda path: write_blf(path, (bytes(1000), 2**32 - 1))),
    "a container shorter than its head": (".blf", lambda path: write_blf(path, (bytes(1000), 1))),
    "an object longer than the log": (".blf", lambda path: write_blf(path, *[(OBJECT + bytes(10**6), 0)] * 300)),
    "BLF by gzip": (".blf.gz", lambda path: write_packed_blf(path)),
    "MAVLink of zeros": (".tlog", lambda path: write_packed(path, bytes(50_000_000))),
    "a block longer than the capture": (
        ".pcapng",
        lambda path: write_packed(path, b"\n\r\r\n" + struct.pack("<III", 2**31, 0x1A2B3C4D, 1) + bytes(100)),
    ),
    "a packet longer than the capture": (
        ".pcap",
        lambda path: write_packed(
            path, bytes.fromhex("d4c3b2a1020004000000000000000000ffffffffe3000000") + b"\xff" * 16
        ),
    ),
    "a view without end": (
        ".db",
        lambda path: write_sqlite(path, f"CREATE VIEW LOG AS {ENDLESS}, 'a/b' AS TOPIC, '1' AS MESSAGE FROM n"),
    ),
    "a message of 300 MB": (
        ".db",
        lambda path: write_sqlite(
            path, LOG_TABLE, "INSERT INTO LOG VALUES (1, 1, 1.78e9, 'a/b', hex(zeroblob(150000000)))"
        ),
    ),
}


def write_packed_blf(path: Path) -> Path:
    """A container that says that it is 4 GB long, of zeros, packed by gzip."""
    start = write_blf(path.with_suffix(".part"), (bytes(10), 2**32 - 1))
    return write_packed(path, start.read_bytes() + bytes(10**9))


DBC_HEAD = b'VERSION ""\nNS_ :\nBS_:\nBU_: X\nBO_ 100 M: 8 X\n SG_ S : 0|8@1+ (1,0) [0|255] "m/s" X\n'
TEXT_BOMBS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "a text of 10 MB": (".dbc", lambda path: write_packed(path, DBC_HEAD + b'CM_ "' + b"a" * 10_000_000 + b'";\n')),
    "a text of 7 MB with quotes": (
        ".dbc", lambda path: write_packed(path, DBC_HEAD + b'CM_ "' + b'aaa\\"' * 1_400_000 + b'";\n')
    ),
    "a text without end": (".dbc", lambda path: write_packed(path, DBC_HEAD + b'CM_ "' + b"a" * 7_000_000)),
    "a word of 7 MB": (".dbc", lambda path: write_packed(path, DBC_HEAD + b"BO_ 1 " + b"a" * 7_000_000)),
    "a million words": (".dbc", lambda path: write_packed(path, DBC_HEAD + b"BO_ " * 1_700_000)),
    "zero bytes": (".dbc", lambda path: write_packed(path, bytes(100_000_000))),
    "a message of a gigabyte": (
        ".dbc", lambda path: write_packed(path, DBC_HEAD.replace(b": 8 X", b": 1000000000 X"))
    ),
    "a signal of a million bits": (
        ".dbc", lambda path: write_packed(path, DBC_HEAD.replace(b"0|8@1+", b"0|1000000@1+"))
    ),
    "a text of 100 MB": (".toml", lambda path: write_packed(path, b'name = "' + b"a" * 100_000_000 + b'"\n')),
    "100 MB of lines": (".toml", lambda path: write_packed(path, b"# a comment\n" * 8_500_000)),
    "lists in lists": (".toml", lambda path: write_packed(path, b"a = " + b"[" * 1_000_000)),
    "tables in tables": (".toml", lambda path: write_packed(path, b".".join([b"a"] * 100_000) + b" = 1\n")),
    "many tables": (
        ".toml", lambda path: write_packed(path, b"".join(b"[t%d]\n" % number for number in range(300_000)))
    ),
}  # fmt: skip


BOMBS: dict[str, Callable[[Path], object]] = {
    **{f"recording: {name}": write for name, write in MCAP_BOMBS.items()},
    **{f"table: {name}": write for name, (_, write) in TABLE_BOMBS.items()},
    **{f"log: {name}": write for name, (_, write) in LOG_BOMBS.items()},
    **{f"text: {name}": write for name, (_, write) in TEXT_BOMBS.items()},
}


def write_bomb(name: str, path: Path) -> Path:
    """Write one of :data:`BOMBS` in another process: the memory that it takes must not count as the command's."""
    subprocess.run([sys.executable, "-m", "tests.attacks.bombs", name, path], check=True)
    return path


if __name__ == "__main__":
    BOMBS[sys.argv[1]](Path(sys.argv[2]))
