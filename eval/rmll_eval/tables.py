"""An evaluation in the terminal."""

from rich.columns import Columns
from rich.table import Table
from rich.text import Text

from rmll_eval.evaluation import Evaluation
from rmll_eval.walk_metrics import ENERGY, METRICS, Metric, fallen, faulted, mean, stuck, worst
from rmll_view.console import console


def show(evaluation: Evaluation, as_grid: bool) -> None:
    """Print what the walks come to, and ``as_grid`` the figures of each command before it."""
    screen = console()
    screen.print(Text(evaluation.title, "bold"))
    screen.print(Text(evaluation.policy, "dim"), "\n")
    if as_grid:
        # cost of transport is energy per metre in another unit
        tables = [_grid(metric, evaluation) for metric in METRICS[:-1]]
        screen.print(Columns(tables, padding=(0, 3)))
    screen.print(_summary(evaluation))


def _summary(evaluation: Evaluation) -> Table:
    walks, reference = evaluation.walks, evaluation.reference
    table = Table("", box=None, padding=(0, 2, 0, 0))
    for head in ("mean", "worst", *(["paper"] if reference else [])):
        table.add_column(head, justify="right")
    for metric in METRICS:
        table.add_row(*_row(metric.title, metric, mean(metric, walks), worst(metric, walks)))
    if reference:
        compared = evaluation.at_the_papers_speeds()
        found = mean(ENERGY, compared), worst(ENERGY, compared), reference.energy_per_metre
        low, high = reference.vx
        table.add_row(*_row(f"{ENERGY.title} at {low:g} to {high:g} m/s", ENERGY, *found))
    table.add_row("falls", f"{fallen(walks)} of {len(walks)}")
    if faults := faulted(walks):
        table.add_row("faults", f"{faults} of {len(walks)}")
    if stopped := stuck(walks):
        table.add_row("stuck", f"{stopped} of {len(walks)}")
    return table


def _row(title: str, metric: Metric, *values: float | None) -> list[str]:
    return [title, *map(metric.plain, values)]


def _grid(metric: Metric, evaluation: Evaluation) -> Table:
    """Speeds downwards, frequencies to the right; walks with a fall in red."""
    speeds, frequencies = evaluation.axes()
    table = Table(
        box=None, padding=(0, 1, 0, 0), title=Text(metric.title, "bold"), title_justify="left",
        min_width=len(metric.title),
    )  # fmt: skip
    for head in ("vx", *(f"{frequency:g}" for frequency in frequencies)):
        table.add_column(head, justify="right")
    for vx in reversed(speeds):
        cells = [evaluation.cell(vx, frequency) for frequency in frequencies]
        figures = [Text(metric.plain(mean(metric, c)), "red" if fallen(c) else "") for c in cells]
        table.add_row(f"{vx:g}", *figures)
    table.add_row()
    return table
