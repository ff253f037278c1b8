"""``python -m tests.benchmarks.other_ship``: one trial as a CSV table, its truth as JSON beside it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.hybrid.effects import parse_effects
from tests.benchmarks.other_ship import OUTSIDE, PROGRAMMES, SEAS, make_trial
from tests.benchmarks.other_ship.model_error import FORMS


def _sizes(texts: list[str]) -> dict[str, float]:
    pairs = (text.partition("=") for text in texts)
    return {name: float(size) for name, _, size in pairs}


def main() -> None:
    """Parse, simulate, write."""
    parser = argparse.ArgumentParser(prog="other_ship", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--hide", action="append", default=[], metavar="EFFECT:PARAM=VALUE,...")
    parser.add_argument("--outside", action="append", default=[], metavar="NAME=SIZE", help=", ".join(OUTSIDE))
    parser.add_argument("--sea", choices=list(SEAS), default="calm")
    parser.add_argument("--programme", choices=list(PROGRAMMES), default="programme")
    parser.add_argument("--duration", type=float, default=3600.0, help="seconds")
    parser.add_argument("--rate", type=float, default=10.0, help="Hz")
    parser.add_argument("--noise", type=float, default=1.0, help="factor on the sensors' noise")
    parser.add_argument("--correlated", action="store_true")
    parser.add_argument("--outliers", type=float, default=0.0, help="share of samples")
    parser.add_argument("--gaps", type=float, default=0.0, help="share of time")
    parser.add_argument("--model-error", type=float, default=0.0, help="percent")
    parser.add_argument("--model-error-form", choices=FORMS, default="coefficients")
    parser.add_argument("--no-heel", action="store_true", help="heel does nothing to the other motions")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    table, truth = make_trial(
        given.seed,
        parse_effects(given.hide),
        _sizes(given.outside),
        given.sea,
        given.programme,
        given.duration,
        given.rate,
        given.noise,
        given.model_error,
        given.model_error_form,
        given.outliers,
        given.gaps,
        given.correlated,
        not given.no_heel,
    )
    stamps = pd.DatetimeIndex(table.index).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    table.set_axis(stamps, axis=0).rename_axis("time").to_csv(given.output)
    plain = {key: value for key, value in truth.items() if not isinstance(value, np.ndarray)}
    given.output.with_suffix(".truth.json").write_text(json.dumps(plain, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
