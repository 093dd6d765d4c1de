"""What an evaluation comes to, in the order of the JSON that ``rmll-eval gait --json`` prints."""

import msgspec


class MeanAndWorst(msgspec.Struct, frozen=True):
    """Of one metric; None where no walk had a value."""

    mean: float | None
    worst: float | None
    """Of a single walk"""


class PaperComparison(msgspec.Struct, frozen=True):
    """The walks at the speeds at which the paper measured this gait's energy."""

    vx: tuple[float, float]
    """[m/s] the least and the highest of them"""
    episodes: int
    energy_per_metre: float | None
    """[J/m] of ours"""
    paper: float
    """[J/m]"""


class WalkRecord(msgspec.Struct, frozen=True):
    """One walk: its command and seed, and the figures of a WalkMetrics."""

    vx: float
    """[m/s]"""
    wz: float
    """[rad/s]"""
    frequency: float
    """c_f [policy steps]"""
    seed: int
    adherence: float | None
    off_spec_contact: float | None
    vx_error: float | None
    wz_error: float | None
    energy_per_metre: float | None
    cost_of_transport: float | None
    distance: float
    falls: int
    fault: str | None
    stuck: bool


class EvaluationReport(msgspec.Struct, frozen=True):
    """All walks of one policy in one world."""

    gait: str
    policy: str
    world: str
    seconds: float
    """of each walk"""
    seed: int
    ground: str
    level: int
    pushes: bool
    episodes: int
    falls: int
    """Walks with one, and so are the next two"""
    faults: int
    stuck: int
    adherence: MeanAndWorst
    off_spec_contact: MeanAndWorst
    vx_error: MeanAndWorst
    wz_error: MeanAndWorst
    energy_per_metre: MeanAndWorst
    cost_of_transport: MeanAndWorst
    energy_at_the_papers_speeds: PaperComparison | None
    """None where the paper has nothing to compare with"""
    walks: tuple[WalkRecord, ...]
