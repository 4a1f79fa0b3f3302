"""What a run writes to, and what stops it."""

from dataclasses import dataclass
from threading import Event

from spot3d.run.display import Watcher
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.report import RunReport


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
