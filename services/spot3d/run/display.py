"""Shows how a run goes, by a progress bar and lines above it, and holds what it writes to and what stops it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Event

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from spot3d.run.growing_files import GrowingFiles
from spot3d.run.report import RunReport


class RunConsole(Console):
    """Prints to whoever reads it; a run goes on without, as before `head`, or before a `tee` that Ctrl-C has ended."""

    def on_broken_pipe(self) -> None:
        """Print nothing more, instead of ending the program."""
        with suppress(SystemExit):
            super().on_broken_pipe()


@dataclass(frozen=True, slots=True)
class Watcher:
    """on_progress(fused, not fused, objects) is called often; the others with one line for people.

    on_event: something has happened to the run. on_note: information, nothing is wrong.
    """

    on_progress: Callable[[int, int, int], None]
    on_event: Callable[[str], None]
    on_note: Callable[[str], None]


@dataclass(frozen=True, slots=True)
class RunMonitor:
    """A run's report and files, the watcher that shows its progress, and the event that ends it early."""

    report: RunReport
    files: GrowingFiles
    watcher: Watcher
    stop: Event

    def tell(self, *events: str) -> None:
        """Show events of the run, and enter them into the report."""
        for event in events:
            self.report.events.append(event)
            self.watcher.on_event(event)


@contextmanager
def progress_bar(total: int | None, console: Console) -> Iterator[Watcher]:
    """A progress bar for the frames fused; on a console that is no terminal only lines. total: None: unknown."""
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
        task = bar.add_task("starting", total=total, objects=0, dropped="")

        def follow(fused: int, dropped: int, objects: int) -> None:
            # None so far may be on the way, or lost: what never came is known only at the end.
            text = f"[red]{dropped} not fused" if dropped else ""
            bar.update(task, completed=fused + dropped, objects=objects, dropped=text, description="fusing")

        def say(text: str, style: str | None = None) -> None:
            console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

        yield Watcher(follow, lambda text: say(text, "yellow"), say)
