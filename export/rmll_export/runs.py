"""Which checkpoint is meant by a gait: identity is the gait's rules, not its name.

Of the policies that bear the name, those of other rules are passed over, and what was stopped comes
after what has finished. Whatever is passed over is told.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from rmll_common.errors import InputError
from rmll_export.checkpoint_reader import origin
from rmll_gaits.load import is_gait_file, library_names, load_gait
from rmll_gaits.table import MachineTable

POLICY, RESULT = "policy.safetensors", "result.yaml"
"""What a run leaves; the latter only when it has finished"""
SHOWN = 4
"""Policies passed over that are told one by one"""


@dataclass(frozen=True)
class Choice:
    """A checkpoint, and why it is this one."""

    checkpoint: Path
    why: str
    passed_over: list[str]
    """Each with its reason"""
    shortfalls: list[str]
    """What keeps it from being useful, as its run was judged; empty for one that was not judged"""

    def told(self) -> str:
        """For the user, a line each."""
        over = self.passed_over[:SHOWN]
        if more := len(self.passed_over) - len(over):
            over.append(f"{more} more")
        lines = [f"taken: {self.checkpoint}, {self.why}", *(f"passed over: {one}" for one in over)]
        if self.shortfalls:
            lines.append(f"not useful yet: {'; '.join(self.shortfalls)}")
        return "\n".join(lines)


@dataclass(frozen=True)
class _FoundPolicy:
    checkpoint: Path
    name: str
    """of its gait"""
    rules: str
    state: str
    """finished, shipped, or how far it came"""
    age: float
    """[s] of the clock when it was written"""
    shortfalls: list[str]


def choose(gait: str, runs: Path, shipped: Path | None = None) -> Choice:
    """The newest finished run of a gait, else its policy in ``shipped``, else its newest run.

    ``gait`` is one of the library, a gait file, or what a gait that was trained from a file is
    called; its rules are then those of its newest run. A run's folder or a checkpoint stands for
    itself. Raises InputError if there is none.
    """
    if (path := _checkpoint(gait)) is not None:
        return as_named(path)
    table = _table(gait)
    name = gait if table is None else table.gait
    found, passed_over = _policies(name, runs, shipped)
    rules = table.rules if table else found[0].rules if found else ""
    chosen = next((policy for policy in found if policy.rules == rules), None)
    for policy in found:
        if policy.rules != rules:
            other = gait if table else "the newest"
            passed_over.append(f"{policy.checkpoint}, {policy.state}: other rules than {other}")
        elif policy is not chosen and policy.state not in ("finished", "shipped"):
            passed_over.append(f"{policy.checkpoint}, {policy.state}")
    if chosen is None:
        raise InputError(_nothing(gait, name, runs, shipped, passed_over))
    if chosen.state == "shipped":
        why = "shipped"
    elif chosen.state == "finished":
        why = f"the newest finished run of {gait}"
    else:
        why = f"the newest run of {gait}, {chosen.state}"
    return Choice(chosen.checkpoint, why, passed_over, chosen.shortfalls)


def as_named(checkpoint: Path, gait: str = "") -> Choice:
    """A checkpoint itself; raises InputError if it is not one of ``gait``."""
    policy = _read(checkpoint)
    table = _table(gait)
    if gait and policy.name != (table.gait if table else gait):
        raise InputError(f"{checkpoint}: holds gait {policy.name!r}, expected {gait!r}")
    if table and policy.rules != table.rules:
        raise InputError(f"{checkpoint}: its gait has other rules than {gait}")
    why = f"as named, {policy.state}" if checkpoint.name == POLICY else "as named"
    return Choice(checkpoint, why, [], policy.shortfalls)


def _table(gait: str) -> MachineTable | None:
    """The rules of a gait of the library or in a file; None for a gait known by its name alone."""
    return load_gait(gait) if gait in library_names() or is_gait_file(gait) else None


def _checkpoint(named: str) -> Path | None:
    """The file that a path names, a checkpoint or a run's folder; None for a gait.

    Raises InputError for another path.
    """
    path = Path(named)
    if path.suffix == ".safetensors":
        return path
    if (path / POLICY).is_file():
        return path / POLICY
    if ("/" in named or named in (".", "..")) and not is_gait_file(named):
        raise InputError(f"{named}: no run of rmll-train, which has a {POLICY}")
    return None


def _policies(name: str, runs: Path, shipped: Path | None) -> tuple[list[_FoundPolicy], list[str]]:
    """All policies of a name, the best first, and what could not be read, with the reason."""
    found, unread = [], []
    paths = [run / POLICY for run in (runs / name).glob("*") if run.is_dir()]
    if shipped is not None and (path := shipped / f"{name}.safetensors").is_file():
        paths.append(path)
    for path in paths:
        try:
            found.append(_read(path))
        except InputError as error:
            unread.append(str(error))
    order = {"finished": 2, "shipped": 1}
    found.sort(key=lambda policy: (order.get(policy.state, 0), policy.age), reverse=True)
    return found, unread


def _read(path: Path) -> _FoundPolicy:
    """Raises InputError."""
    about = origin(path)
    rules = MachineTable.from_dict(about.table).rules
    result = path.with_name(RESULT)
    state, written = "finished", result
    if not result.is_file():
        state = "shipped" if path.name != POLICY else _progress(about.provenance)
        written = path
    try:
        shortfalls = msgspec.convert(about.provenance.get("shortfalls", []), list[str])
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: the shortfalls in its provenance: {error}") from error
    return _FoundPolicy(path, about.gait, rules, state, written.stat().st_mtime, shortfalls)


def _progress(provenance: dict[str, Any]) -> str:
    """How far a run came that has not finished."""
    try:
        done, wanted = provenance["steps"], provenance["settings"]["learner"]["steps"]
        return f"stopped at {done / 1e6:.3g} of {wanted / 1e6:.3g} M steps"
    except (KeyError, TypeError):
        return "not finished"


def _nothing(gait: str, name: str, runs: Path, shipped: Path | None, passed_over: list[str]) -> str:
    places = f"no run in {runs / name}/"
    if shipped is not None:
        places += f" and no {shipped / name}.safetensors"
    if passed_over:
        return f"no policy of {gait}: {places} can be taken: {'; '.join(passed_over[:SHOWN])}"
    known = {path.name for path in runs.glob("*") if path.is_dir()}
    known |= {path.stem for path in shipped.glob("*.safetensors")} if shipped else set()
    return (
        f"no policy of {gait}: {places}; there are: {', '.join(sorted(known - {name})) or 'none'}"
    )
