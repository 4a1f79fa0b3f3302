"""The progress bar of a run and the lines above it."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from spot3d.run.watcher import Watcher


@contextmanager
def progress_bar(total: int | None, console: Console) -> Iterator[Watcher]:
    """A bar on the console (a terminal, or nothing but its events) for the frames fused; total: None: unknown."""
    columns = (
        TextColumn("[progress.description]{task.description}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TextColumn("[cyan]{task.fields[objects]} objects"),
        TextColumn("{task.fields[dropped]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=total, objects=0, dropped="none dropped")

        def follow(fused: int, dropped: int, objects: int) -> None:
            text = f"[red]{dropped} not fused" if dropped else "none dropped"
            bar.update(task, completed=fused + dropped, objects=objects, dropped=text, description="fusing")

        def say(text: str, style: str | None = None) -> None:
            console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

        yield Watcher(follow, lambda text: say(text, "yellow"), say)
