"""The main job from end to end, as `make demo` runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquisition.core.channels import NAMES
from acquisition.recording.reader import read_recording


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_demo_loses_nothing_and_beats_the_reference(tmp_path: Path) -> None:
    """Every played value is recorded, and the calibrator is better than its reference on the unseen voyage."""
    from hybrid.workflows.demo import demonstrate

    said: list[str] = []
    done = demonstrate(tmp_path, seed=7, say=said.append, progress=lambda what: lambda share: None)
    assert done.played.counts.keys() >= set(NAMES)
    assert sum(done.lost.values()) == 0
    assert read_recording(done.recording).closed
    assert done.validation.reduction is not None
    assert done.validation.reduction > 0.3
    assert "hull_lengthening" in [effect.name for effect in done.diagnosis.effects]
    assert done.diagnosis.gap.closed > 0.9
    page = done.report.read_text()
    assert page.count("data:image/png;base64,") >= 12
    assert "ocean current" in page
    assert 'href="diagnosis/missing_effect.html"' in page
    assert (done.report.parent / "diagnosis" / "missing_effect.html").is_file()
    assert "http://" not in page
    assert "https://" not in page
