"""One recording on a page: what it is, what it is worth, where the ship went, what she did, where it comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from acquisition.core.channels import BY_NAME
from analysis.report.quality_page import HEADER, channel_rows, finding_cells
from analysis.report.rendering import Page, render
from analysis.report.run_sheet import run_sheet
from analysis.tables.export import SIGMA_SUFFIX

if TYPE_CHECKING:
    import pandas as pd

    from analysis.products import Products

_FILES = ("table.parquet", "flags.parquet", "quality.json", "windows.parquet", "manoeuvres.json", "summary.json")


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    provenance = row["provenance"]
    findings, others = _findings(products)
    dropped = sorted(row["windows_dropped"].items(), key=lambda each: -each[1])
    return render(
        "recording.html",
        title=products.recording.trial.name or provenance["recording"],
        subtitle=f"{provenance['recording']}, {row['start'][:10]} {row['start'][11:19]} UTC",
        headline=headline_of(row), row=row, products=products,
        run_sheet=run_sheet(products.recording, products.one_hz, products.manoeuvres),
        findings=findings, other_repairs=others,
        channel_header=HEADER, channels=channel_rows(products.quality),
        executes=[each.start for each in products.manoeuvres],
        dropped=", ".join(f"{count:,} {reason.replace('_', ' ')}" for reason, count in dropped),
        uncertainty=_uncertainty(products.one_hz), origin=_origin(provenance),
    )  # fmt: skip


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


def _findings(products: Products) -> tuple[list[list[str]], list[str]]:
    """The cells of each finding with what was repaired of it, and the repairs that belong to none."""
    repaired = {
        (each.code, each.channel): f"Repaired: {each.text}, {each.changed:,} values." for each in products.repairs
    }
    cells = []
    for finding in products.quality.findings:
        what, about, text = finding_cells(finding)
        text = text if text.split(" ", 1)[0] in BY_NAME else text[:1].upper() + text[1:]
        cells.append([what, about, text, repaired.pop((finding.code, finding.channel), "")])
    return cells, list(repaired.values())


def _uncertainty(one_hz: pd.DataFrame) -> list[list[str]] | None:
    """How well the smoother knows each channel of the motion; None without it."""
    names = [name for name in map(str, one_hz) if f"{name}{SIGMA_SUFFIX}" in one_hz and name in BY_NAME]
    halves = {name: 1.96 * one_hz[f"{name}{SIGMA_SUFFIX}"].dropna() for name in names}
    rows = [
        [name, f"\u00b1 {half.median():.3g} {BY_NAME[name].unit}", f"\u00b1 {half.max():.3g} {BY_NAME[name].unit}",
         f"{len(one_hz) - len(half):,}"]
        for name, half in halves.items() if len(half)
    ]  # fmt: skip
    return rows if names else None


def _origin(provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """Where it all comes from, and the files beside the page."""
    software = (
        value if value.startswith(key) else f"{key} {value}" for key, value in provenance["software"].items()
    )
    return [
        ("beside this page", ", ".join(_FILES)),
        ("recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"),
        ("SHA-256", provenance["sha256"]),
        ("options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())),
        ("software", ", ".join(software)),
    ]
