"""What can be set on the robot: one file, checked when it is read.

Every setting is written down once, here: type, range, default and meaning.
"""

from pathlib import Path
from typing import Annotated, Any, get_type_hints

import msgspec
import yaml
from msgspec import Meta

from rmll_gaits.errors import InputError

Seconds = Annotated[float, Meta(ge=0.1, le=60)]
Raw = Annotated[int, Meta(ge=-32768, le=32767)]
Angle = Annotated[float, Meta(ge=0.1, le=1.5)]


class Link(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The network. A robot at its low level is 192.168.123.10:8007."""

    robot_address: Annotated[str, Meta(description="host:port; the default is the emulator")] = (
        "127.0.0.1:8007"
    )
    local_port: Annotated[int, Meta(ge=0, le=65535, description="0 = any free one")] = 0
    startup_timeout: Annotated[Seconds, Meta(description="[s] to the robot's first answer")] = 5.0


class Feet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Foot force thresholds, raw sensor units."""

    # motion_imitation, walk_in_the_park and Tsinghua's unitree_ros_real all take 20
    touching: Annotated[Raw, Meta(description="above it, a foot is in contact")] = 20
    clear: Annotated[Raw, Meta(description="below it, a foot is in the air")] = 10

    def __post_init__(self) -> None:
        if self.clear > self.touching:
            raise ValueError(f"clear is {self.clear}, expected at most touching, {self.touching}")


class Safety(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Faults, all of which end in damping."""

    # most deployments trip between 0.8 and 1.2 rad
    roll_limit: Annotated[Angle, Meta(description="[rad]")] = 1.0
    pitch_limit: Annotated[Angle, Meta(description="[rad]")] = 1.0
    stale_ms: Annotated[
        float, Meta(ge=10, le=1000, description="[ms] without a new state from the robot")
    ] = 50.0


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How long the movements between lying and walking take."""

    crouch: Annotated[Seconds, Meta(description="[s] from where the legs are to folded")] = 1.0
    rise: Annotated[Seconds, Meta(description="[s] from folded to standing")] = 2.0
    settle: Annotated[Seconds, Meta(description="[s] to the policy's own pose")] = 0.5
    slow_down: Annotated[
        Seconds,
        Meta(description="[s] of walking on the spot before standing still or sitting down"),
    ] = 1.0
    sit: Annotated[Seconds, Meta(description="[s] down to folded legs")] = 2.0


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    link: Link = Link()
    feet: Feet = Feet()
    safety: Safety = Safety()
    motion: Motion = Motion()


def load_settings(path: Path | None) -> Settings:
    """Read a settings file; what it leaves out keeps its default, without a file everything.

    Raises InputError for an unknown name, a wrong type or a value out of range.
    """
    if path is None:
        return Settings()
    try:
        plain = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    plain = {} if plain is None else plain
    _check_names(plain, Settings, str(path))
    try:
        return msgspec.convert(plain, Settings)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {error}") from error


def as_yaml(settings: Settings) -> str:
    """The settings as a file, each with its meaning."""
    lines = []
    for section in msgspec.structs.fields(settings):
        values = getattr(settings, section.name)
        lines.append(f"# {type(values).__doc__}\n{section.name}:")
        hints = get_type_hints(type(values), include_extras=True)
        for name, value in msgspec.structs.asdict(values).items():
            meaning = next(m.description for m in hints[name].__metadata__ if m.description)
            lines.append(f"  {name}: {value}  # {meaning}")
    return "\n".join(lines)


def _check_names(plain: Any, kind: type[msgspec.Struct], where: str) -> None:
    """msgspec names the entry it does not know; this names the ones it does."""
    if not isinstance(plain, dict):
        return
    known = {field.name: field.type for field in msgspec.structs.fields(kind)}
    for name, value in plain.items():
        if name not in known:
            raise InputError(f"{where}: unknown {name!r}; known: {', '.join(known)}")
        if isinstance(known[name], type) and issubclass(known[name], msgspec.Struct):
            _check_names(value, known[name], f"{where}: {name}")
