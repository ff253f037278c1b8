"""Pages of hostile texts: what strangers wrote is text on every page, and never markup, script or an address."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import fields
from html.parser import HTMLParser
from pathlib import Path

import pytest

from seatrial.acquisition.core.trial import Quality, Sample, Trial
from seatrial.acquisition.logger.health import Health, SourceHealth
from seatrial.acquisition.logger.record import Picture, health_as_json, status_page_html
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.analysis.serve import Season, make_app
from seatrial.analysis.tables.table import times_ns
from tests.analysis.small_batch import QUICK, sailed
from tests.analysis.test_serve import HERE
from tests.attacks.test_seasons import batch_here
from tests.conftest import Command

TAME = "calm"
HOSTILE = {
    "script": "<script>alert(1)</script>",
    "end of a script": "</script><script>alert(1)//",
    "attribute": "\"' onmouseover=alert(1) x='",
    "picture": "<img src=x onerror=alert(1)>",
    "comment": "<!-- --!><svg/onload=alert(1)>",
    "cdata": "]]><iframe src=javascript:alert(1)>",
    "template": "{{ 7*7 }}{% for a in b %}${7*7}",
    "address": "javascript:alert(1)",
    "entity": "&lt;script&gt;&#60;img src=x&#62;",
    "control": "\x1b[2J\x00\u202e\u2066<b>\x85\u2028",
    "markup of rich": "[bold red]a[/] [link=javascript:alert(1)]b[/link] :smiley: [/x] [b",
    "long": "<i>" * 500,
}
"""Texts by what they try to be."""
QUICK_KINDS = ("end of a script", "attribute", "control", "markup of rich")
HOSTILE["several"] = " ".join(HOSTILE[kind] for kind in QUICK_KINDS)
"""What is tried on whole seasons in each run of the suite; the others go the same way."""
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
_OF_THE_SHIP = ("actuators", "channels")  # lists in a form of their own


class _Structure(HTMLParser):
    """What a browser makes of a page besides text: its tags, and the attributes that run or fetch something."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.running: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        for name, value in attributes:
            address = (value or "").strip().lower()
            if name.startswith("on") or (name in ("href", "src", "action") and address.startswith("javascript")):
                self.running.append(f"{tag} {name}={value}")


def write_recording(path: Path, text: str) -> None:
    """A recording of a stranger's in which everything that may be text is ``text``."""
    texts = [field.name for field in fields(Trial) if field.type == "str" and field.name not in _OF_THE_SHIP]
    trial = Trial(**dict.fromkeys(texts, text), origin_latitude_deg=63.4, origin_longitude_deg=10.4)
    table = sailed(45)
    table.iloc[50, 0] += 500.0  # so that there is a finding, with its source
    with pytest.MonkeyPatch.context() as patch, RecordingWriter(path, trial) as writer:
        patch.setattr("seatrial.acquisition.recording.writer.channel_metadata", lambda topic, known: {"unit": text})
        writer.write_metadata("part", {"number": text, "follows": text, "reason": text})
        writer.write_metadata("clock", {"times": text, "host_clock": text, "utc_minus_monotonic_ns": text})
        for time_ns, (_, row) in zip(times_ns(table).tolist(), table.iterrows(), strict=True):
            for name, value in row.items():
                writer.write_sample(Sample(str(name), value, text, time_ns, 0, time_ns, None, text))
            writer.write_sample(Sample(text, 1.0, text, time_ns, 0, time_ns, None, text, Quality.SUSPECT))
            writer.write_event(text, time_ns, "warning", text)


def pages_of(text: str, folder: Path, command: Command) -> dict[str, str]:
    """All pages without a model of a season with one recording of ``text``."""
    season, out = folder / "season", folder / "out"
    season.mkdir(parents=True)
    write_recording(season / "a.mcap", text)
    batch_here(season, out)
    for name, *options in (["check", "-o", out / "quality"], ["manoeuvres", "-o", out / "manoeuvres"], ["info"]):
        done = command(name, season / "a.mcap", *options)
        assert done.code == 0, done.err
        assert not _CONTROL.search(done.out + done.err)
    with Season(season, out, QUICK, eager=False) as served:
        index = make_app(served, upload_mb=1.0).test_client().get("/", headers=HERE).text
    (out / "served.html").write_text(index, encoding="utf-8")
    return {path.relative_to(out).as_posix(): path.read_text("utf-8") for path in sorted(out.rglob("*.html"))}


@pytest.fixture(scope="module")
def tame() -> dict[str, Counter[str]]:
    return {}


def structure_of(text: str) -> Counter[str]:
    """The tags of a page, without those that only break lines."""
    page = _Structure(text)
    assert not page.running
    return Counter({tag: number for tag, number in page.tags.items() if tag not in ("wbr", "br")})


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[] if kind == "several" else pytest.mark.attack) for kind in HOSTILE]
)
def test_pages_of_a_season_have_the_same_structure_whatever_is_written(
    kind: str, tame: dict[str, Counter[str]], tmp_path: Path, command: Command
) -> None:
    if not tame:
        tame |= {name: structure_of(text) for name, text in pages_of(TAME, tmp_path / "tame", command).items()}
    pages = pages_of(HOSTILE[kind], tmp_path / "hostile", command)
    assert pages.keys() == tame.keys()
    assert len(pages) >= 4
    for name, text in pages.items():
        assert structure_of(text) == tame[name], name
        assert not _CONTROL.search(text), name


@pytest.mark.parametrize("kind", HOSTILE)
def test_status_page_has_the_same_structure_whatever_is_received(kind: str) -> None:
    def shown(text: str) -> str:
        source = SourceHealth(text, refusals=[Counter({text: 3})])
        health = Health({text: source})
        health.events.append((0, "warning", text))
        health.alarms[text] = text
        health.part = health.trouble = text
        health_as_json(health)
        return status_page_html(Picture(health, frozenset(), None), text)

    tame, hostile = _Structure(shown(TAME)), _Structure(shown(HOSTILE[kind]))
    assert not hostile.running
    assert hostile.tags - Counter({"span": 10**6}) == tame.tags - Counter({"span": 10**6})


@pytest.mark.attack
@pytest.mark.parametrize("kind", ["script", "end of a script", "attribute", "control"])
def test_report_has_the_same_structure_whatever_is_written(kind: str, tmp_path: Path, command: Command) -> None:
    structures = []
    for name, text in (("tame", TAME), ("hostile", HOSTILE[kind])):
        folder = tmp_path / name
        folder.mkdir()
        write_recording(folder / "a.mcap", text)
        done = command("report", folder, "--vessel", "gunnerus_short", "--interactive", "--no-pdf")
        assert done.code == 0, done.err
        pages = {path.name: path.read_text("utf-8") for path in folder.rglob("*.html")}
        structures.append({page: structure_of(text) for page, text in pages.items()})
    assert structures[0] == structures[1]
    assert len(structures[0]) >= 2
