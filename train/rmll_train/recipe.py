"""A recipe: the stages in which a policy is trained, as one file.

    stages:
      - {gait: half_bound, learner: {steps: 15000000}}
      - {world: {rewards: {velocity_yaw: 1.5}}, learner: {steps: 19500000}}

A stage names the settings that differ from the stage before it, the first one those that differ
from the defaults. ``learner.steps`` counts from the beginning of the first stage.
"""

from dataclasses import replace
from pathlib import Path

from rmll_common import typed_yaml, yaml_document
from rmll_common.errors import InputError
from rmll_gaits.load import is_gait_file
from rmll_train.checkpoint import load_checkpoint
from rmll_train.train_settings import TrainSettings
from rmll_train.training import Report, train

STAGES = "stages"
MOST_STAGES = 20


def is_recipe(name: str) -> bool:
    """Whether ``name`` is a file with stages in it, and not a gait or its file.

    Raises InputError if it is a file that cannot be read as YAML.
    """
    if not (is_gait_file(name) and Path(name).is_file()):
        return False
    value = yaml_document.parse(yaml_document.read_text(Path(name)), name)
    return value is not None and value.is_mapping and STAGES in value.mapping()


def load_recipe(path: Path) -> list[TrainSettings]:
    """The whole settings of each stage, in order.

    Raises InputError for a wrong setting, and for a stage that changes the gait or the seed, or has
    no more steps than the one before it.
    """
    value = yaml_document.read(yaml_document.read_text(path), str(path))
    entries = value.mapping(allowed=[STAGES], required=[STAGES])[STAGES].items(1, MOST_STAGES)
    stages: list[TrainSettings] = []
    for entry in entries:
        before = stages[-1] if stages else TrainSettings()
        stage = typed_yaml.convert(entry, TrainSettings, before)
        stage = replace(stage, gait=located(stage.gait))
        if stages and (stage.gait, stage.seed) != (before.gait, before.seed):
            raise entry.error("a later stage cannot change the gait or the seed")
        if stages and stage.learner.steps <= before.learner.steps:
            steps = before.learner.steps
            raise entry.error(f"learner.steps counts from the first stage, expected over {steps}")
        try:
            stage.check()
        except InputError as error:
            raise entry.error(str(error)) from None
        stages.append(stage)
    return stages


def located(gait: str) -> str:
    """``gait``, if it is a file by its absolute path, so that a run is resumed from any folder."""
    return str(Path(gait).absolute()) if is_gait_file(gait) else gait


def train_stages(
    folder: Path, stages: list[TrainSettings], report: Report, resume: bool = False
) -> bool:
    """Train one policy through all stages; returns False if Ctrl-C or SIGTERM ended it before.

    ``resume``: go on where the run in ``folder`` stopped, in whichever stage. Raises what
    :func:`rmll_train.training.train` raises.
    """
    for stage in stages:
        followed = stage is not stages[-1]
        if resume and followed and load_checkpoint(folder)["steps"] >= stage.learner.steps:
            continue
        if not train(folder, stage, report, resume):
            return False
        resume = True
    return True
