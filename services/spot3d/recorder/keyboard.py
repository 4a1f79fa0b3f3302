"""Single key presses from a terminal."""

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
    """Call `act` in a thread with each key that is pressed meanwhile. Yields whether there is a terminal."""
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

    # Keys arrive one by one without echo. Ctrl-C still interrupts.
    tty.setcbreak(terminal)
    listener = threading.Thread(target=listen, name="keyboard", daemon=True)
    listener.start()
    try:
        yield True
    finally:
        done.set()
        listener.join()
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
