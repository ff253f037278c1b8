"""One recording on a page: what it is, what it is worth, where the ship went, what she did, where it comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from acquisition.core.channels import BY_NAME
from analysis.quality.summary import ALL
from analysis.quality.terminal import counts_of, finding_text
from analysis.report.manoeuvres_page import add_manoeuvres
from analysis.report.page import Page
from analysis.report.run_sheet import add_run_sheet, run_sheet
from analysis.report.trial_figures import add_channels, add_track
from analysis.tables.export import SIGMA_SUFFIX

if TYPE_CHECKING:
    import pandas as pd

    from analysis.batch.products import Products
    from analysis.quality.findings import Finding

_CHANNEL_HEADER = ["channel", "grade", "samples", "rate [Hz]", "gaps", "stuck", "spikes", "out of range",
                   "times twice", "steps back"]  # fmt: skip


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    provenance, trial = row["provenance"], products.recording.trial
    page = Page(trial.name or provenance["recording"], f"{provenance['recording']}, {_when(row)}")
    page.headline(headline_of(row))
    if row["cause"]:
        page.note(f"Please note: {row['cause']}.")
    page.heading("Run sheet")
    add_run_sheet(page, run_sheet(products.recording, products.one_hz, products.manoeuvres))
    _add_quality(page, products, row["missing"])
    if provenance["options"]["pictures"] and products.windows is not None:
        page.heading("The trial")
        executes = [each.start for each in products.manoeuvres]
        add_track(page, products.one_hz, products.windows.rows, provenance["options"]["length_m"], executes)
        add_channels(page, products.one_hz, products.windows.rows)
    _add_windows(page, row)
    _add_uncertainty(page, products.one_hz, products.remarks)
    if products.manoeuvres:
        page.heading("Manoeuvres")
        options = provenance["options"]
        add_manoeuvres(page, products.table, products.manoeuvres, options["length_m"], pictures=options["pictures"])
    _add_origin(page, provenance)
    return page


def _when(row: dict[str, Any]) -> str:
    return f"{row['start'][:10]} {row['start'][11:19]} UTC"


def headline_of(row: dict[str, Any]) -> dict[str, str]:
    """The numbers that matter, for people."""
    figures = {"duration": f"{row['duration_s'] / 60:.1f} min", "samples": f"{row['samples']:,}"}
    if row["distance_m"] is not None:
        figures["sailed"] = f"{row['distance_m'] / 1852:.2f} nmi"
    if row["grade"]:
        figures["worst channel"] = row["grade"]
    if row["missing"]:
        figures["channels missing"] = f"{len(row['missing'])}"
    figures |= {"findings": str(row["findings"]), "repairs": str(row["repairs"])}
    if row["windows_kept"] is not None:
        figures["held windows"] = f"{row['windows_kept']} of {row['windows_candidates']}"
    return figures | {"manoeuvres": str(sum(row["manoeuvres"].values()))}


def _add_quality(page: Page, products: Products, missing: list[str]) -> None:
    """What was found, what was put right, and the channels one by one."""
    page.heading("Data quality")
    if missing:
        page.note(f"Without {', '.join(missing)}: of what is not there, nothing can be judged.")
    if not products.quality.findings:
        page.text("Nothing found: every check passed.")
    mended = {
        (each.code, each.channel): f"Repaired: {each.text}, {each.changed:,} values." for each in products.repairs
    }
    for finding in products.quality.findings:
        done = mended.pop((finding.code, finding.channel), "")
        page.statement(finding.code.replace("_", " "), _about(finding), _sentence(finding), done)
    for text in mended.values():
        page.text(text)
    channels = products.quality.channels
    with page.details(f"The {len(channels)} channels one by one"):
        page.table(_CHANNEL_HEADER, [[name, each.grade, *counts_of(each)] for name, each in channels.items()])


def _about(finding: Finding) -> str:
    channel = "all channels" if finding.channel == ALL else finding.channel
    return f"{channel} · {finding.start:%H:%M:%S} to {finding.end:%H:%M:%S} UTC"


def _sentence(finding: Finding) -> str:
    text = finding_text(finding)
    return text if text.split(" ", 1)[0] in BY_NAME else text[:1].upper() + text[1:]


def _add_windows(page: Page, row: dict[str, Any]) -> None:
    """How many windows are held, and why the others are not."""
    if row["windows_kept"] is None:
        return
    options = row["provenance"]["options"]
    dropped = sorted(row["windows_dropped"].items(), key=lambda each: -each[1])
    reasons = ", ".join(f"{count:,} {reason.replace('_', ' ')}" for reason, count in dropped)
    page.text(
        f"Of {row['windows_candidates']:,} windows of {options['horizon_s']} s, one every {options['stride_s']} s, "
        f"{row['windows_kept']:,} are held, in {row['legs']} legs" + (f"; dropped: {reasons}." if reasons else ".")
    )


def _add_uncertainty(page: Page, one_hz: pd.DataFrame, remarks: tuple[str, ...]) -> None:
    """How well the smoother knows the motion, and how far the samples lie from it."""
    names = [name for name in map(str, one_hz) if f"{name}{SIGMA_SUFFIX}" in one_hz and name in BY_NAME]
    if not names:
        return
    page.heading("Uncertainty")
    page.text(
        "Of the motion from the smoother, once a second: half of the 95 % band, in the middle and at its widest."
    )
    halves = {name: 1.96 * one_hz[f"{name}{SIGMA_SUFFIX}"].dropna() for name in names}
    page.table(
        ["channel", "typical", "widest", "seconds without"],
        [
            [name, f"± {half.median():.3g} {BY_NAME[name].unit}", f"± {half.max():.3g} {BY_NAME[name].unit}",
             f"{len(one_hz) - len(half):,}"]
            for name, half in halves.items() if len(half)
        ],
    )  # fmt: skip
    if remarks:
        page.text("These bands are in doubt, since innovations do not have the size that they promise:")
        for remark in remarks:
            page.text(remark)


def _add_origin(page: Page, provenance: dict[str, Any]) -> None:
    """Where it all comes from, and the files beside the page."""
    page.heading("Files and where this comes from")
    files = ("table.parquet", "flags.parquet", "quality.json", "windows.parquet", "manoeuvres.json", "summary.json")
    page.table(
        ["", ""],
        [
            ["beside this page", ", ".join(files)],
            ["recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"],
            ["SHA-256", provenance["sha256"]],
            ["options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())],
            [
                "software",
                ", ".join(
                    value if value.startswith(key) else f"{key} {value}"
                    for key, value in provenance["software"].items()
                ),
            ],
        ],
        words=True,
    )
