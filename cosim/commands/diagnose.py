"""``cosim diagnose``: names what the simulation gets wrong in a log, extends the model and measures the gain."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(diagnose)


def diagnose(
    log: Annotated[Path, typer.Argument(help="Measured data: CSV, .mat or Parquet.")],
    external: Annotated[
        Path | None, typer.Option(help="Record of the external tracker, on its own clock.")
    ] = None,
    model: Annotated[str, typer.Option(help="full_order or simplified.")] = "full_order",
    mapping: Annotated[Path | None, typer.Option(help="TOML that names the columns.")] = None,
    tolerance: Annotated[
        float, typer.Option(help="Trust in the nominal parameters: one standard deviation, relative.")
    ] = 0.01,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate", help="Fit the nominal parameters freely: only missing structure is a cause."
        ),
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("diagnosis"),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Name what the simulation gets wrong, extend the model, measure the gain on held-out data."""
    from cosim.console import emit_json, stderr_console, warn
    from cosim.diagnosis.answer import answer
    from cosim.diagnosis.experiment import proposal_for, write_command
    from cosim.diagnosis.groups import MODELS
    from cosim.diagnosis.isolability import isolability
    from cosim.diagnosis.story import diagnose as run
    from cosim.logs import load_log, load_tracker
    from cosim.report.page import save_and_report

    loaded = load_log(log, mapping)
    tracker = load_tracker(external) if external is not None else None
    for warning in loaded.warnings:
        stderr_console().print(f"warning: {warning}", markup=False)
    if model in MODELS:
        measured = {*loaded.signals} | ({"p_load"} if "p_load" in loaded else set())
        apart = isolability(MODELS[model], measured | ({"slew_external"} if tracker else set()))
        for where, names in apart.classes:
            stderr_console().print(
                f"residual of {' and '.join(where)} shows: {', '.join(names)}", markup=False
            )
        for advice in apart.advice:
            stderr_console().print(advice, markup=False)
    with stderr_console().status("diagnosis") as status:
        found = run(
            loaded,
            tracker=tracker,
            model=model,
            tolerance=tolerance,
            calibrate=calibrate,
            folder=out,
            report=lambda text: status.update(text),
        )
        proposal = proposal_for(MODELS[model], found.findings, found.causes, found.start, found.values)
        if proposal is not None:
            proposal = write_command(proposal, out)
    result = answer(found, loaded, proposal)
    (out / "diagnosis.json").write_text(result.model_dump_json(indent=2), encoding="utf-8")
    if save_and_report(found, result, out) is None:
        warn("no report.html: install the extra 'report' (plotly, jinja2), then run 'cosim report' on the folder")
    if as_json:
        emit_json(result.model_dump())
    else:
        show(result, out)


def show(result: object, out: Path) -> None:
    """Print the answer for people."""
    from cosim.console import stdout_console, table
    from cosim.diagnosis.answer import Answer

    assert isinstance(result, Answer)
    kind = "synthetic log" if result.synthetic else "measured log"
    stdout_console().print(f"verdict: {result.verdict} ({kind}, model {result.model})")
    for cause in result.causes:
        numbers = ", ".join(
            f"{n} = {p.value:.6g} {p.unit} ({p.ci95[0]:.6g} to {p.ci95[1]:.6g})"
            for n, p in cause.parameters.items()
        )
        stdout_console().print(f"cause: {cause.effect}: {numbers}", markup=False)
        if cause.indistinguishable_from:
            stdout_console().print(
                f"  cannot be told from: {', '.join(cause.indistinguishable_from)}", markup=False
            )
    for rest in result.unexplained:
        stdout_console().print(f"unexplained in {rest.block}: {rest.what}", markup=False)
    rows = [
        (s, f"{g.rmse_before:.4g}", f"{g.rmse_after:.4g}", f"{g.noise_floor:.4g}", g.unit)
        for s, g in result.gain.items()
    ]
    stdout_console().print(
        table("Held-out error, before and after", ["signal", "before", "after", "noise", "unit"], rows)
    )
    if result.next_experiment:
        stdout_console().print(
            f"next experiment: {result.next_experiment.why}: {result.next_experiment.excitation}",
            markup=False,
        )
    stdout_console().print(f"written to {out}", markup=False)
