"""What a run shows while it trains: two lines that stay, or without a terminal a line at times."""

import sys
import time

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from rmll_contract.usefulness import share
from rmll_gaits.table import Commands
from rmll_train import training
from rmll_train.training import Judging, Start
from rmll_view.console import console

QUIET_SECONDS = 30.0
"""Between two lines without a terminal"""


class LiveReport:
    """Both lines fit into 80 columns. Errors are told as shares of a standing robot's."""

    def __init__(self, screen: Console | None = None):
        self._commands: Commands | None = None
        screen = screen or console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}", markup=False), BarColumn(14), TaskProgressColumn(),
            TimeRemainingColumn(), TextColumn("left", markup=False),
        )  # fmt: skip
        self._task = self._bar.add_task("training")
        self._figures = Text("", no_wrap=True, overflow="ellipsis")
        self._terminal = screen.is_terminal
        self._live = Live(Group(self._bar, self._figures), console=screen)
        self._told = time.monotonic()

    def __enter__(self) -> "LiveReport":
        if self._terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._terminal:
            self._live.stop()

    def __call__(self, progress: Start | training.TrainingProgress | Judging) -> None:
        if isinstance(progress, Start):
            self._commands = progress.commands
            self._live.console.print(str(progress.precision))
            if progress.steps >= progress.total:
                self._live.console.print(
                    f"nothing left to train: the run has {progress.steps:,} of "
                    f"{progress.total:,} steps"
                )
            return
        if isinstance(progress, Judging):
            self._bar.update(
                self._task, description="judging without exploration",
                completed=progress.done, total=progress.total,
            )  # fmt: skip
            return
        speed = f"{progress.steps / 1e6:.2f} M steps, {progress.rate:,.0f}/s"
        figures = self._described(progress.metrics)
        self._bar.update(self._task, description=speed, completed=progress.steps,
                         total=progress.total)  # fmt: skip
        self._figures.plain = figures
        if not self._terminal and time.monotonic() - self._told > QUIET_SECONDS:
            self._told = time.monotonic()
            left = (progress.total - progress.steps) / max(progress.rate, 1)
            print(f"{speed}  {figures}  {left / 60:.0f} min left", file=sys.stderr, flush=True)

    def _described(self, metrics: dict[str, float]) -> str:
        assert self._commands is not None, "a run begins with its start"
        vx = share(metrics["vx_error"], self._commands.vx)
        wz = share(metrics["wz_error"], self._commands.wz)
        return (
            f"adherence {metrics['adherence']:.2f}  errors, of standing still's: vx {vx:.0%}, "
            f"wz {wz:.0%}  {metrics['energy_per_metre']:.0f} J/m"
        )
