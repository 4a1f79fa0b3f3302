"""`spot3d certificates`: a private authority and one certificate for each role."""

from pathlib import Path
from typing import Annotated

import typer

from spot3d.cli.options import CommandError


def certificates(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME...", help="names to make a certificate for, such as: drone ground")
    ],
    out: Annotated[Path, typer.Option(help="folder for the authority and the certificates")],
    host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=ADDRESS", help="host name or address at which others connect to NAME; may be repeated"
        ),
    ] = None,
    days: Annotated[int, typer.Option(min=1, help="validity of the certificates, days")] = 365,
    renew: Annotated[bool, typer.Option("--renew", help="replace existing certificates of these names")] = False,
) -> None:
    """Make a private certificate authority, or go on with the one in the folder, and a certificate for each NAME."""
    hosts: dict[str, list[str]] = {}
    for text in host or ():
        name, _, address = text.partition("=")
        if not name or not address:
            raise CommandError(f"--host {text!r} is not NAME=ADDRESS, as in ground=192.168.1.2")
        hosts.setdefault(name, []).append(address)
    from spot3d.security.certificates import CA, issue_all

    try:
        issued = issue_all(out, names, hosts, days, renew=renew)
    except ValueError as error:
        raise CommandError(str(error)) from error
    for item in issued:
        typer.echo(f"{item.certificate} and {item.key.name}: {item.name}, valid until {item.valid_until:%Y-%m-%d}")
    typer.echo(
        f"copy {CA}.pem and its own two files to each device; never copy {out / f'{CA}.key'}, which signs new "
        "certificates"
    )
