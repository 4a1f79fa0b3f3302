"""Single keys from a terminal, as they are pressed."""

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LOOK_S = 0.1


@contextmanager
def on_key(act: Callable[[str], None]) -> Iterator[bool]:
    """Call `act` with each key that is pressed meanwhile, in a thread; gives whether there is a keyboard at all."""
    if not sys.stdin.isatty():
        yield False
        return
    terminal = sys.stdin.fileno()
    before, done = termios.tcgetattr(terminal), threading.Event()

    def listen() -> None:
        while not done.is_set():
            if select.select([terminal], [], [], _LOOK_S)[0]:
                pressed = os.read(terminal, 1)
                if not pressed:
                    return
                act(pressed.decode("ascii", "replace"))

    # Keys come one by one and are not shown; Ctrl-C stays what it is.
    tty.setcbreak(terminal)
    listener = threading.Thread(target=listen, name="keyboard", daemon=True)
    listener.start()
    try:
        yield True
    finally:
        done.set()
        listener.join()
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
