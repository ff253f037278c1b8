"""The page of a batch: a row a recording, to sort, to filter and to click through, in one file without network."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any
from urllib.parse import quote

from acquisition.core.channels import NAMES
from acquisition.recording.trial import software_version

Row = Mapping[str, Any]

_COLUMNS = {
    "track": "track", "name": "recording", "status": "status", "start": "start, UTC", "duration_s": "duration",
    "distance_m": "sailed [nmi]", "samples": "samples", "grade": "data", "findings": "findings",
    "repairs": "repairs", "windows_kept": "held windows", "manoeuvres": "manoeuvres",
}  # fmt: skip
_BREAKS = re.compile(r"([/_])(?=\w)")  # where a long name may go on in the next line
_FEW = 3  # names of missing channels that are shown and not counted
_GRADES = {"bad": 0, "suspect": 1, "good": 2}  # the worst first
_STATUSES = {
    "failed": (0, "failed"),
    "cut off": (1, "done, cut off"),
    "gone": (2, "recording gone"),
    "done": (3, "done"),
}
_NUMERIC = {"duration_s", "distance_m", "samples", "repairs", "windows_kept"}

_CSS = """
:root{--ink:#1f2a33;--soft:#66747f;--line:#e4e9ed;--sea:#0072B2;--paper:#fff;--wash:#f4f7f9}
*{box-sizing:border-box} body{font:14px/1.45 system-ui,sans-serif;color:var(--ink);margin:0;background:var(--paper)}
header,main,footer{max-width:1500px;margin:0 auto;padding:0 24px} header{padding-top:24px}
h1{font-size:1.55em;margin:0} .soft{color:var(--soft)}
.tiles{display:flex;flex-wrap:wrap;gap:12px;margin:16px 0}
.tiles div{background:var(--wash);border-radius:8px;padding:8px 16px;color:var(--soft)}
.tiles b{display:block;font-size:1.5em;color:var(--sea);font-variant-numeric:tabular-nums}
.tiles .failed b{color:#B3261E}
details{border:1px solid #f0c9c5;border-left:4px solid #B3261E;border-radius:6px;padding:8px 14px;margin:12px 0;
background:#fffaf9} summary{cursor:pointer;font-weight:600} details li{margin:4px 0} details ul{margin:8px 0 4px}
#filter{font:inherit;padding:7px 12px;width:min(380px,100%);border:1px solid #c5ced6;border-radius:6px}
.bar{display:flex;gap:14px;align-items:center;margin:14px 0 8px}
table{border-collapse:collapse;width:100%} td,th{padding:6px 7px;text-align:left;vertical-align:middle}
tbody tr{border-bottom:1px solid var(--line)} tbody tr:hover{background:var(--wash)}
th{position:sticky;top:0;background:var(--paper);box-shadow:inset 0 -2px var(--line);vertical-align:bottom;
font-weight:600}
th button{font:inherit;text-align:inherit;color:inherit;background:none;border:0;padding:0;cursor:pointer}
th[aria-sort] button{color:var(--sea)} th[aria-sort=ascending] button::after{content:" \\25B2";font-size:.75em}
th[aria-sort=descending] button::after{content:" \\25BC";font-size:.75em}
.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap} td .soft{font-size:.88em}
td.name{min-width:190px;overflow-wrap:anywhere} a{color:var(--sea);text-decoration:none;font-weight:600}
a:hover{text-decoration:underline} .cause{color:#B3261E;font-size:.88em} .remark{color:#7a5200;font-size:.88em}
svg{display:block;width:52px;height:52px}
polyline{fill:none;stroke:var(--sea);stroke-width:2.5;stroke-linejoin:round}
.pill{display:inline-block;border-radius:99px;padding:1px 10px;font-size:.88em;font-weight:600}
.good{background:#dcf1e9;color:#00664c}.suspect{background:#fdf0d3;color:#7a5200}
.bad,.pill.failed{background:#fbdedb;color:#8c1d16}.cut-off{background:#fdf0d3;color:#7a5200}
.gone{background:var(--line);color:var(--soft)} .pill{white-space:nowrap}
footer{padding-top:16px;padding-bottom:32px} @media print{th{position:static} .bar{display:none}}
"""

_SCRIPT = """
const body=document.querySelector('tbody'),rows=[...body.rows],heads=[...document.querySelectorAll('th[data-key]')];
const filter=document.getElementById('filter'),shown=document.getElementById('shown');
const state=new URLSearchParams(location.hash.slice(1));
const texts=new Map(rows.map(r=>[r,r.textContent.toLowerCase()]));
function apply(){
  const key=state.get('sort'),at=heads.findIndex(h=>h.dataset.key===key),down=state.get('order')==='desc';
  heads.forEach((h,i)=>i===at?h.setAttribute('aria-sort',down?'descending':'ascending'):h.removeAttribute('aria-sort'));
  if(at>=0){
    const column=heads[at].cellIndex,numeric=heads[at].dataset.kind==='n';
    const value=new Map(rows.map(r=>{const v=r.cells[column].dataset.v;return[r,numeric&&v!==''?Number(v):v]}));
    const order=(a,b)=>{const x=value.get(a),y=value.get(b);
      if(x===''||y==='')return (x==='')-(y==='');
      return (down?-1:1)*(numeric?x-y:x.localeCompare(y,'en',{numeric:true}))};
    body.append(...rows.slice().sort(order));
  }
  const words=(state.get('filter')||'').toLowerCase().split(/\\s+/).filter(Boolean);let n=0;
  for(const r of rows){const t=texts.get(r),hit=words.every(w=>t.includes(w));r.hidden=!hit;n+=hit}
  shown.textContent=n===rows.length?`${n} recordings`:`${n} of ${rows.length} recordings`;
}
function keep(){history.replaceState(null,'','#'+state);apply()}
heads.forEach(h=>h.querySelector('button').addEventListener('click',()=>{
  const again=state.get('sort')===h.dataset.key&&state.get('order')!=='desc';
  state.set('sort',h.dataset.key);state.set('order',again?'desc':'asc');keep()}));
filter.value=state.get('filter')||'';
filter.addEventListener('input',()=>{filter.value?state.set('filter',filter.value):state.delete('filter');keep()});
document.querySelectorAll('a.only').forEach(a=>a.addEventListener('click',e=>{
  e.preventDefault();filter.value=a.dataset.filter;state.set('filter',a.dataset.filter);keep()}));
apply();
"""


def index_page(rows: Sequence[Row], failures: Sequence[tuple[str, list[str]]], title: str) -> str:
    """The page as text, of rows as of :func:`analysis.batch.one_recording.row_of` and failures by their cause."""
    heads = "".join(_head(key, text) for key, text in _COLUMNS.items())
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width">'
        f"<title>{escape(title)}</title><style>{_CSS}</style></head>\n<body><header><h1>{escape(title)}</h1>"
        f'<div class="tiles">{_tiles(rows)}</div>{_failures(failures)}</header>\n<main><div class="bar">'
        f'<input id="filter" type="search" placeholder="Filter: a word of any row" aria-label="Filter">'
        f'<span class="soft" id="shown"></span></div>\n<table><thead><tr>{heads}</tr></thead>\n<tbody>\n'
        f"{''.join(map(_row, rows))}</tbody></table></main>\n"
        f'<footer class="soft">{escape(software_version())}; the same as a table: '
        f'<a href="index.parquet">index.parquet</a></footer>\n<script>{_SCRIPT}</script></body></html>\n'
    )


def _head(key: str, text: str) -> str:
    if key == "track":
        return "<th></th>"
    kind = "n" if key in _NUMERIC | {"status", "grade", "findings"} else "t"
    right = ' class="n"' if key in _NUMERIC else ""
    return f'<th{right} data-key="{key}" data-kind="{kind}"><button>{escape(text)}</button></th>'


def _tiles(rows: Sequence[Row]) -> str:
    rows = [row for row in rows if row["status"] != "gone"]
    failed = sum(row["status"] == "failed" for row in rows)
    figures = {
        "recordings": f"{len(rows):,}",
        "hours": f"{_total(rows, 'duration_s') / 3600:,.1f}",
        "nautical miles": f"{_total(rows, 'distance_m') / 1852:,.1f}",
        "samples": f"{_total(rows, 'samples'):,.0f}",
        "held windows": f"{_total(rows, 'windows_kept'):,.0f}",
        "manoeuvres": f"{sum(sum((row.get('manoeuvres') or {}).values()) for row in rows):,}",
        "findings": f"{_total(rows, 'findings'):,.0f}",
    }
    tiles = "".join(f"<div><b>{value}</b>{name}</div>" for name, value in figures.items())
    return tiles + f"<div{' class=failed' if failed else ''}><b>{failed}</b>failed</div>"


def _total(rows: Iterable[Row], name: str) -> float:
    return float(sum(row.get(name) or 0 for row in rows))


def _failures(failures: Sequence[tuple[str, list[str]]]) -> str:
    if not failures:
        return ""
    number = sum(len(names) for _, names in failures)
    what = "1 recording" if number == 1 else f"{number} recordings"
    causes = "".join(
        f"<li><b>{len(names)}</b> &times; {escape(cause)}<br><span class=soft>"
        + ", ".join(f'<a class="only" href="#" data-filter="{escape(each)}">{escape(each)}</a>' for each in names)
        + "</span></li>"
        for cause, names in failures
    )
    return f"<details open><summary>{what} failed</summary><ul>{causes}</ul></details>"


def _row(row: Row) -> str:
    cells = "".join(_cell(key, *_shown(key, row)) for key in _COLUMNS)
    return f"<tr>{cells}</tr>\n"


def _cell(key: str, value: object, html: str) -> str:
    """A cell: what it is sorted by, and what is seen."""
    css = ' class="n"' if key in _NUMERIC else ' class="name"' if key == "name" else ""
    return f'<td{css} data-v="{escape("" if value is None else str(value))}">{html}</td>'


def _shown(key: str, row: Row) -> tuple[object, str]:
    value = row.get(key)
    if key in _SHOWN:
        return _SHOWN[key](row)
    return value, "" if value is None else f"{value:,}" if isinstance(value, int) else escape(str(value))


def _track(row: Row) -> tuple[object, str]:
    points = row.get("track")
    return "", f'<svg viewBox="0 0 100 100"><polyline points="{escape(points)}"/></svg>' if points else ""


def _name(row: Row) -> tuple[object, str]:
    name = _BREAKS.sub(r"\1<wbr>", escape(row["name"]))
    page = f'<a href="{quote(row["name"])}/page.html">{name}</a>' if "provenance" in row else f"<b>{name}</b>"
    about = " &middot; ".join(
        escape(row[key]) for key in ("trial", "vessel", "place") if row.get(key) and row[key] != row["name"]
    )
    if row.get("report"):
        page += f' <a class="report" href="{quote(row["name"])}/report.html">report</a>'
    css = "cause" if row["status"] == "failed" else "remark"
    cause = f'<div class="{css}">{escape(row["cause"])}</div>' if row.get("cause") else ""
    return row["name"], f"{page}<div class=soft>{about}</div>{cause}"


def _status(row: Row) -> tuple[object, str]:
    """What became of it: a recording that was cut off is done as far as it goes, and that is said here."""
    status = "cut off" if row["status"] == "done" and row.get("closed") is False else row["status"]
    order, text = _STATUSES[status]
    return order, text if status == "done" else f'<span class="pill {status.replace(" ", "-")}">{text}</span>'


def _start(row: Row) -> tuple[object, str]:
    start = row.get("start") or ""
    return start, f'<span style="white-space:nowrap">{escape(start[:10])} <b>{escape(start[11:16])}</b></span>'


def _duration(row: Row) -> tuple[object, str]:
    seconds = row.get("duration_s")
    if seconds is None:
        return None, ""
    hours, rest = divmod(round(seconds), 3600)
    return seconds, f"{hours} h {rest // 60:02d} min" if hours else f"{rest // 60} min {rest % 60:02d} s"


def _distance(row: Row) -> tuple[object, str]:
    metres = row.get("distance_m")
    return metres, "" if metres is None else f"{metres / 1852:.2f}"


def _grade(row: Row) -> tuple[object, str]:
    grade = row.get("grade") or ""
    pill = f'<span class="pill {grade}">{grade}</span>' if grade else ""
    missing = row.get("missing") or []
    if missing:
        names = ", ".join(missing)
        said = names if len(missing) <= _FEW else f"{len(missing)} of {len(NAMES)} channels"
        pill += f'<div class="soft" title="{escape(names)}">without {escape(said)}</div>'
    return _GRADES.get(grade, "") if not missing else _GRADES.get(grade, 0) - len(missing) / 100, pill


def _findings(row: Row) -> tuple[object, str]:
    return row.get("findings"), _counted(row.get("findings_by_code"), row.get("findings"))


def _manoeuvres(row: Row) -> tuple[object, str]:
    kinds = row.get("manoeuvres") or {}
    return ", ".join(sorted(kinds)), _counted(kinds, None)


def _windows(row: Row) -> tuple[object, str]:
    kept = row.get("windows_kept")
    return kept, "" if kept is None else f"{kept:,} <span class=soft>of {row['windows_candidates']:,}</span>"


def _counted(counts: Mapping[str, int] | None, none: object) -> str:
    """``2 spikes, 1 gap``: what there is of each kind."""
    if not counts:
        return "" if none is None else f"<span class=soft>{none}</span>"
    return "<br>".join(
        f"<span style='white-space:nowrap'>{count} {escape(kind.replace('_', ' '))}</span>"
        for kind, count in sorted(counts.items(), key=lambda each: (-each[1], each[0]))
    )


_SHOWN = {
    "track": _track, "name": _name, "status": _status, "start": _start, "duration_s": _duration,
    "distance_m": _distance, "grade": _grade, "findings": _findings, "windows_kept": _windows,
    "manoeuvres": _manoeuvres,
}  # fmt: skip
