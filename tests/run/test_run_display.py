"""What a run shows on a terminal while it goes on."""

from io import StringIO

from rich.console import Console

from spot3d.run.display import progress_bar


def test_what_is_on_the_way_is_not_said_to_be_fused() -> None:
    screen = StringIO()
    with progress_bar(10, Console(file=screen, force_terminal=True, width=120)) as watcher:
        watcher.on_progress(5, 0, 1)
    assert "1 objects" in screen.getvalue()
    assert "none dropped" not in screen.getvalue()
    with progress_bar(10, Console(file=screen, force_terminal=True, width=120)) as watcher:
        watcher.on_progress(5, 2, 1)
    assert "2 not fused" in screen.getvalue()
