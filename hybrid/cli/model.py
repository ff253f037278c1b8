"""``seatrial train``, ``validate``, ``evaluate``, ``predict`` and ``watch``: they parse, call and print."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from seatrial.acquisition.cli import AsJson, writes
from seatrial.acquisition.core.process import echo, stop_on_signals
from seatrial.analysis.cli import RebuildPositions
from seatrial.hybrid.cli import (
    AllowSeenOption,
    AnyOption,
    CalibratorOption,
    CodeOption,
    HorizonOption,
    PartOption,
    Recordings,
    RepairOption,
    StrideOption,
    VesselOption,
    chosen_calibrator,
    print_result,
    say_what_needs_networks,
)

WATCH_HORIZON_S = 30
_NICENESS = 5  # the logger goes first


@writes(folder="output")
def train(
    files: Recordings,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for the calibrator.")],
    vessel: VesselOption = None,
    horizon: Annotated[int, typer.Option(min=2, help="The horizon of its predictions, in seconds.")] = 15,
    stride: StrideOption = 5,
    method: Annotated[
        str, typer.Option(help="adaptive, paper, paper_adam, additive, data_driven, or FILE.py:CLASS of your own.")
    ] = "adaptive",
    part: PartOption = "0..100",
    any_commands: AnyOption = False,
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same calibrator.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Train a calibrator on a reference model."""
    from seatrial.hybrid.calibrators import refuse_untrainable
    from seatrial.hybrid.calibrators.own import save
    from seatrial.hybrid.scripting import train as run
    from seatrial.hybrid.vessel.files import reference_model, trials_of

    refuse_untrainable(method)
    reference_model(trials_of(files), vessel)
    trained = run(
        files, vessel, method, horizon, stride_s=stride, part=part, any_commands=any_commands,
        repair=repair, rebuild_positions=rebuild_positions, seed=seed,
    )  # fmt: skip
    path = save(trained, output)
    if as_json:
        echo(json.dumps({**trained.remarks, "calibrator": str(path.parent), **trained.metrics}))
        return
    echo(str(trained), err=True)
    say_what_needs_networks("the one without a model beside it")
    metrics = trained.metrics
    if metrics["held_out_hybrid_m"] > metrics["held_out_reference_m"]:
        echo("warning: on legs kept out it is WORSE than the reference; it needs more held legs", err=True)
    echo(path.parent)


def validate(
    files: Recordings,
    calibrator: CalibratorOption = None,
    method: CodeOption = None,
    vessel: VesselOption = None,
    horizon: HorizonOption = None,
    stride: StrideOption = 5,
    part: PartOption = "0..100",
    any_commands: AnyOption = False,
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    allow_seen: AllowSeenOption = False,
    as_json: AsJson = False,
) -> None:
    """Score every method on recordings that were not used for training, and the model by its manoeuvre indices."""
    from seatrial.hybrid.scripting import validate as run

    trained = chosen_calibrator(calibrator, method)
    validation = run(
        files, trained, vessel, horizon, stride_s=stride, part=part, any_commands=any_commands,
        repair=repair, rebuild_positions=rebuild_positions, allow_seen=allow_seen,
    )  # fmt: skip
    print_result(validation.as_dict(), validation, as_json=as_json)


@writes(folder="output")
def evaluate(
    files: Recordings,
    horizon: Annotated[int, typer.Option(min=2, help="The horizon of the predictions, in seconds.")] = 15,
    vessel: VesselOption = None,
    split: Annotated[
        list[str] | None,
        typer.Option(
            help="leg, time, recording or random; may be repeated. Default: leg and time, and recording if there "
            "are several files."
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="A kind of calibrator, or FILE.py:CLASS of your own; may be repeated. Default: all but paper_adam."
        ),
    ] = None,
    draws: Annotated[int, typer.Option(min=1, help="Number of random splits of legs, or of windows.")] = 5,
    stride: StrideOption = 5,
    any_commands: AnyOption = False,
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for evaluation.json and evaluation.html.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same figures.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Compare the methods by cross-validation, with 95 % intervals."""
    from seatrial.hybrid.scripting import evaluate as run

    if not method:
        say_what_needs_networks("every method but adaptive")
    evaluation = run(
        files, vessel, horizon, splits=split or (), methods=method or (), draws=draws, stride_s=stride,
        any_commands=any_commands, repair=repair, rebuild_positions=rebuild_positions, seed=seed,
    )  # fmt: skip
    about = {
        **evaluation.remarks,
        "files": [str(each) for each in files],
        "vessel": vessel or (evaluation.model.name if evaluation.model else ""),
        "stride_s": stride,
        **({"any_commands": True} if any_commands else {}),
        "repair": repair or rebuild_positions,
        "rebuild_positions": rebuild_positions,
        "seed": seed,
    }
    values = {**about, **evaluation.as_dict()}
    if output is not None:
        from seatrial.hybrid.report.evaluation_page import write_evaluation

        for path in write_evaluation(evaluation, json.dumps(values), about, output):
            echo(path, err=True)
    print_result(values, evaluation, as_json=as_json)


def predict(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    at: Annotated[str, typer.Option(help="ISO 8601 with zone, seconds since 1970, or +SECONDS from the start.")],
    calibrator: CalibratorOption = None,
    method: CodeOption = None,
    vessel: VesselOption = None,
    horizon: Annotated[
        int | None,
        typer.Option(min=1, help="The horizon of the predictions in seconds; default: 15, or the calibrator's."),
    ] = None,
    commands: Annotated[
        Path | None,
        typer.Option(
            help="A table of planned orders: second or time, and channels of actuators; default: unchanged."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Predict the track from one instant of a recording."""
    from seatrial.hybrid.scripting import predict as run

    prediction = run(file, at, chosen_calibrator(calibrator, method), vessel, horizon, commands)
    print_result(prediction.as_dict(), prediction, as_json=as_json)


def watch(
    config: Annotated[Path, typer.Argument(help="The configuration that `seatrial record` runs with.")],
    calibrator: CalibratorOption = None,
    method: CodeOption = None,
    vessel: VesselOption = None,
    horizon: Annotated[
        int | None,
        typer.Option(
            min=2, max=300, help="The horizon of the predictions in seconds; default: 30, or the calibrator's."
        ),
    ] = None,
    commands: Annotated[
        Path | None,
        typer.Option(
            help="A table of planned orders: time or second, and channels of actuators; read "
            "again when it changes. Default: unchanged orders."
        ),
    ] = None,
    duration: Annotated[float | None, typer.Option(min=0.0, help="Stop after this many seconds.")] = None,
    log: Annotated[str, typer.Option(help="Log format without a terminal: text, or json lines.")] = "text",
    as_json: AsJson = False,
) -> None:
    """Predict live beside the running recorder, and score earlier predictions."""
    if log not in ("text", "json"):
        raise typer.BadParameter("is neither text nor json", param_hint="--log")
    with stop_on_signals() as stop:  # before the heavy imports: they take a while, and Ctrl-C may come
        with suppress(OSError):
            os.nice(_NICENESS)
        from seatrial.acquisition.config.trial_file import load_config
        from seatrial.hybrid.calibrators.predict import predictor_of
        from seatrial.hybrid.twin import as_json as described
        from seatrial.hybrid.twin import watch as run

        trial = load_config(config)
        trained = chosen_calibrator(calibrator, method)
        predictor = predictor_of({config: trial.trial}, trained, vessel, horizon, WATCH_HORIZON_S)
        echo(str(predictor.said), err=True)
        summary = run(trial, predictor, stop, duration, log_format=log, commands=commands)  # type: ignore[arg-type]
    echo(str(summary), err=True)
    if as_json:
        echo(json.dumps(described(summary, predictor)))
