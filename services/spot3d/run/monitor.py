"""What a run fills and heeds while it goes on."""

from dataclasses import dataclass
from threading import Event

from spot3d.run.display import Watcher
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.report import RunReport


@dataclass(frozen=True, slots=True)
class RunMonitor:
    """The report and the files that a run fills, who is told how it goes, and what ends it early when set."""

    report: RunReport
    files: GrowingFiles
    watcher: Watcher
    stop: Event

    def tell(self, *events: str) -> None:
        """Say what has happened to the run, and enter it into the report."""
        for event in events:
            self.report.events.append(event)
            self.watcher.on_event(event)
