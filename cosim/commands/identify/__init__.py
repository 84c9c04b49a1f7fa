"""``cosim identify``: numbers of the drive from logs, chapter 4 of the source."""

import typer

from cosim.commands.identify import of_logs, prepare


def register(app: typer.Typer) -> None:
    """Adds the command ``identify`` with its subcommands."""
    group = typer.Typer(
        help="Numbers of the drive from logs: dead zone, frequency response, transfer functions, mechanics, static "
        "curve, observer.",
        no_args_is_help=True,
    )
    group.command("all")(of_logs.identify_all)
    group.command("dead-zone")(of_logs.dead_zone)
    group.command("frf")(of_logs.frf)
    group.command("transfer-function")(of_logs.transfer_function)
    group.command("mechanics")(of_logs.mechanics)
    group.command("drive")(of_logs.drive)
    group.command("observer")(of_logs.observer)
    group.command("kalman")(prepare.kalman)
    group.command("scaling")(prepare.scaling)
    group.command("linearisation")(prepare.linearisation)
    group.command("markers")(prepare.markers)
    group.command("experiment")(prepare.experiment)
    app.add_typer(group, name="identify")
