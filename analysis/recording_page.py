"""One recording on a page: what it is, what it is worth, where the ship went, what she did."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from analysis.page import Page, add_recording, add_run_sheet

if TYPE_CHECKING:
    from analysis.one_recording import Products


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    provenance, trial = row["provenance"], products.recording.trial
    page = Page(trial.name or provenance["recording"], f"{provenance['recording']}, {row['start'][:16]} UTC")
    page.headline(headline_of(row))
    if row["cause"]:
        page.text(f"Please note: {row['cause']}.")
    _add_quality(page, products)
    if provenance["options"]["pictures"] and products.windows is not None:
        add_recording(page, products.one_hz, products.windows.rows)
    _add_manoeuvres(page, products, provenance["options"])
    add_run_sheet(page, trial.as_metadata())
    _add_origin(page, provenance)
    return page


def headline_of(row: dict[str, Any]) -> dict[str, str]:
    """The numbers that matter, for people."""
    figures = {"duration": f"{row['duration_s'] / 60:.1f} min", "samples": f"{row['samples']:,}"}
    if row["distance_m"] is not None:
        figures["sailed"] = f"{row['distance_m'] / 1852:.2f} nmi"
    figures |= {"data": row["grade"], "findings": str(row["findings"]), "repairs": str(row["repairs"])}
    if row["windows_kept"] is not None:
        figures["held windows"] = f"{row['windows_kept']} of {row['windows_candidates']}"
    return figures | {"manoeuvres": str(sum(row["manoeuvres"].values()))}


def _add_quality(page: Page, products: Products) -> None:
    """What was found, what was put right, and the channels one by one."""
    page.heading("Data quality")
    if not products.quality.findings:
        page.text("Every check passed.")
    if products.quality.findings:
        rows = [[f"{each.code.replace('_', ' ')}, {each.channel}", f"{each.text} {each.remedy}".strip()]
                for each in products.quality.findings]  # fmt: skip
        page.table(["found", "what and what to do"], rows)
    if products.repairs:
        page.table(["repaired", "how"], [[each.code.replace("_", " "), each.text] for each in products.repairs])
    header = ["channel", "grade", "samples", "rate [Hz]", "gaps", "stuck", "spikes", "out of range"]
    page.table(header, [
        [name, each.grade, f"{each.count:,}", f"{each.rate_hz:.3g}", str(len(each.gaps)), str(len(each.stuck)),
         str(each.spikes), str(each.out_of_range)]
        for name, each in products.quality.channels.items()
    ])  # fmt: skip


def _add_manoeuvres(page: Page, products: Products, options: dict[str, Any]) -> None:
    """A picture of each manoeuvre and its indices."""
    if not products.manoeuvres:
        return
    from analysis.manoeuvre_plots import drawer, title_of
    from analysis.manoeuvres.motion import motion_of
    from analysis.manoeuvres.report import HEADER, rows_of, subline

    page.heading("Manoeuvres")
    motion = motion_of(products.table)
    for each in products.manoeuvres:
        if options["pictures"]:
            page.figure(*drawer(motion, each, options["length_m"]), title_of(each))
        else:
            page.text(title_of(each))
        page.text(subline(each))
        page.table(list(HEADER), rows_of(each))


def _add_origin(page: Page, provenance: dict[str, Any]) -> None:
    page.heading("Where this comes from")
    page.table(["", ""], [
        ["recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"],
        ["SHA-256", provenance["sha256"]],
        ["options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())],
        ["software", ", ".join(f"{key} {value}" for key, value in provenance["software"].items())],
    ])  # fmt: skip
