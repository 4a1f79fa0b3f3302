"""The command `spot3d`, and `python -m spot3d`."""

import os
import signal
from types import FrameType


def main() -> None:
    """Run the command line. Ctrl-C during its import ends it silently with exit code 130."""
    before = signal.getsignal(signal.SIGINT)
    # An exception would show where the import was, and libraries convert it. Ctrl-C that is ignored stays so.
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from spot3d.cli.app import main as command_line

    signal.signal(signal.SIGINT, before)
    command_line()


def _end(_number: int, _frame: FrameType | None) -> None:
    os._exit(130)


if __name__ == "__main__":
    main()
