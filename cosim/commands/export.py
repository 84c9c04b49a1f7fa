"""``cosim export-simulink`` and ``cosim export-modelica``: a system for tools that cannot read an SSP."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console

Model = Annotated[
    str, typer.Argument(help="simplified, full_order, physical, or an .ssp or .fmu file.", metavar="MODEL")
]
Out = Annotated[
    Path, typer.Option("--out", "-o", help="Folder for the export, new or empty.", metavar="FOLDER")
]
Open = Annotated[
    bool,
    typer.Option("--open", help="Of a model by name, its open package: u and the log's signals are ports."),
]
ParameterSet = Annotated[
    list[Path] | None,
    typer.Option(help="An .ssv with names such as mechanical.J; repeatable.", metavar="FILE"),
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="Such as 'mechanical.J=900 kg.m2'; repeatable.")
]
StepSize = Annotated[str | None, typer.Option(help="Such as '1 ms'; by default the FMUs' own.")]
StopTime = Annotated[str | None, typer.Option(help="Such as '20 s'; by default the system's, or 10 s.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Write into a folder that holds files.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def register(app: typer.Typer) -> None:
    """Adds the commands ``export-simulink`` and ``export-modelica``."""
    app.command("export-simulink")(export_simulink)
    app.command("export-modelica")(export_modelica)


def export_simulink(
    model: Model,
    out: Out,
    open_package: Open = False,
    parameter_set: ParameterSet = None,
    settings: Settings = None,
    step_size: StepSize = None,
    stop_time: StopTime = None,
    overwrite: Overwrite = False,
    blocks: Annotated[
        str,
        typer.Option(
            help="fmu: Simulink imports each FMU. s-function: each is an S-function in C, which mex compiles.",
            metavar="KIND",
        ),
    ] = "fmu",
    as_json: AsJson = False,
) -> None:
    """Write a MATLAB script that builds the system in Simulink from its FMUs.

    Run in MATLAB, build_<model> makes <model>.slx with a block for each FMU, its parameters, wires and logged outputs. With
    --blocks s-function it needs no FMU import, and the numbers are ours to the last digit.
    """
    from cosim.api import building

    files = building.export(
        "simulink",
        model,
        out,
        open_package=open_package,
        parameter_sets=parameter_set or (),
        settings=settings or (),
        step_size=step_size,
        stop_time=stop_time,
        overwrite=overwrite,
        blocks=blocks,
    )
    _tell(files, f"in MATLAB: cd('{out.absolute()}'); {files[0].stem}", as_json)


def export_modelica(
    model: Model,
    out: Out,
    open_package: Open = False,
    parameter_set: ParameterSet = None,
    settings: Settings = None,
    step_size: StepSize = None,
    stop_time: StopTime = None,
    overwrite: Overwrite = False,
    source: Annotated[
        bool,
        typer.Option(
            "--source", help="Write the blocks' equations as Modelica; no FMU is needed to run them."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write a Modelica package that runs the system's FMUs, and a script for OpenModelica.

    The package has a model for each FMU and the system with its connections and parameters; a tool needs a C compiler. With
    --source the blocks are plain Modelica, from the equations that the FMUs run, effects included.
    """
    from cosim.api import building

    files = building.export(
        "modelica",
        model,
        out,
        open_package=open_package,
        parameter_sets=parameter_set or (),
        settings=settings or (),
        step_size=step_size,
        stop_time=stop_time,
        overwrite=overwrite,
        equations=source,
    )
    _tell(files, f"in OpenModelica: cd {out.absolute()} && omc simulate.mos", as_json)


def _tell(files: list[Path], how: str, as_json: bool) -> None:
    if as_json:
        console.emit_json({"files": files, "run": how})
        return
    output = console.stdout_console()
    output.print(f"{len(files)} files written, the first {files[0]}", markup=False, soft_wrap=True)
    output.print(how, markup=False, soft_wrap=True)
