"""One recording on a page: what it is, what it is worth, where the ship went, what she did."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from analysis.page import Page, add_recording, add_run_sheet

if TYPE_CHECKING:
    from analysis.one_recording import Products


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    trial = products.recording.trial
    page = Page(
        trial.name or products.recording.path.stem, f"{row['provenance']['recording']}, {row['start'][:16]} UTC"
    )
    page.headline(headline_of(row))
    if row["cause"]:
        page.text(f"Incomplete: {row['cause']}")
    add_run_sheet(page, trial.as_metadata())
    if products.windows is not None:
        add_recording(page, products.one_hz, products.windows.rows)
    _add_origin(page, row["provenance"])
    return page


def headline_of(row: dict[str, Any]) -> dict[str, str]:
    """The numbers that matter, for people."""
    figures = {"duration": f"{row['duration_s'] / 60:.1f} min", "samples": f"{row['samples']:,}"}
    if row["distance_m"] is not None:
        figures["sailed"] = f"{row['distance_m'] / 1852:.2f} nmi"
    if row["windows_kept"] is not None:
        figures["held windows"] = f"{row['windows_kept']} of {row['windows_candidates']}"
    return figures


def _add_origin(page: Page, provenance: dict[str, Any]) -> None:
    page.heading("Where this comes from")
    rows = [
        ["recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"],
        ["SHA-256", provenance["sha256"]],
        ["options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())],
        ["software", ", ".join(f"{key} {value}" for key, value in provenance["software"].items())],
    ]
    page.table(["", ""], rows)
